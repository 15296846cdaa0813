// All views by their names. Those with large libraries load when they are opened.
import type { View } from "../router";

export const VIEWS: Record<string, () => Promise<View>> = {
  body: async () => (await import("./body")).body,
  map: async () => (await import("./map")).map,
};

/** What the navigation of a workspace shows, in its order. */
export const NAVIGATION: [view: string, title: string][] = [
  ["body", "Body"],
  ["map", "Maps"],
];
