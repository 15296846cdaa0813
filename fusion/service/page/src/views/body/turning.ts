// Turning with pointers and keys.
import { limited, type Look } from "./camera";

const STEP_DEG = 5;
const WHEEL = 0.0012;
const CLICK_PX = 4;

interface Hooks {
  look(): Look;
  /** The new look; called for every movement. */
  turn(look: Look): void;
  /** A click, not a drag, at CSS pixels of the canvas. */
  click(x: number, y: number): void;
  reset(): void;
}

/** Turn and zoom by drag, pinch, wheel and keys until the signal aborts. */
export function addTurning(canvas: HTMLCanvasElement, radius: number, hooks: Hooks, signal: AbortSignal): void {
  const pointers = new Map<number, { x: number; y: number }>();
  let moved = 0;
  const change = (longitude: number, latitude: number, zoom = 1): void => {
    const now = hooks.look();
    const wanted = { longitude: now.longitude + longitude, latitude: now.latitude + latitude, width: now.width / zoom };
    hooks.turn(limited(wanted, radius));
  };
  const drag = (dx: number, dy: number): void => {
    const now = hooks.look();
    const metres = now.width / Math.min(canvas.clientWidth, canvas.clientHeight);
    const angle = ((metres / radius) * 180) / Math.PI;
    change((-dx * angle) / Math.max(0.2, Math.cos((now.latitude * Math.PI) / 180)), dy * angle);
  };
  const spread = (): number => {
    const [one, two] = [...pointers.values()];
    return one && two ? Math.hypot(one.x - two.x, one.y - two.y) : 0;
  };
  canvas.addEventListener(
    "pointerdown",
    (event) => {
      if (event.button > 0) return;
      if (!pointers.size) moved = 0;
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      canvas.setPointerCapture(event.pointerId);
    },
    { signal },
  );
  canvas.addEventListener(
    "pointermove",
    (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before.x, event.clientY - before.y];
      const apart = spread();
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      moved += Math.hypot(dx, dy);
      if (pointers.size > 1) {
        drag(dx / 2, dy / 2);
        if (apart) change(0, 0, spread() / apart);
      } else if (moved > CLICK_PX) drag(dx, dy);
    },
    { signal },
  );
  const release = (event: PointerEvent): void => {
    if (!pointers.delete(event.pointerId) || pointers.size || moved > CLICK_PX) return;
    const at = canvas.getBoundingClientRect();
    if (event.type === "pointerup") hooks.click(event.clientX - at.left, event.clientY - at.top);
  };
  canvas.addEventListener("pointerup", release, { signal });
  canvas.addEventListener("pointercancel", release, { signal });
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
      change(0, 0, Math.exp(-event.deltaY * lines * WHEEL));
    },
    { signal, passive: false },
  );
  canvas.addEventListener(
    "keydown",
    (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const step = event.shiftKey ? STEP_DEG / 5 : STEP_DEG;
      const steps: Record<string, () => void> = {
        ArrowLeft: () => change(-step, 0),
        ArrowRight: () => change(step, 0),
        ArrowUp: () => change(0, step),
        ArrowDown: () => change(0, -step),
        "+": () => change(0, 0, 1.25),
        "=": () => change(0, 0, 1.25),
        "-": () => change(0, 0, 0.8),
        Home: () => hooks.reset(),
      };
      const act = steps[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    },
    { signal },
  );
}
