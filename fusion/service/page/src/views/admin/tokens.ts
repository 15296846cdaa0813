// Tokens of the service: who may do what, for administrators.
import { getAll, send } from "../../api";
import { element, fill } from "../../dom";
import { moment } from "../../format";
import type { View } from "../../router";
import { state } from "../../stages";
import { table } from "../../table";
import { problem } from "../jobs/submission";

interface Token {
  id: string;
  user: string;
  name: string;
  scopes: Record<string, string>;
  created: number;
  expires: number | null;
  revoked: number | null;
  last_used: number | null;
}

const SCOPES = ["read", "run", "admin"];
const DAYS = 90;

export const tokens: View = {
  title: "Tokens",
  async open(root, _route, signal) {
    const workspaces = (await getAll<{ name: string }>("/workspaces", "workspaces", { signal })).map((one) => one.name);
    const place = element("section", { "aria-labelledby": "made" });
    const answer = element("div", { "aria-live": "polite" });
    fill(root, element("h1", {}, "Tokens"), newToken(workspaces, make), answer, element("h2", { id: "made" }, "Made"), place);
    await refresh();

    async function refresh(): Promise<void> {
      const found = await getAll<Token>("/tokens", "tokens", { signal });
      fill(place, found.length ? listed(found, (token) => void revoke(token)) : element("p", { class: "quiet" }, "No tokens yet."));
    }

    async function make(body: unknown): Promise<boolean> {
      try {
        const made = await send<Token & { secret: string }>("POST", "/tokens", body, { signal });
        fill(answer, secretOf(made));
        await refresh();
        return true;
      } catch (error) {
        if (!signal.aborted) fill(answer, problem(error));
        return false;
      }
    }

    async function revoke(token: Token): Promise<void> {
      if (!window.confirm(`Revoke the token of ${token.user}${token.name ? ` (${token.name})` : ""}? It cannot be used again.`)) return;
      try {
        await send("DELETE", `/tokens/${encodeURIComponent(token.id)}`, undefined, { signal });
        fill(answer, element("p", {}, `The token ${token.id} of ${token.user} is revoked.`));
        await refresh();
      } catch (error) {
        if (!signal.aborted) fill(answer, problem(error));
      }
    }
  },
};

function listed(found: Token[], revoke: (token: Token) => void): HTMLElement {
  const time = (value: number | null): HTMLElement => element("span", { class: "number" }, value === null ? "never" : moment(value));
  return table<Token>(
    "Tokens",
    [
      { title: "User", by: (one) => one.user, cell: (one) => one.user },
      { title: "What for", by: (one) => one.name, cell: (one) => one.name },
      { title: "May", cell: (one) => element("span", {}, ...Object.entries(one.scopes).flatMap(([where, scope], k) => [k > 0 && ", ", element("span", { class: "short" }, `${scope} in ${where === "*" ? "all" : where}`)])) },
      { title: "State", by: stateOf, cell: (one) => state(stateOf(one)) },
      { title: "Made", by: (one) => one.created, cell: (one) => time(one.created) },
      { title: "Expires", by: (one) => one.expires, cell: (one) => time(one.expires) },
      { title: "Last used", by: (one) => one.last_used, cell: (one) => time(one.last_used) },
      { title: "Id", cell: (one) => element("span", { class: "mono short" }, one.id) },
      {
        title: "Revoke",
        cell: (one) =>
          stateOf(one) === "valid" &&
          element("button", { type: "button", class: "small", "aria-label": `Revoke ${one.id} of ${one.user}`, onclick: () => revoke(one) }, "Revoke"),
      },
    ],
    found,
  );
}

function stateOf(token: Token): string {
  if (token.revoked !== null) return "revoked";
  return token.expires !== null && token.expires < Date.now() / 1000 ? "expired" : "valid";
}

/** Return the form of a new token. */
function newToken(workspaces: string[], make: (body: unknown) => Promise<boolean>): HTMLElement {
  const user = element("input", { id: "user", required: true, maxlength: 64, autocomplete: "off" });
  const name = element("input", { id: "purpose", maxlength: 64, size: 30, autocomplete: "off" });
  const days = element("input", { id: "days", type: "number", min: 1, max: 36500, step: 1, value: DAYS });
  const places = ["*", ...workspaces];
  const scopes = places.map((place, k) => ({
    place,
    select: element(
      "select",
      { "aria-label": place === "*" ? "Scope in all workspaces" : `Scope in ${place}`, id: `scope-${k}` },
      element("option", { value: "" }, "nothing"),
      ...SCOPES.map((one) => element("option", { value: one }, one)),
    ),
  }));
  scopes.forEach(({ select }) => select.addEventListener("change", check));
  check();

  function check(): void {
    // A browser shows it at the first choice when the form is sent.
    const any = scopes.some(({ select }) => select.value);
    scopes[0]!.select.setCustomValidity(any ? "" : "Choose what the token permits in at least one workspace.");
  }

  async function submit(event: Event): Promise<void> {
    event.preventDefault();
    const chosen = scopes.filter(({ select }) => select.value).map(({ place, select }) => [place, select.value]);
    const body = { user: user.value.trim(), name: name.value.trim(), scopes: Object.fromEntries(chosen), days: days.value ? Number(days.value) : null };
    if (!(await make(body))) return;
    user.value = name.value = "";
    scopes.forEach(({ select }) => (select.value = ""));
    check();
  }

  const line = (title: string, input: HTMLElement): HTMLElement => element("div", { class: "field" }, element("label", { for: input.id }, title), input);
  return element(
    "details",
    { class: "below" },
    element("summary", {}, "New token"),
    element(
      "form",
      { class: "form", onsubmit: (event: Event) => void submit(event) },
      line("User, in whose name it acts", user),
      line("What it is for", name),
      line("Days until it expires (empty: never)", days),
      element(
        "fieldset",
        {},
        element("legend", {}, "What it permits"),
        element("p", { class: "help" }, "read: look and download; run: uploads and jobs too; admin: all of that, and in all workspaces tokens and the audit log."),
        element(
          "div",
          { class: "boxes", role: "group", "aria-label": "Scopes by workspace", tabindex: places.length > 6 ? 0 : undefined },
          ...scopes.map(({ place, select }) => element("label", {}, select, place === "*" ? "in all workspaces" : `in ${place}`)),
        ),
      ),
      element("div", { class: "row" }, element("button", { type: "submit", class: "main" }, "Make the token")),
    ),
  );
}

/** Return the secret of a new token, which is shown this once. */
function secretOf(made: Token & { secret: string }): HTMLElement {
  const field = element("input", { id: "secret", class: "mono", readonly: true, value: made.secret, size: 50, "aria-describedby": "once" });
  const done = element("span", { role: "status" });
  const copy = async (): Promise<void> => {
    try {
      await navigator.clipboard.writeText(made.secret);
      done.textContent = "copied";
    } catch {
      // Browsers permit it over HTTPS and on this machine only.
      field.select();
      done.textContent = "selected: copy it with Ctrl+C";
    }
  };
  return element(
    "div",
    { class: "strip" },
    element("p", { id: "once" }, `The token of ${made.user} is made. Copy it now: it is not shown again.`),
    element("div", { class: "row" }, element("label", { for: "secret" }, "Secret"), field, element("button", { type: "button", class: "main", onclick: () => void copy() }, "Copy"), done),
  );
}
