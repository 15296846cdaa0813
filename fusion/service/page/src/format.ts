// Numbers as people read them: with units, and "unknown" where there is none.

export const UNKNOWN = "unknown";
type Value = number | null | undefined;

const known = (value: Value): value is number => typeof value === "number" && Number.isFinite(value);
const minus = (text: string): string => text.replace(/^-/, "−").replace(/e-/, "e−");

/** Return a number with so many significant digits. */
export function number(value: Value, digits = 4): string {
  if (!known(value)) return UNKNOWN;
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return minus(value.toExponential(digits - 1));
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return minus(value.toFixed(Math.min(decimals, 12)));
}

/** Return a number with its unit. */
export function quantity(value: Value, unit: string, digits = 4): string {
  return known(value) ? `${number(value, digits)} ${unit}` : UNKNOWN;
}

/** Return a length in µm, mm, m or km. */
export function metres(value: Value, digits = 3): string {
  if (!known(value)) return UNKNOWN;
  const size = Math.abs(value);
  if (size >= 10_000) return quantity(value / 1000, "km", digits);
  if (size < 1e-4 && size > 0) return quantity(value * 1e6, "µm", digits);
  if (size < 0.1 && size > 0) return quantity(value * 1000, "mm", digits);
  return quantity(value, "m", digits);
}

/** Return "value ± sigma unit", the value rounded where its sigma has two digits. */
export function withSigma(value: Value, sigma: Value, unit = ""): string {
  if (!known(value)) return UNKNOWN;
  const tail = unit ? ` ${unit}` : "";
  if (!known(sigma) || sigma <= 0) return `${number(value)}${tail}`;
  const decimals = Math.min(12, Math.max(0, 1 - Math.floor(Math.log10(sigma))));
  return `${minus(value.toFixed(decimals))} ± ${sigma.toFixed(decimals)}${tail}`;
}

/** Return a ratio near zero, such as ε, in parts per million with its sigma. */
export function partsPerMillion(value: Value, sigma?: Value): string {
  return known(value) ? withSigma(value * 1e6, known(sigma) ? sigma * 1e6 : undefined, "ppm") : UNKNOWN;
}

/** Return a number with so many decimals, as columns have it whose title has the unit. */
export function fixed(value: Value, decimals: number): string {
  return known(value) ? minus(value.toFixed(decimals)) : UNKNOWN;
}

/** Return an angle in degrees. */
export function degrees(value: Value, decimals = 2): string {
  return known(value) ? `${minus(value.toFixed(decimals))}°` : UNKNOWN;
}

/** Return a count with thin spaces between thousands. */
export function count(value: Value): string {
  return known(value) ? minus(Math.round(value).toString()).replace(/\B(?=(\d{3})+$)/g, "\u202f") : UNKNOWN;
}

/** Return a size of a file or of memory. */
export function bytes(value: Value): string {
  if (!known(value)) return UNKNOWN;
  const units = ["B", "kB", "MB", "GB", "TB"];
  let size = value;
  let k = 0;
  for (; size >= 999.5 && k < units.length - 1; k++) size /= 1000;
  return `${k ? number(size, 3) : size} ${units[k]}`;
}

/** Return a time span. */
export function duration(seconds: Value): string {
  if (!known(seconds)) return UNKNOWN;
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  const all = Math.round(seconds);
  if (all < 60) return `${all} s`;
  if (all < 3600) return `${Math.floor(all / 60)} min ${all % 60} s`;
  if (all < 172_800) return `${Math.floor(all / 3600)} h ${Math.floor((all % 3600) / 60)} min`;
  return `${(all / 86_400).toFixed(1)} d`;
}

/** Return a moment (seconds since 1970, or ISO text) in UTC. */
export function moment(value: number | string | null | undefined): string {
  if (value === null || value === undefined || value === "") return UNKNOWN;
  const date = new Date(typeof value === "number" ? value * 1000 : value);
  if (Number.isNaN(date.getTime())) return UNKNOWN;
  return `${date.toISOString().slice(0, 19).replace("T", " ")} UTC`;
}
