// Epsilon, the relative error of scale: of all, per day, by local time and longitude.
import { getJson, pathOf } from "../api";
import { element, fill } from "../dom";
import { number, partsPerMillion } from "../format";
import { pointsPlot, type Level, type Points } from "../plots";
import type { View } from "../router";

const MILLION = 1e6;

interface Against {
  single: { at: number[]; epsilon: number[]; epsilon_sigma: (number | null)[]; used: boolean[] };
  bins: { at: number[]; epsilon: number[]; standard_error: (number | null)[] };
}

interface Epsilon {
  epsilon: number | null;
  epsilon_sigma: number | null;
  method: string | null;
  verdict: string | null;
  reasons: string[] | null;
  trends: Record<string, Trend> | null;
  per_day: { day: string; n: number; epsilon: number | null; epsilon_sigma: number | null }[];
  local_time_h: Against;
  longitude_deg: Against;
}

/** A wave of ε over an angle: its amplitude, and how likely chance makes one as large. */
interface Trend {
  amplitude: number | null;
  sigma: number | null;
  p_value: number | null;
}

interface Finding {
  stage: string;
  code: string;
  severity: string;
  text: string;
}

export const scale: View = {
  title: "Scale",
  async open(root, route, signal) {
    const [found, about] = await Promise.all([
      getJson<Epsilon>(pathOf(route.workspace, "scale", "epsilon"), { signal }),
      getJson<{ findings: Finding[] }>(pathOf(route.workspace), { signal }),
    ]);
    const findings = about.findings.filter((each) => each.stage === "scale");
    const plots = element("div", { class: "plots" });
    fill(root, element("h1", {}, "Scale"), head(found), codes(found, findings), plots);
    draw(plots, found, signal);
    root.dataset.ready = "true";
  },
};

function head({ epsilon, epsilon_sigma: sigma, method, verdict }: Epsilon): HTMLElement {
  return element(
    "p",
    { class: "result" },
    element("strong", {}, `ε = ${partsPerMillion(epsilon, sigma)}`),
    [method && `method ${method}`, verdict].filter(Boolean).map((each) => ` · ${each}`).join(""),
    element("br"),
    element("span", { class: "quiet" }, "ε > 0: the lidar's ranges are longer than predicted, and all SPC lengths are to be multiplied by 1 + ε."),
  );
}

/** Return the findings with their codes, and why a term could not be observed. */
function codes({ reasons, trends }: Epsilon, findings: Finding[]): HTMLElement | null {
  const items = findings.map(({ code, severity, text }) => element("li", {}, element("code", {}, code), ` ${severity}: ${text}`));
  for (const reason of reasons ?? []) items.push(element("li", {}, reason));
  for (const [angle, { amplitude, sigma, p_value: chance }] of Object.entries(trends ?? {})) {
    const size = partsPerMillion(amplitude, sigma);
    items.push(element("li", {}, `Wave over ${angle.replaceAll("_", " ")}: ${size}; by chance with probability ${number(chance, 2)}.`));
  }
  return items.length ? element("ul", { class: "codes", "aria-label": "Findings" }, ...items) : null;
}

function draw(root: HTMLElement, found: Epsilon, signal: AbortSignal): void {
  const levels: Level[] = found.epsilon === null ? [] : [
    { y: MILLION * found.epsilon, sigma: MILLION * (found.epsilon_sigma ?? 0), colour: "--fused" },
  ];
  const place = (title: string, text: string): HTMLElement => {
    const plot = element("div", { class: "plot" });
    root.append(element("section", { class: "card" }, element("h2", {}, title), plot, element("p", { class: "quiet" }, text)));
    return plot;
  };
  const band = "The line with its band is the value of all with ± one sigma.";
  const days = found.per_day.filter((each) => each.epsilon !== null);
  if (days.length) {
    const group: Points = {
      label: "day",
      x: days.map((_, k) => k),
      y: days.map((each) => MILLION * each.epsilon!),
      sigma: days.map((each) => scaled(each.epsilon_sigma)),
      colour: "--used",
      shape: "square",
      titles: days.map((each) => `${each.day}, ${each.n} values`),
    };
    const names = days.length <= 10 ? days.map((each) => each.day) : undefined;
    const labels = { x: names ? "" : `day since ${days[0]!.day}`, y: "ε (ppm)" };
    pointsPlot(place("Per day", band), [group], labels, { levels, names, spanX: [-0.5, days.length - 0.5] }, signal);
  }
  const angles: [key: "local_time_h" | "longitude_deg", title: string, label: string, full: number][] = [
    ["local_time_h", "By local time", "local time (h)", 24],
    ["longitude_deg", "By longitude", "longitude (° E)", 360],
  ];
  for (const [key, title, label, full] of angles) {
    const groups = groupsOf(found[key]);
    if (!groups.length) continue;
    const text = `${band} Squares are means in twelve bins with their standard errors.`;
    pointsPlot(place(title, text), groups, { x: label, y: "ε (ppm)" }, { levels, spanX: [0, full], stepX: full / 6 }, signal);
  }
}

/** Return single values, used and rejected, and the means in bins. */
function groupsOf({ single, bins }: Against): Points[] {
  const part = (used: boolean): Points => {
    const chosen = single.at.map((_, k) => k).filter((k) => single.used[k] === used);
    return {
      label: used ? "used" : "rejected",
      x: chosen.map((k) => single.at[k]!),
      y: chosen.map((k) => MILLION * single.epsilon[k]!),
      sigma: chosen.map((k) => scaled(single.epsilon_sigma[k])),
      colour: used ? "--used" : "--rejected",
      shape: used ? "circle" : "cross",
    };
  };
  const means: Points = {
    label: "mean of a bin",
    x: bins.at,
    y: bins.epsilon.map((each) => MILLION * each),
    sigma: bins.standard_error.map(scaled),
    colour: "--text",
    shape: "square",
  };
  return [part(true), part(false), means].filter((each) => each.x.length);
}

function scaled(sigma: number | null | undefined): number | null {
  return sigma === null || sigma === undefined ? null : MILLION * sigma;
}
