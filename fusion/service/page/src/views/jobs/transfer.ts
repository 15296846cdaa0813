// Files on their way to the service: one line with a bar for each.
import { element, fill } from "../../dom";
import { bytes } from "../../format";
import { sendFile, type Target, type Upload } from "./sending";
import { problem } from "./submission";

/** Send a file with its progress in a list; null if that failed, which the list shows. */
export async function transfer(target: Target, file: File, kind: string, steps: HTMLElement): Promise<Upload | null> {
  const bar = element("progress", { max: 1, value: 0, "aria-label": `Transfer of ${file.name}` });
  const what = element("span", { class: "quiet" });
  const line = element("li", {}, `${file.name}, ${bytes(file.size)} `, bar, " ", what);
  steps.append(line);
  try {
    const sent = await sendFile(target, file, kind, (step, share) => {
      bar.value = share;
      what.textContent = `${step} ${Math.round(share * 100)} %`;
    });
    what.textContent = "complete";
    return sent;
  } catch (error) {
    if (!target.signal.aborted) fill(line, `${file.name} `, problem(error));
    return null;
  }
}
