// Makes of the service's mesh what is drawn, away from the page's thread.
import { meshOf } from "./mesh";

addEventListener("message", (event: MessageEvent<ArrayBuffer>) => {
  const made = meshOf(event.data);
  const parts = [made.positions, made.normals, made.faces, ...made.coarse, made.radii];
  postMessage(made, { transfer: parts.map((each) => each.buffer) });
});
