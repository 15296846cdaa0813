// The shell: header with navigation, and the view that the address names.
import { ApiProblem, askAhead, getJson, setToken, token } from "./api";
import { element, fill } from "./dom";
import { hrefOf, routeOf, type Route } from "./router";
import { applyTheme, themeSwitch } from "./theme";
import { firstPaths } from "./views/ahead";
import { ADMINISTRATION, NAVIGATION, VIEWS } from "./views/index";

const header = document.getElementById("header")!;
const main = document.getElementById("main")!;
let opened = new AbortController();
let names: string[] = [];
let administrator = false;
let scopes: Record<string, string> = {};

/** Open the view that the address names; the one before ends. */
async function open(): Promise<void> {
  const first = !main.hasChildNodes();
  opened.abort();
  opened = new AbortController();
  const { signal } = opened;
  const route = routeOf(location.hash);
  showHeader(route);
  const root = element("div", { class: `view ${route.view}`, "aria-busy": "true" });
  fill(main, root);
  if (!first) main.focus({ preventScroll: true });
  window.scrollTo(0, 0);
  try {
    const load = VIEWS[route.view];
    if (!load) throw new ApiProblem(404, { detail: `there is no view ${route.view}` });
    loadFiles(route.view);
    askAhead(firstPaths(route), signal);
    const view = await load();
    if (signal.aborted) return;
    document.title = [view.title, route.workspace, "SPCOLA"].filter(Boolean).join(" – ");
    await view.open(root, route, signal);
  } catch (error) {
    if (!signal.aborted) showProblem(root, error);
  } finally {
    root.removeAttribute("aria-busy");
  }
}

/** Have all files of a view loaded at once; scripts/page writes which there are into the page. */
function loadFiles(view: string): void {
  const meta = document.querySelector<HTMLMetaElement>("meta[name=views]")!;
  const files = (JSON.parse(meta.content) as Record<string, string[]>)[view] ?? [];
  document.head.append(...files.map((href) => element("link", { rel: "modulepreload", href })));
}

function showHeader(route: Route): void {
  // What only changes things is not shown to who may only read: see "run-only" in the styles.
  document.body.classList.toggle("administrator", administrator);
  const own = [scopes["*"], scopes[route.workspace]].filter((one) => one !== undefined);
  document.body.classList.toggle("reader", own.length > 0 && own.every((one) => one === "read"));
  const shown = route.workspace ? NAVIGATION : administrator ? ADMINISTRATION : [];
  const links = shown.map(([view, title]) =>
    element("a", { href: hrefOf(route.workspace, view), "aria-current": route.view === view ? "page" : undefined }, title),
  );
  fill(
    header,
    element("a", { class: "brand", href: "#/" }, "SPCOLA"),
    route.workspace ? workspaceChoice(route) : null,
    element("nav", { "aria-label": "Views" }, ...links),
    element("span", { class: "spacer" }),
    token() ? element("button", { type: "button", onclick: forget }, "Forget token") : null,
    themeSwitch(),
  );
}

/** Return the choice among the workspaces, or the name of the only one. */
function workspaceChoice(route: Route): HTMLElement {
  const all = names.includes(route.workspace) ? names : [route.workspace, ...names];
  if (all.length === 1) return element("span", { class: "workspace" }, route.workspace);
  const select = element(
    "select",
    { class: "workspace", "aria-label": "Workspace", onchange: () => (location.hash = hrefOf(select.value, route.view)) },
    ...all.map((name) => element("option", { value: name, selected: name === route.workspace }, name)),
  );
  return select;
}

function showProblem(root: HTMLElement, error: unknown): void {
  if (error instanceof ApiProblem && error.status === 401) {
    showTokenEntry(root, token() ? error.line : "This service asks for a token.");
    return;
  }
  const line = error instanceof ApiProblem ? error.line : `the page failed: ${String(error)}`;
  if (!(error instanceof ApiProblem)) console.error(error);
  fill(
    root,
    element("p", { class: "problem", role: "alert" }, line),
    element("button", { type: "button", onclick: () => void open() }, "Try again"),
  );
}

function showTokenEntry(root: HTMLElement, why: string): void {
  const field = element("input", {
    id: "token", type: "password", autocomplete: "off", required: true, spellcheck: "false", size: 44,
  });
  const enter = (event: Event): void => {
    event.preventDefault();
    setToken(field.value.trim());
    void start();
  };
  fill(
    root,
    element("h1", {}, "Token"),
    element("p", { role: "alert" }, why),
    element(
      "form",
      { class: "row", onsubmit: enter },
      element("label", { for: "token" }, "Token"),
      field,
      element("button", { type: "submit", class: "main" }, "Enter"),
    ),
    element(
      "p",
      { class: "quiet" },
      "Whoever runs the service makes tokens: spcola serve token add DIR USER. Yours is kept in this tab alone.",
    ),
  );
  field.focus();
}

function forget(): void {
  setToken("");
  scopes = {};
  administrator = false;
  void start();
}

async function start(): Promise<void> {
  void open();
  try {
    const [answer, caller] = await Promise.all([
      getJson<{ workspaces: { name: string }[] }>("/workspaces?limit=1000"),
      getJson<{ scopes: Record<string, string> }>("/caller"),
    ]);
    names = answer.workspaces.map((one) => one.name);
    scopes = caller.scopes;
    administrator = scopes["*"] === "admin";
    showHeader(routeOf(location.hash));
  } catch {
    // The view shows the problem; the choice has the open workspace alone.
  }
}

applyTheme();
document.querySelector<HTMLAnchorElement>(".skip")!.addEventListener("click", (event) => {
  // The address after "#" is the view's.
  event.preventDefault();
  main.focus();
});
window.addEventListener("hashchange", () => void open());
void start();
