// Questions to the service, and its answers.

const ROOT = "/api/v1";
const TOKEN_KEY = "spcola-token";
const RETRY_MS = 2000;

interface Problem {
  title?: string;
  detail?: string;
  where?: string;
  do?: string;
  code?: string;
}

/** An answer that is an error: what, where, and what to do. */
export class ApiProblem extends Error {
  constructor(
    readonly status: number,
    readonly problem: Problem,
  ) {
    super(problem.detail ?? problem.title ?? `status ${status}`);
  }

  /** The whole problem in one line. */
  get line(): string {
    const { where, do: advice } = this.problem;
    return `${where ? `${where}: ` : ""}${this.message}${advice ? ` – ${advice}` : ""}`;
  }
}

/** An event of a job. */
export interface JobEvent {
  number: string;
  kind: string;
  content: Record<string, unknown> & { job: string; workspace: string; time: number };
}

export interface Asked {
  signal?: AbortSignal;
  headers?: Record<string, string>;
}

/** Return the token that the user has given in this tab; "" if none. */
export function token(): string {
  return sessionStorage.getItem(TOKEN_KEY) ?? "";
}

/** Keep a token for this tab, or forget it ("").*/
export function setToken(given: string): void {
  if (given) sessionStorage.setItem(TOKEN_KEY, given);
  else sessionStorage.removeItem(TOKEN_KEY);
}

/** Return the path of something in a workspace, its parts encoded. */
export function pathOf(workspace: string, ...parts: string[]): string {
  return ["/workspaces", workspace, ...parts].map((part, k) => (k ? encodeURIComponent(part) : part)).join("/");
}

// Answers that a view will ask for, on their way while its files are.
const ahead = new Map<string, Promise<Response>>();

/** Ask for what a view will ask for first; what it does not ask for is forgotten with the signal. */
export function askAhead(paths: string[], signal: AbortSignal): void {
  for (const path of paths) {
    const answer = ask(path, { signal });
    // Whoever asks for it gets the problem.
    answer.catch(() => undefined);
    ahead.set(path, answer);
    signal.addEventListener("abort", () => ahead.delete(path));
  }
}

/** Ask the service; an error becomes an `ApiProblem`. */
export async function ask(path: string, init: RequestInit = {}): Promise<Response> {
  const early = init.method ? undefined : ahead.get(path);
  if (early) {
    ahead.delete(path);
    return early;
  }
  const headers = new Headers(init.headers);
  if (token()) headers.set("Authorization", `Bearer ${token()}`);
  let answer: Response;
  try {
    answer = await fetch(addressOf(path), { ...init, headers });
  } catch (error) {
    if (init.signal?.aborted) throw error;
    throw new ApiProblem(0, { detail: "the service does not answer", do: "is spcola serve running?" });
  }
  if (!answer.ok) throw new ApiProblem(answer.status, await problemOf(answer));
  return answer;
}

/** Return JSON. */
export async function getJson<T>(path: string, asked: Asked = {}): Promise<T> {
  return (await ask(path, asked)).json() as Promise<T>;
}

/** Return bytes. */
export async function getBytes(path: string, asked: Asked = {}): Promise<ArrayBuffer> {
  return (await ask(path, asked)).arrayBuffer();
}

/** Return little-endian float32 values; NaN where unknown. */
export async function getFloats(path: string, asked: Asked = {}): Promise<Float32Array> {
  return new Float32Array(await getBytes(path, asked));
}

/** Return a picture or a file. */
export async function getBlob(path: string, asked: Asked = {}): Promise<Blob> {
  return (await ask(path, asked)).blob();
}

/** Send a body as JSON, or none; return the JSON of the answer (null if it has none). */
export async function send<T>(method: string, path: string, body?: unknown, asked: Asked = {}): Promise<T> {
  const headers = { ...asked.headers, ...(body === undefined ? {} : { "Content-Type": "application/json" }) };
  const text = body === undefined ? undefined : JSON.stringify(body);
  const answer = await ask(path, { ...asked, method, headers, body: text });
  return (answer.status === 204 ? null : await answer.json()) as T;
}

/** Return all pages of a list: `key` is its name in the answers. */
export async function getAll<T>(path: string, key: string, asked: Asked = {}): Promise<T[]> {
  const found: T[] = [];
  for (let next: string | null = path; next; ) {
    const answer: Response = await ask(next, asked);
    found.push(...((await answer.json()) as Record<string, T[]>)[key]!);
    next = nextOf(answer);
  }
  return found;
}

/** Return a JSON object whose list `key` has the entries of all pages. */
export async function getWhole<T>(path: string, key: keyof T & string, asked: Asked = {}): Promise<T> {
  const answer = await ask(path, asked);
  const content = (await answer.json()) as T;
  const next = nextOf(answer);
  const others = next === null ? [] : await getAll<unknown>(next, key, asked);
  return { ...content, [key]: [...(content[key] as unknown[]), ...others] };
}

/** Return the address of the next page of a list; null at its end. */
export function nextOf(answer: Response): string | null {
  return /<([^>]+)>;\s*rel="next"/.exec(answer.headers.get("Link") ?? "")?.[1] ?? null;
}

/** Call `onEvent` with each event of a stream, until the signal aborts; broken streams go on. */
export async function events(
  path: string,
  onEvent: (event: JobEvent) => void,
  signal: AbortSignal,
  onState: (connected: boolean) => void = () => undefined,
): Promise<void> {
  let last = "";
  while (!signal.aborted) {
    try {
      const headers: Record<string, string> = { Accept: "text/event-stream" };
      if (last) headers["Last-Event-ID"] = last;
      const answer = await ask(path, { headers, signal, cache: "no-store" });
      onState(true);
      for await (const event of eventsOf(answer.body!)) {
        last = event.number || last;
        onEvent(event);
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof ApiProblem && [401, 403, 404].includes(error.status)) throw error;
    }
    onState(false);
    await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
  }
}

async function* eventsOf(body: ReadableStream<Uint8Array>): AsyncGenerator<JobEvent> {
  const reader = body.pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>).getReader();
  let waiting = "";
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      waiting += value;
      const blocks = waiting.split("\n\n");
      waiting = blocks.pop()!;
      for (const block of blocks) {
        const fields = new Map(block.split("\n").map((line) => splitOnce(line, ": ")));
        if (fields.has("data")) {
          yield {
            number: fields.get("id") ?? "",
            kind: fields.get("event") ?? "",
            content: JSON.parse(fields.get("data")!) as JobEvent["content"],
          };
        }
      }
    }
  } finally {
    await reader.cancel().catch(() => undefined);
  }
}

function splitOnce(text: string, mark: string): [string, string] {
  const at = text.indexOf(mark);
  return at < 0 ? [text, ""] : [text.slice(0, at), text.slice(at + mark.length)];
}

function addressOf(path: string): string {
  return path.startsWith(ROOT) ? path : ROOT + path;
}

async function problemOf(answer: Response): Promise<Problem> {
  try {
    return (await answer.json()) as Problem;
  } catch {
    return { title: answer.statusText, detail: `status ${answer.status}` };
  }
}
