// The audit log: who did what, for administrators.
import { ask, nextOf } from "../../api";
import { element, fill } from "../../dom";
import { moment } from "../../format";
import { hrefOf, type View } from "../../router";
import { table } from "../../table";

interface Entry {
  number: number;
  time: number;
  user: string;
  action: string;
  workspace: string;
  target: string;
  outcome: string;
  address: string;
  details: Record<string, unknown>;
}
const PAGE = 50;

export const audit: View = {
  title: "Audit log",
  async open(root, { query }, signal) {
    const before = query.get("before") ?? "";
    const chosen = { user: query.get("user") ?? "", workspace: query.get("workspace") ?? "" };
    const asked = new URLSearchParams({ ...chosen, limit: String(PAGE), ...(before ? { before } : {}) });
    const answer = await ask(`/audit?${asked}`, { signal });
    const { entries } = (await answer.json()) as { entries: Entry[] };
    const older = new URL(nextOf(answer) ?? "", location.origin).searchParams.get("before");
    const kept = Object.fromEntries(Object.entries(chosen).filter(([, value]) => value));
    fill(
      root,
      element("h1", {}, "Audit log"),
      filters(chosen),
      entries.length ? listed(entries) : element("p", { class: "quiet" }, "No entries."),
      element(
        "nav",
        { class: "row", "aria-label": "Pages" },
        before && element("a", { class: "button", href: hrefOf("", "audit", [], kept) }, "Newest"),
        older && element("a", { class: "button", href: hrefOf("", "audit", [], { ...kept, before: older }) }, "Older"),
      ),
    );
  },
};

function filters(chosen: { user: string; workspace: string }): HTMLElement {
  const user = element("input", { id: "user", value: chosen.user, maxlength: 64, autocomplete: "off" });
  const workspace = element("input", { id: "workspace", value: chosen.workspace, maxlength: 64, autocomplete: "off" });
  const show = (event: Event): void => {
    event.preventDefault();
    const given = { user: user.value.trim(), workspace: workspace.value.trim() };
    location.hash = hrefOf("", "audit", [], Object.fromEntries(Object.entries(given).filter(([, value]) => value)));
  };
  return element(
    "form",
    { class: "row", onsubmit: show },
    element("label", { for: "user" }, "User"),
    user,
    element("label", { for: "workspace" }, "Workspace"),
    workspace,
    element("button", { type: "submit" }, "Show"),
  );
}

function listed(entries: Entry[]): HTMLElement {
  return table<Entry>(
    "Entries of the audit log",
    [
      { title: "Time", cell: (one) => element("span", { class: "number" }, moment(one.time)) },
      { title: "User", cell: (one) => one.user },
      { title: "Action", cell: (one) => short(one.action) },
      { title: "Workspace", cell: (one) => one.workspace },
      { title: "Target", cell: (one) => short(one.target) },
      { title: "Outcome", cell: (one) => one.outcome },
      { title: "From", cell: (one) => short(one.address) },
      {
        title: "Details",
        cell: (one) => element("code", { class: "short" }, detailsOf(one)),
      },
    ],
    entries,
  );
}

/** Return a text that is not broken into lines. */
function short(text: string): HTMLElement {
  return element("span", { class: "short" }, text);
}

function detailsOf({ details }: Entry): string {
  const given = Object.entries(details).filter(([, value]) => value !== "" && value !== null);
  return given.map(([key, value]) => `${key}: ${typeof value === "string" ? value : JSON.stringify(value)}`).join(", ");
}
