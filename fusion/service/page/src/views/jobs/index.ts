// Jobs: their list, one of them with its log, a new run, and uploads.
import type { View } from "../../router";
import { showJob } from "./job";
import { showJobs } from "./list";
import { showSubmission } from "./submission";
import { showUploads } from "./uploads";

export const jobs: View = {
  title: "Jobs",
  async open(root, route, signal) {
    const [what = ""] = route.path;
    if (what === "") await showJobs(root, route, signal);
    else if (what === "new") await showSubmission(root, route, signal);
    else if (what === "uploads") await showUploads(root, route, signal);
    else await showJob(root, route, what, signal);
  },
};
