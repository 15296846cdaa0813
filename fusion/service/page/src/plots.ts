// Plots of lines with bands, of points with error bars, and of histograms.
import uPlot from "uplot";
import { number } from "./format";
import { onTheme, themed } from "./theme";

type Values = (number | null)[];

export interface Band {
  label: string;
  y: Values;
  /** Half of the width of the band around the line. */
  sigma: Values | null;
  /** A variable of the style sheet. */
  colour: string;
}

export interface Points {
  label: string;
  x: number[];
  y: number[];
  sigma?: Values;
  colour: string;
  shape: "circle" | "cross" | "square";
  /** What stands for each point when it is pointed at. */
  titles?: string[];
}

/** A horizontal line with a band. */
export interface Level {
  y: number;
  sigma: number;
  colour: string;
}

interface Labels {
  x: string;
  y: string;
}

interface PointOptions {
  levels?: Level[];
  /** Values of the axis of x are categories with these names. */
  names?: string[];
  /** Range of the axis of x. */
  spanX?: [number, number];
  /** Distance of the marks of the axis of x. */
  stepX?: number;
  /** Called when a point is clicked. */
  onPick?: (series: number, index: number) => void;
}

const HEIGHT = 260;
const REACH_PX = 12;
const GLYPHS = { circle: "●", cross: "✕", square: "■" };
const MINUS = (values: (number | null)[]): string[] => values.map((value) => value === null ? "" : number(value, 6).replace(/(\.\d*?)0+(?=$|e)/, "$1").replace(/\.(?=$|e)/, ""));

/** Draw lines over x, each with its band of sigma; `onCursor` hears the index under the cursor. */
export function bandPlot(
  root: HTMLElement,
  x: number[],
  bands: Band[],
  labels: Labels,
  onCursor: (index: number | null) => void,
  signal: AbortSignal,
  { logarithmic = false, stepX }: { logarithmic?: boolean; stepX?: number } = {},
): void {
  const data: (number | null)[][] = [x];
  const series: uPlot.Series[] = [{ label: labels.x, value: (_, value) => (value === null ? "–" : number(value, 4)) }];
  const drawn: uPlot.Band[] = [];
  for (const [order, { label, y, sigma, colour }] of bands.entries()) {
    data.push(y);
    const shown = (at: number | null): string => {
      if (at === null || at === undefined) return "–";
      const spread = sigma?.[at];
      return `${number(y[at], 4)}${spread ? ` ± ${number(spread, 2)}` : ""}`;
    };
    series.push({
      label, stroke: () => themed(colour), width: 1.8, dash: order ? [8, 4] : undefined, spanGaps: false, points: { show: false }, value: (_, __, ___, at) => shown(at),
    });
    if (!sigma) continue;
    const k = data.length;
    const edge = (sign: number): Values => y.map((value, at) => (value === null || sigma[at] === null ? null : value + sign * sigma[at]!));
    data.push(edge(1), edge(-1));
    for (let edges = 0; edges < 2; edges++) {
      series.push({ class: "edge", stroke: () => themed(colour, 0.33), width: 1, points: { show: false } });
    }
    drawn.push({ series: [k, k + 1], fill: () => themed(colour, 0.2) });
  }
  make(root, data as uPlot.AlignedData, {
    series,
    bands: drawn,
    axes: axes(labels, undefined, stepX ? steps([x[0]!, x.at(-1)!], stepX) : undefined),
    scales: { x: { time: false }, y: { distr: logarithmic ? 3 : 1 } },
    hooks: { setCursor: [(plot) => onCursor(plot.cursor.idx ?? null)] },
  }, signal);
}

/** Draw groups of points with error bars; those of different groups differ in shape and colour. */
export function pointsPlot(root: HTMLElement, groups: Points[], labels: Labels, options: PointOptions, signal: AbortSignal): void {
  const { levels = [], names, spanX, stepX, onPick } = options;
  const series: uPlot.Series[] = [{}, ...groups.map((group, k) => ({
    label: `${GLYPHS[group.shape]} ${group.label}`,
    class: `ink${group.colour}`,
    stroke: () => themed(group.colour),
    facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }],
    paths: (plot: uPlot) => {
      drawPoints(plot, group, k === 0 ? levels : []);
      return null;
    },
  }))];
  const made: Partial<uPlot.Options> = {
    mode: 2,
    series,
    legend: { show: true, live: false, markers: { show: false } },
    axes: axes(labels, names, spanX && stepX ? steps(spanX, stepX) : undefined),
    scales: {
      x: { time: false, range: () => spanX ?? spanOf(groups.flatMap((each) => each.x)) },
      y: { range: () => spanOf([...groups.flatMap(edges), ...levels.flatMap(({ y, sigma }) => [y - sigma, y + sigma])]) },
    },
    cursor: { points: { show: false }, drag: { setScale: false } },
  };
  const data = [null, ...groups.map(({ x, y }) => [x, y])] as unknown as uPlot.AlignedData;
  const plot = make(root, data, made, signal);
  const note = document.createElement("p");
  note.className = "quiet pointed";
  note.textContent = onPick ? "Point at a mark for its name; click opens its map." : "Point at a mark for its values.";
  root.append(note);
  const found = (event: MouseEvent): [number, number] | null => nearest(plot, groups, event);
  plot.over.addEventListener("mousemove", (event) => {
    const at = found(event);
    plot.over.style.cursor = at && onPick ? "pointer" : "";
    if (at) note.textContent = described(groups[at[0]]!, at[1], labels);
  }, { signal });
  plot.over.addEventListener("click", (event) => {
    const at = found(event);
    if (at) onPick?.(...at);
  }, { signal });
}

/** Draw how many of the values lie in each of equal steps. */
export function histogram(root: HTMLElement, values: number[], label: string, colour: string, signal: AbortSignal): void {
  const known = values.filter(Number.isFinite);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const count = Math.max(5, Math.min(40, Math.ceil(Math.sqrt(known.length)) * 2));
  const step = (high - low) / count || 1;
  const numbers = new Array<number>(count).fill(0);
  for (const value of known) numbers[Math.min(count - 1, Math.floor((value - low) / step))]! += 1;
  const middles = numbers.map((_, k) => low + (k + 0.5) * step);
  const bars = uPlot.paths.bars!({ size: [0.94, 100] });
  make(root, [middles, numbers], {
    series: [{ label, value: (_, value) => number(value, 4) }, { label: "number", stroke: () => themed(colour), fill: () => themed(colour, 0.53), paths: bars, points: { show: false } }],
    axes: axes({ x: label, y: "number" }),
    scales: { x: { time: false, range: () => [low - 0.5 * step, high + 0.5 * step] }, y: { range: (_, __, most) => [0, most * 1.05 || 1] } },
    legend: { show: false },
  }, signal);
}

/** Make a plot as wide as its place, drawn again when size or theme change, until the signal aborts. */
function make(root: HTMLElement, data: uPlot.AlignedData, options: Partial<uPlot.Options>, signal: AbortSignal): uPlot {
  const height = Number(root.dataset.height ?? HEIGHT);
  const plot = new uPlot({ width: Math.max(200, root.clientWidth), height, ...options } as uPlot.Options, data, root);
  const sizes = new ResizeObserver(() => plot.setSize({ width: Math.max(200, root.clientWidth), height }));
  sizes.observe(root);
  onTheme(() => plot.redraw(false, true), signal);
  signal.addEventListener("abort", () => {
    sizes.disconnect();
    plot.destroy();
  });
  return plot;
}

function steps([low, high]: [number, number], step: number): number[] {
  return Array.from({ length: Math.floor((high - low) / step + 1e-9) + 1 }, (_, k) => low + k * step);
}

function axes(labels: Labels, names?: string[], splits?: number[]): uPlot.Axis[] {
  const shared = {
    stroke: () => themed("--text"),
    grid: { stroke: () => themed("--line"), width: 1 },
    ticks: { stroke: () => themed("--line"), width: 1 },
    font: "12px sans-serif",
    labelFont: "13px sans-serif",
  };
  const named = names && {
    splits: () => names.map((_, k) => k),
    values: (_: uPlot, at: number[]) => at.map((each) => names[each] ?? ""),
  };
  return [
    { ...shared, label: labels.x, size: 32, labelSize: 22, labelGap: 0, values: (_: uPlot, at: number[]) => MINUS(at), ...(splits && { splits: () => splits }), ...named } as uPlot.Axis,
    { ...shared, label: labels.y, size: 66, values: (_: uPlot, at: number[]) => MINUS(at) },
  ];
}

function edges({ y, sigma }: Points): number[] {
  return y.flatMap((value, k) => [value - (sigma?.[k] ?? 0), value + (sigma?.[k] ?? 0)]);
}

function spanOf(values: number[]): [number, number] {
  const known = values.filter(Number.isFinite);
  if (!known.length) return [0, 1];
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const more = 0.06 * (high - low) || Math.abs(high) * 0.1 || 0.5;
  return [low - more, high + more];
}

function drawPoints(plot: uPlot, group: Points, levels: Level[]): void {
  const { ctx } = plot;
  const unit = devicePixelRatio;
  const place = (x: number, y: number): [number, number] => [plot.valToPos(x, "x", true), plot.valToPos(y, "y", true)];
  const { left, top, width, height } = plot.bbox;
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, width, height);
  ctx.clip();
  for (const { y, sigma, colour } of levels) {
    const [high, middle, low] = [y + sigma, y, y - sigma].map((each) => plot.valToPos(each, "y", true)) as [number, number, number];
    ctx.fillStyle = themed(colour, 0.18);
    ctx.fillRect(left, high, width, low - high);
    ctx.fillStyle = themed(colour);
    ctx.fillRect(left, middle - unit / 2, width, unit);
  }
  ctx.strokeStyle = themed(group.colour);
  ctx.fillStyle = themed(group.colour, 0.67);
  ctx.lineWidth = 1.4 * unit;
  group.x.forEach((value, k) => {
    const [x, y] = place(value, group.y[k]!);
    const sigma = group.sigma?.[k];
    if (sigma) {
      const [, high] = place(value, group.y[k]! + sigma);
      const [, low] = place(value, group.y[k]! - sigma);
      ctx.beginPath();
      for (const end of [high, low]) {
        ctx.moveTo(x - 3 * unit, end);
        ctx.lineTo(x + 3 * unit, end);
      }
      ctx.moveTo(x, high);
      ctx.lineTo(x, low);
      ctx.stroke();
    }
    mark(ctx, group.shape, x, y, 4 * unit);
  });
  ctx.restore();
}

function mark(ctx: CanvasRenderingContext2D, shape: Points["shape"], x: number, y: number, size: number): void {
  ctx.beginPath();
  if (shape === "cross") {
    ctx.moveTo(x - size, y - size);
    ctx.lineTo(x + size, y + size);
    ctx.moveTo(x - size, y + size);
    ctx.lineTo(x + size, y - size);
  } else if (shape === "square") ctx.rect(x - size, y - size, 2 * size, 2 * size);
  else ctx.arc(x, y, 0.8 * size, 0, 2 * Math.PI);
  if (shape !== "cross") ctx.fill();
  ctx.stroke();
}

function nearest(plot: uPlot, groups: Points[], event: MouseEvent): [number, number] | null {
  const box = plot.over.getBoundingClientRect();
  const [left, top] = [event.clientX - box.left, event.clientY - box.top];
  let best: [number, number] | null = null;
  let least = REACH_PX;
  groups.forEach((group, series) =>
    group.x.forEach((x, k) => {
      const away = Math.hypot(plot.valToPos(x, "x") - left, plot.valToPos(group.y[k]!, "y") - top);
      if (away < least) [best, least] = [[series, k], away];
    }),
  );
  return best;
}

function described(group: Points, index: number, labels: Labels): string {
  const sigma = group.sigma?.[index];
  const parts = [
    group.titles?.[index],
    `${labels.x}: ${number(group.x[index], 4)}`,
    `${labels.y}: ${number(group.y[index], 4)}${sigma ? ` ± ${number(sigma, 2)}` : ""}`,
    group.label,
  ];
  return parts.filter(Boolean).join("  ·  ");
}
