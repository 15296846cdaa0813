// What the service knows of maplets solved from images.

export interface Outliers {
  code: string;
  names: string[];
  do: string;
}

/** How the images of a maplet fit, or an image its maplets. */
export interface Goodness {
  name: string;
  residual: number | null;
  noise_ratio: number | null;
  correlation: number | null;
  shift_px: number | null;
  shift_m: number | null;
  used: number;
  not_seen: number;
  contradicts: number;
  sun_reversed: number;
  codes: string[];
}

export interface GoodnessOfMaplet extends Goodness {
  outcome: string;
  residual_start: number | null;
  sigma_m: number | null;
  height_m: number | null;
  albedo: number | null;
}

export interface SolvedIndex {
  solution: string;
  outcomes: Record<string, number>;
  residual_start: number | null;
  residual: number | null;
  shift_m: number | null;
  options: { photometry: string; other_photometry?: Record<string, number> | null };
  photometry_ratios?: Record<string, number | null> | null;
  findings: Outliers[];
  maplets: GoodnessOfMaplet[];
  images: Goodness[];
}

export interface SolvedImage {
  name: string;
  fit: string;
  shift_px: (number | null)[];
  residual: number | null;
  noise: number | null;
  correlation: number | null;
  pixels: number;
  pixel_m: number | null;
}

export interface SolvedConstraint {
  name: string;
  heights: number;
  left_out: number;
  residual_m: number | null;
  ratio: number | null;
}

export interface SolvedMaplet {
  solution: string;
  name: string;
  outcome: string;
  reason: string;
  residual_start: number | null;
  residual: number | null;
  noise_ratio: number | null;
  correlation: number | null;
  shift_px: number | null;
  shift_m: number | null;
  sigma_m: number | null;
  slope_sigma?: number | null;
  albedo_sigma?: number | null;
  directions: number[];
  undetermined_azimuth_deg?: number | null;
  around?: string[] | null;
  light_ratio: number | null;
  shift_ratio: number | null;
  gsd_m: number;
  rounds: { gsd_m: number; residual: number | null; height_m: number | null; albedo: number }[];
  images: SolvedImage[];
  constraints: SolvedConstraint[];
  findings: Outliers[];
  residual_limit: number;
}

/** Return the residual of an image over its noise. */
export function noiseRatio({ residual, noise }: SolvedImage): number | null {
  return residual !== null && noise ? residual / noise : null;
}

/** Return how far an image is shifted, pixels. */
export function shiftOf({ shift_px: [sample, line] }: SolvedImage): number | null {
  return typeof sample === "number" && typeof line === "number" ? Math.hypot(sample, line) : null;
}
