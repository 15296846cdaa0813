// SHA-256 of a file of any size, read block by block.
import { sha256 } from "@noble/hashes/sha2.js";

const BLOCK = 4 << 20;

/** Return the digest in hexadecimal; `onShare` gets how much has been read, 0 … 1. */
export async function digestOf(file: Blob, signal: AbortSignal, onShare: (share: number) => void): Promise<string> {
  const hash = sha256.create();
  for (let at = 0; at < file.size; at += BLOCK) {
    signal.throwIfAborted();
    hash.update(new Uint8Array(await file.slice(at, at + BLOCK).arrayBuffer()));
    onShare(Math.min(1, (at + BLOCK) / file.size));
  }
  return Array.from(hash.digest(), (byte) => byte.toString(16).padStart(2, "0")).join("");
}
