// Files to keep: a plain link where the browser may ask itself, else fetched with the token.
import { ApiProblem, getBlob, token } from "./api";
import { element } from "./dom";

/** Return a link that saves a file of the interface; `accept` names its form. */
export function downloadLink(path: string, name: string, title: string, accept = ""): HTMLElement {
  const link = element("a", { href: `/api/v1${path}`, download: name }, title);
  link.addEventListener("click", (event) => {
    if (!token() && !accept) return;
    event.preventDefault();
    void save(path, name, accept).catch((error: unknown) => {
      const notice = document.getElementById("notice")!;
      notice.textContent = error instanceof ApiProblem ? error.line : String(error);
    });
  });
  return link;
}

/** Return the path of a file of a workspace. */
export function filePath(workspace: string, file: string): string {
  return `/workspaces/${encodeURIComponent(workspace)}/files/${file.split("/").map(encodeURIComponent).join("/")}`;
}

async function save(path: string, name: string, accept: string): Promise<void> {
  const address = URL.createObjectURL(await getBlob(path, accept ? { headers: { Accept: accept } } : {}));
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}
