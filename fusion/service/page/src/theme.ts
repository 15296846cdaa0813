// Light, dark, or as the system has it.
import { element } from "./dom";

const KEY = "spcola-theme";
const CHOICES = { system: "System", light: "Light", dark: "Dark" };

/** Set the theme that the user has chosen; drawings that depend on it listen to "themechange". */
export function applyTheme(): void {
  const chosen = localStorage.getItem(KEY) ?? "system";
  if (chosen === "system") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = chosen;
  window.dispatchEvent(new Event("themechange"));
}

/** Return the choice of a theme. */
export function themeSwitch(): HTMLElement {
  const chosen = localStorage.getItem(KEY) ?? "system";
  const select = element(
    "select",
    {
      "aria-label": "Theme",
      onchange: () => {
        localStorage.setItem(KEY, select.value);
        applyTheme();
      },
    },
    ...Object.entries(CHOICES).map(([key, title]) =>
      element("option", { value: key, selected: key === chosen }, title),
    ),
  );
  return select;
}

// Colours of variables until the theme changes: to find one the browser lays out its styles again.
const found = new Map<string, string>();
window.addEventListener("themechange", () => found.clear());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => found.clear());

/** Return the colour of a CSS variable, such as "--text", for drawings on a canvas. */
export function themed(name: string, opacity = 1): string {
  const colour = found.get(name) ?? computed(name);
  found.set(name, colour);
  return opacity < 1 ? colour.replace(/^rgb\((.*)\)$/, `rgba($1, ${opacity})`) : colour;
}

function computed(name: string): string {
  // A variable itself may name two colours; as the colour of an element it is one of them.
  const probe = element("span", { hidden: true });
  probe.style.color = `var(${name})`;
  document.body.append(probe);
  const colour = getComputedStyle(probe).color;
  probe.remove();
  return colour;
}

/** The letters of the page, for drawings on a canvas. */
export function letters(): string {
  return getComputedStyle(document.documentElement).getPropertyValue("--font").trim();
}

/** Call `draw` whenever the colours change, until the signal aborts. */
export function onTheme(draw: () => void, signal: AbortSignal): void {
  window.addEventListener("themechange", draw, { signal });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw, { signal });
}
