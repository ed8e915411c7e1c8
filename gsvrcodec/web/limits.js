/** Limits on a film (section 12); what is over them is unsupported. */

import { UnsupportedError } from "./errors.js";

export const LIMITS = {
  width: 32768,
  height: 32768,
  pixels: 2 ** 28,
  gaussians: 2 ** 24,
  gopFrames: 2 ** 16,
  chain: 1024,
  chunks: 2 ** 16,
  planeSamples: 2 ** 26,
  chunkBytes: 2 ** 31 - 1,
  metadataBytes: 2 ** 20,
};
const EXPANSION_BASE = 2 ** 26, EXPANSION_RATIO = 4096;

/** Check a number, called `what` in the message, against a limit. */
export function limit(name, number, what, most = LIMITS[name]) {
  if (number > most) throw new UnsupportedError(`${what} is ${number}, over the limit of ${most}.`);
}

/** Check how many numbers of 4 bytes come out of bytes. */
export function limitExpansion(numbers, bytes) {
  limit("", 4 * numbers, "its unpacked size", EXPANSION_BASE + EXPANSION_RATIO * bytes);
}

/** Return a typed array; memory is a limit, too. */
export function allocate(Type, length) {
  try {
    return new Type(length);
  } catch {
    throw new UnsupportedError("it takes more memory than this browser gives.");
  }
}
