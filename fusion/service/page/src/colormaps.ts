// Colour maps that read the same for colour-blind people: order by lightness, or two hues about zero.

export type Rgb = [number, number, number];

const ANCHORS = {
  viridis:
    "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725",
  cividis:
    "00224e 002e6a 1a386f 32436d 434e6c 535a6d 61656f 6f7073 7d7c78 8c8878 9b9476 aba072 bcae6c cdbb63 dec958 f0d846 fee838",
  grey: "000000 ffffff",
  // Blue below zero, brown above, white at zero.
  diverging: "001261 02467c 1f6f9a 68a1bf b5cfdc f4f2ee ddc2ac c88f6b ad5e2d 87290a 590008",
  // As residuals are drawn by the service.
  redblue: "053061 2166ac 4393c3 92c5de d1e5f0 f7f7f7 fddbc7 f4a582 d6604d b2182b 67001f",
} as const;

export type ColormapName = keyof typeof ANCHORS;

const TABLES = new Map<ColormapName, Rgb[]>();

/** Return the 256 colours of a map, components 0 … 255. */
export function colours(name: ColormapName): Rgb[] {
  let table = TABLES.get(name);
  if (!table) {
    const anchors = ANCHORS[name].split(" ").map(rgbOf);
    table = Array.from({ length: 256 }, (_, k) => mixed(anchors, k / 255));
    TABLES.set(name, table);
  }
  return table;
}

/** Return the colour of a value between two limits; null where it is unknown. */
export function colourOf(name: ColormapName, value: number, low: number, high: number): Rgb | null {
  if (!Number.isFinite(value) || !(high > low)) return null;
  const share = Math.min(1, Math.max(0, (value - low) / (high - low)));
  return colours(name)[Math.round(share * 255)]!;
}

/** Return a CSS colour. */
export function css([red, green, blue]: Rgb): string {
  return `rgb(${red} ${green} ${blue})`;
}

/** Return a legend: the colours between the texts of both limits, and what they mean. */
export function legend(name: ColormapName, low: string, high: string, title: string): HTMLElement {
  return legendOf(colours(name), low, high, title);
}

/** Return a legend of given colours. */
export function legendOf(table: Rgb[], low: string, high: string, title: string): HTMLElement {
  const bar = document.createElement("canvas");
  bar.width = table.length;
  bar.height = 1;
  const context = bar.getContext("2d")!;
  table.forEach((colour, k) => {
    context.fillStyle = css(colour);
    context.fillRect(k, 0, 1, 1);
  });
  const made = document.createElement("figure");
  made.className = "legend";
  const caption = document.createElement("figcaption");
  caption.textContent = title;
  const first = document.createElement("span");
  first.textContent = low;
  const last = document.createElement("span");
  last.textContent = high;
  bar.setAttribute("role", "img");
  bar.setAttribute("aria-label", `${title}: colours from ${low} to ${high}`);
  made.append(caption, first, bar, last);
  return made;
}

function rgbOf(hex: string): Rgb {
  return [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)) as Rgb;
}

function mixed(anchors: Rgb[], share: number): Rgb {
  const at = share * (anchors.length - 1);
  const first = Math.min(Math.floor(at), anchors.length - 2);
  const [one, two] = [anchors[first]!, anchors[first + 1]!];
  return one.map((value, k) => Math.round(value + (two[k]! - value) * (at - first))) as Rgb;
}
