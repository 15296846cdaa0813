// All views by their names. Those with large libraries load when they are opened.
import type { View } from "../router";
import { audit } from "./admin/audit";
import { tokens } from "./admin/tokens";
import { jobs } from "./jobs/index";
import { overview } from "./overview/index";
import { products } from "./products";
import { runs } from "./runs";
import { solutions } from "./solutions";
import { workspaces } from "./workspaces";

const here = (view: View) => () => Promise.resolve(view);

export const VIEWS: Record<string, () => Promise<View>> = {
  workspaces: here(workspaces),
  tokens: here(tokens),
  audit: here(audit),
  overview: here(overview),
  body: async () => (await import("./body")).body,
  map: async () => (await import("./map")).map,
  photoclinometry: async () => (await import("./photoclinometry")).photoclinometry,
  registration: async () => (await import("./registration")).registration,
  scale: async () => (await import("./scale")).scale,
  solutions: here(solutions),
  jobs: here(jobs),
  products: here(products),
  runs: here(runs),
};

/** What the navigation of a workspace shows, in its order. */
export const NAVIGATION: [view: string, title: string][] = [
  ["overview", "Overview"],
  ["body", "Body"],
  ["map", "Maps"],
  ["photoclinometry", "Photoclinometry"],
  ["registration", "Registration"],
  ["scale", "Scale"],
  ["solutions", "Solutions"],
  ["jobs", "Jobs"],
  ["products", "Products"],
  ["runs", "Runs"],
];

/** What the navigation of the whole service shows to administrators. */
export const ADMINISTRATION: [view: string, title: string][] = [
  ["workspaces", "Workspaces"],
  ["tokens", "Tokens"],
  ["audit", "Audit log"],
];
