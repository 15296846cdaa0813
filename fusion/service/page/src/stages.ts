// The stages of a workspace in the order in which they run, and words for states.
import { element } from "./dom";

const ORDER = ["ingest", "mapolas", "register", "fuse", "bigmap", "scale", "release", "report"];

const TONES: Record<string, string> = {
  "up to date": "good",
  accepted: "good",
  finished: "good",
  running: "busy",
  waiting: "quiet",
  failed: "bad",
  rejected: "bad",
  cancelled: "quiet",
  note: "quiet",
  "in use": "busy",
  complete: "good",
  valid: "good",
  expired: "quiet",
  revoked: "quiet",
  open: "busy",
  converged: "good",
  diverged: "bad",
  contradicts: "bad",
  "sun-reversed": "bad",
};

/** Return names of stages in the order in which they run; unknown ones at the end. */
export function inOrder(names: string[]): string[] {
  const place = (name: string): number => (ORDER.indexOf(name) + ORDER.length + 1) % (ORDER.length + 1);
  return [...names].sort((a, b) => place(a) - place(b));
}

/** Return a state as a word with its tone; the word alone says all. */
export function state(word: string): HTMLElement {
  // A long reason may be cut where there is little room.
  return element("span", { class: `state ${TONES[word] ?? "warn"}`, title: word.length > 40 ? word : undefined }, word);
}
