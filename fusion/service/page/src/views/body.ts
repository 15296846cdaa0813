// The body in three dimensions.
import { fill } from "../dom";
import type { View } from "../router";

export const body: View = {
  title: "Body",
  async open(root) {
    fill(root, "The body");
  },
};
