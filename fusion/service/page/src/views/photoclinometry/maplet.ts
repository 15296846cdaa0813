// One maplet solved from images: surface, convergence, and each image with its rendering.
import { getBlob, getJson, pathOf } from "../../api";
import { legend } from "../../colormaps";
import { element, fill, type Child } from "../../dom";
import { count, degrees, fixed, metres } from "../../format";
import { colormapOf, layerLegend, type LayerAbout } from "../../layers";
import { titleOf } from "../../look";
import { bandPlot } from "../../plots";
import { hrefOf } from "../../router";
import { state } from "../../stages";
import { facts, table } from "../../table";
import { findingList, percent } from "./index";
import { noiseRatio, shiftOf, type SolvedConstraint, type SolvedImage, type SolvedMaplet } from "./values";

interface Surface {
  size: number;
  side_m: number;
  layers: LayerAbout[];
}

const LAYERS = ["hillshade", "albedo", "sigma", "directions"];
// Pictures that are asked for at once.
const AT_ONCE = 4;
// Maplets around that are named.
const NAMED = 6;
const LEAST_CHANGE = 1e-6;

/** Fill the view of a maplet; it returns when all pictures are there. */
export async function mapletView(root: HTMLElement, workspace: string, name: string, of: { solution: string; inUse: boolean }, signal: AbortSignal): Promise<void> {
  const asked = `?solution=${encodeURIComponent(of.solution)}`;
  const path = pathOf(workspace, "photoclinometry", name);
  const surfacePath = pathOf(workspace, "surfaces", "maplet", name);
  const [found, surface] = await Promise.all([
    getJson<SolvedMaplet>(`${path}${asked}`, { signal }),
    getJson<Surface>(`${surfacePath}${asked}`, { signal }),
  ]);
  const images = found.images.filter((one) => one.fit !== "not-seen").sort((a, b) => (noiseRatio(b) ?? 0) - (noiseRatio(a) ?? 0));
  const pictures = new Map<HTMLImageElement, string>();
  const picture = (address: string, alt: string): HTMLImageElement => {
    const made = element("img", { alt });
    pictures.set(made, address);
    return made;
  };
  const panels = LAYERS.flatMap((layer) => surface.layers.filter((one) => one.name === layer)).map((layer) => {
    const query = `${asked}&layer=${layer.name}&format=png&rows=${surface.size}&columns=${surface.size}`;
    return panel(layer, picture(`${surfacePath}/window${query}`, `${titleOf(layer.name)} of ${name}`));
  });
  const strips = images.map((one) => strip(one, picture(`${path}/${encodeURIComponent(one.name)}${asked}`, `${one.name}: image, rendering, residual`)));
  const plots = element("div", { class: "plots" });
  fill(root, ...head(found, surface, workspace, of.inUse), element("div", { class: "tiles" }, ...panels), plots, ...constraintTable(found), element("h2", {}, "Images"), ...about(found), element("div", { class: "strips" }, ...strips), imageTable(images, found.images.length));
  draw(plots, found, signal);
  await load(pictures, signal);
}

/** The axis that images of one light leave open, where cells agree on one. */
function openAxis({ undetermined_azimuth_deg: azimuth }: SolvedMaplet): [string, string][] {
  return azimuth == null ? [] : [["slopes not determined along azimuth", degrees(azimuth, 0)]];
}

/** Those that hid and shaded the ground when it was solved, as they do in renderings. */
function around({ around: names }: SolvedMaplet): [string, string][] {
  if (!names?.length) return [];
  const more = names.length > NAMED ? ` and ${names.length - NAMED} more` : "";
  return [["maplets around that hide and shade it", names.slice(0, NAMED).join(", ") + more]];
}

/** Of kept slopes none is known. */
function slopeSigma({ slope_sigma: sigma }: SolvedMaplet): [string, string][] {
  return sigma == null ? [] : [["sigma of slopes", fixed(sigma, 3)]];
}

/** In how many directions images determine slopes; of kept slopes nothing. */
function determined({ directions }: SolvedMaplet): [string, string][] {
  const share = (k: number): string => `${fixed(100 * (directions[k] ?? 0), 0)} %`;
  return directions.length ? [["slopes determined in 2, 1, 0 directions", `${share(2)}, ${share(1)}, ${share(0)}`]] : [];
}

function head(found: SolvedMaplet, { size, side_m: side }: Surface, workspace: string, inUse: boolean): HTMLElement[] {
  const index = hrefOf(workspace, "photoclinometry", [], { solution: found.solution });
  return [
    element(
      "p",
      { class: "links" },
      element("a", { href: index }, "Goodness of fit of all maplets"),
      // Maps show the solution in use.
      inUse && element("a", { href: hrefOf(workspace, "map", ["maplet", found.name]) }, "Map"),
    ),
    element("h1", {}, found.name),
    facts([
      ["outcome", state(found.outcome)],
      ["solution", found.solution],
      ["size", `${size} × ${size} at ${metres(found.gsd_m)}, ${metres(side)} wide`],
      ["residual of brightness", `${percent(found.residual_start)} → ${percent(found.residual)}`],
      ["over the noise", fixed(found.noise_ratio, 2)],
      ["correlation", fixed(found.correlation, 3)],
      ["images shifted by (rms)", `${fixed(found.shift_px, 2)} px, ${metres(found.shift_m)}`],
      ["sigma of heights", metres(found.sigma_m)],
      ...slopeSigma(found),
      ["sigma of the relative albedo", fixed(found.albedo_sigma ?? null, 3)],
      ...determined(found),
      ...openAxis(found),
      ...around(found),
    ]),
    element("p", {}, `${found.reason}.`),
    ...(found.findings.length ? [findingList(found.findings, (name) => name)] : []),
  ];
}

function panel(layer: LayerAbout, picture: HTMLImageElement): HTMLElement {
  const shown = layer.name === "hillshade" || !layer.range ? null : layerLegend(layer, colormapOf(layer), layer.range);
  return element("figure", { class: "card" }, element("h2", {}, titleOf(layer.name)), picture, shown);
}

/** Say what the strips show. */
function about({ residual_limit: limit }: SolvedMaplet): HTMLElement[] {
  return [
    element(
      "p",
      { class: "quiet" },
      "Each image on the grid of the maplet: as it is, as the surface lets expect it, and the residual. A point has the value of its pixel, which may be larger than a grid step. Pale green: not seen; in residuals also shadow and saturated pixels. The worst first.",
    ),
    legend("redblue", `−${percent(limit)}`, percent(limit), "residual: darker, brighter than expected"),
  ];
}

function strip(one: SolvedImage, picture: HTMLImageElement): HTMLElement {
  const parts = [
    `residual ${percent(one.residual)}`,
    `${fixed(noiseRatio(one), 2)} × noise`,
    `shift ${fixed(shiftOf(one), 2)} px`,
    `${metres(one.pixel_m)} a pixel`,
  ];
  const fit: Child = one.fit === "used" ? null : state(one.fit);
  return element("figure", {}, picture, element("figcaption", {}, element("strong", {}, one.name), " ", fit, ` ${parts.join(", ")}`));
}

function imageTable(images: SolvedImage[], all: number): HTMLElement {
  const shown = table<SolvedImage>(
    "Images of the maplet",
    [
      { title: "Image", cell: ({ name }) => name, by: ({ name }) => name },
      { title: "Fit", cell: ({ fit }) => (fit === "used" ? fit : state(fit)), by: ({ fit }) => fit },
      { title: "Residual", cell: ({ residual }) => percent(residual), by: ({ residual }) => residual, number: true },
      { title: "÷ noise", cell: (one) => fixed(noiseRatio(one), 2), by: noiseRatio, number: true },
      { title: "Correlation", cell: ({ correlation }) => fixed(correlation, 3), by: ({ correlation }) => correlation, number: true },
      { title: "Shift, px", cell: (one) => fixed(shiftOf(one), 2), by: shiftOf, number: true },
      { title: "Pixels", cell: ({ pixels }) => count(pixels), by: ({ pixels }) => pixels, number: true },
      { title: "Pixel", cell: ({ pixel_m }) => metres(pixel_m), by: ({ pixel_m }) => pixel_m, number: true },
    ],
    images,
  );
  const others = all - images.length;
  return element("div", {}, shown, others > 0 && element("p", { class: "quiet" }, `${count(others)} further images were asked, and do not see lit ground of it.`));
}

/** Show how well constraining heights agree with the surface, the worst first. */
function constraintTable({ constraints }: SolvedMaplet): HTMLElement[] {
  if (!constraints.length) return [];
  const shown = table<SolvedConstraint>(
    "Constraining heights",
    [
      { title: "Heights of", cell: ({ name }) => name, by: ({ name }) => name },
      { title: "Heights", cell: ({ heights }) => count(heights), by: ({ heights }) => heights, number: true },
      { title: "Left out as false", cell: ({ left_out }) => count(left_out), by: ({ left_out }) => left_out, number: true },
      { title: "Less the solved (rms)", cell: ({ residual_m }) => metres(residual_m), by: ({ residual_m }) => residual_m, number: true },
      { title: "÷ sigma", cell: ({ ratio }) => fixed(ratio, 2), by: ({ ratio }) => ratio, number: true },
    ],
    [...constraints].sort((a, b) => (b.ratio ?? 0) - (a.ratio ?? 0)),
  );
  return [element("h2", {}, "Constraining heights"), shown];
}

/** Draw residual and changes by round. */
function draw(plots: HTMLElement, { rounds, gsd_m: gsd }: SolvedMaplet, signal: AbortSignal): void {
  if (!rounds.length) {
    fill(plots, element("p", { class: "quiet" }, "There was no round: the start is kept."));
    return;
  }
  const numbers = rounds.map((_, k) => k + 1);
  const [residual, changes] = [element("div", { class: "plot" }), element("div", { class: "plot" })];
  residual.dataset.height = changes.dataset.height = "200";
  const card = (title: string, plot: HTMLElement): HTMLElement => element("section", { class: "card" }, element("h2", {}, title), plot);
  fill(plots, card("Residual by round", residual), card("Changes by round", changes));
  const line = (label: string, y: (number | null)[], colour: string) => ({ label, y, sigma: null, colour });
  const nothing = (): void => undefined;
  // Heights are kept where only the albedo was solved.
  const moved = rounds.map(({ height_m: height }) => (height === null ? null : Math.max(height / gsd, LEAST_CHANGE)));
  const heights = moved.some((one) => one !== null) ? [line("heights (GSD)", moved, "--spc")] : [];
  const stepX = Math.ceil(rounds.length / 12);
  bandPlot(residual, numbers, [line("residual", rounds.map((one) => (one.residual === null ? null : 100 * one.residual)), "--text")], { x: "round", y: "residual (%)" }, nothing, signal, { stepX });
  bandPlot(
    changes,
    numbers,
    [...heights, line("albedo", rounds.map((one) => Math.max(one.albedo, LEAST_CHANGE)), "--lidar")],
    { x: "round", y: "change" },
    nothing,
    signal,
    { stepX, logarithmic: true },
  );
}

/** Fetch pictures, a few at once; a token goes with them, which an address cannot have. */
async function load(pictures: Map<HTMLImageElement, string>, signal: AbortSignal): Promise<void> {
  const waiting = [...pictures];
  const made: string[] = [];
  signal.addEventListener("abort", () => made.forEach((url) => URL.revokeObjectURL(url)));
  const work = async (): Promise<void> => {
    for (let next = waiting.shift(); next; next = waiting.shift()) {
      const [image, address] = next;
      const url = URL.createObjectURL(await getBlob(address, { signal }));
      made.push(url);
      image.src = url;
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, work));
}
