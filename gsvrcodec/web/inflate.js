/** Deflate streams of a known size, inflated by the browser (codecs 1 and 2). */

import { check } from "./errors.js";
import { allocate } from "./limits.js";

/** Bytes that are inflated at a time, so that little comes out. */
const PIECE_BYTES = 4096;

let strict = null; // what findsLeftovers found

/** Inflate "deflate" (zlib) or "deflate-raw", which must fill `bytes` and give `size`. */
export async function inflate(bytes, format, size) {
  const result = await attempt(bytes, format, size);
  check(result, "its deflate stream is damaged, or has a wrong length.");
  if (!await findsLeftovers()) {
    // A stream without its last byte has no end.
    const early = await attempt(bytes.subarray(0, -1), format, size);
    check(!early, "there are bytes behind its deflate stream.");
  }
  return result;
}

/** Return whether the browser refuses bytes behind a stream. */
function findsLeftovers() {
  strict ??= attempt(Uint8Array.of(3, 0, 0), "deflate-raw", 0).then((result) => !result);
  return strict;
}

/** Return what a stream inflates to; null if it is broken or of another size. */
async function attempt(bytes, format, size) {
  const result = allocate(Uint8Array, size);
  let from = 0, to = 0;
  const stream = new ReadableStream({
    pull(controller) {
      if (from >= bytes.length) return controller.close();
      return controller.enqueue(bytes.subarray(from, from += PIECE_BYTES));
    },
  });
  const reader = stream.pipeThrough(new DecompressionStream(format)).getReader();
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return to === size ? result : null;
      result.set(value, to); // a RangeError if there is too much
      to += value.length;
    }
  } catch {
    reader.cancel().catch(() => {});
    return null;
  }
}
