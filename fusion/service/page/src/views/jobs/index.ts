// Jobs: their list, one of them with its log, a new run, forms of other jobs, uploads and outputs.
import { element } from "../../dom";
import type { View } from "../../router";
import { showForm, showKinds } from "./form";
import { showJob } from "./job";
import { showJobs } from "./list";
import { showOutputs } from "./outputs";
import { showSubmission } from "./submission";
import { showUploads } from "./uploads";

export const jobs: View = {
  title: "Jobs",
  async open(root, route, signal) {
    const [what = "", kind = ""] = route.path;
    if (what === "") await showJobs(root, route, signal);
    else if (what === "new" && kind === "others") await showKinds(root, route, signal);
    else if (what === "new" && kind && kind !== "run") await showForm(root, route, kind, signal);
    else if (what === "outputs") await showOutputs(root, route, signal);
    else if (what === "new") await showSubmission(root, route, signal);
    else if (what === "uploads") await showUploads(root, route, signal);
    else await showJob(root, route, what, signal);
    root.querySelector("h1")?.after(
      element("p", { class: "reader-only", role: "note" }, `This token may read ${route.workspace}, not run jobs in it: ask the administrator for one with the scope run.`),
    );
  },
};
