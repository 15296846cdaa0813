// How finely the body is drawn while it turns: as finely as frames are fast enough.

/** A way of drawing. */
export interface Detail {
  /** Which mesh: 0 the whole one, then ever coarser ones. */
  mesh: number;
  /** Share of the screen's pixels along a side. */
  ratio: number;
}

/** From fine to coarse. The first one is drawn with smooth edges. */
export const DETAILS: readonly Detail[] = [
  { mesh: 0, ratio: 1 },
  { mesh: 1, ratio: 1 },
  { mesh: 1, ratio: 0.5 },
  { mesh: 2, ratio: 0.5 },
  { mesh: 2, ratio: 0.35 },
];

// 33 ms are 30 frames a second; what shows a frame needs some of it, too.
const MOST_MS = 25;
const FADING = 0.8;

export class DetailChoice {
  /** Index of what is drawn while turning. Until frames have been timed it is a coarse one. */
  at = 2;
  private readonly costs = DETAILS.map(() => Number.NaN);

  /** Take note of the milliseconds of a frame; returns whether another detail is better. */
  note(detail: number, cost: number): boolean {
    const before = this.costs[detail]!;
    // The first frames of a mesh hand it over, too: what it takes is the least so far.
    this.costs[detail] = Number.isNaN(before) ? cost : detail === 0 ? Math.min(before, cost) : (before + cost) / 2;
    const former = this.at;
    if (detail === this.at && this.costs[detail] > MOST_MS) this.at = Math.min(this.at + 1, DETAILS.length - 1);
    else if (detail <= this.at && this.costs[detail] < MOST_MS / 2) this.at = this.finer(detail);
    return this.at !== former;
  }

  /** Look again, later, at details that were too slow: the machine may have been busy. */
  fade(): void {
    for (let k = 1; k < this.at; k++) this.costs[k]! *= FADING;
  }

  /** Return the detail before a fast one unless that is known to be slow. */
  private finer(detail: number): number {
    const next = detail - 1;
    return next >= 0 && !(this.costs[next]! > MOST_MS) ? next : detail;
  }
}
