// Maps of surfaces.
import { fill } from "../dom";
import type { View } from "../router";

export const map: View = {
  title: "Maps",
  async open(root) {
    fill(root, "Maps");
  },
};
