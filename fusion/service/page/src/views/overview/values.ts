// What the service answers about a workspace.

export interface Finding {
  stage: string;
  code: string;
  severity: string;
  text: string;
}

export interface Overview {
  name: string;
  body: string;
  solution: string;
  shape: string | null;
  scans: number;
  returns: number;
  images: number;
  landmarks: number;
  maplets: number;
  mapolas: number;
  fused: number;
  bigmaps: number;
  pairs: number;
  released: number;
  stages: Record<string, string>;
  finished: Record<string, string>;
  verdicts: Record<string, string>;
  findings: Finding[];
  problems: string[];
  images_not_used: Record<string, unknown>;
  results: {
    registration: {
      model: string;
      scale: number | null;
      scale_sigma: number | null;
      n_used: number;
      n_rejected: number;
      verdict: string | null;
    } | null;
    scale: {
      epsilon: number | null;
      epsilon_sigma: number | null;
      size_correction_m: number | null;
      size_correction_sigma_m: number | null;
      n_used: number;
      n_rejected: number;
      verdict: string | null;
    } | null;
  };
}

export interface Footprints {
  name: string[];
  longitude_deg: number[];
  latitude_deg: number[];
  radius_m: number[];
  side_m: number[];
  gsd_m: number[];
}

export interface Coverage {
  maplets: Footprints;
  mapolas: Footprints;
  fused: Footprints;
  bigmaps: Footprints;
  images: { name: string[]; longitude_deg: number[]; latitude_deg: number[]; distance_m: number[]; all: number };
  returns: { step_deg: number; returns: number; counted: number; density_per_m2: number[][] };
}
