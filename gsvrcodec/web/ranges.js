/** Codec 5, ranges (section 6): rows of equally likely samples. */

import { unzigzag } from "./bytes.js";
import { check } from "./errors.js";
import { RangeCoder } from "./range_coder.js";

/** Decode a plane into `samples`, a Uint16Array in raster order. */
export function decodeRanges(cursor, { bits, grid: { width, height } }, samples) {
  const lowest = new Uint16Array(height), counts = new Uint32Array(height);
  for (let y = 0, highest = 0; y < height; y++) {
    const low = highest + unzigzag(cursor.varint32());
    highest = low + cursor.varint32();
    check(low >= 0 && highest < 2 ** bits, "the range of a row is out of bounds.");
    lowest[y] = low;
    counts[y] = highest - low + 1;
  }
  const coder = new RangeCoder(cursor), { bytes } = coder;
  let { state, at } = coder;
  for (let y = 0, i = 0; y < height; y++) {
    const low = lowest[y], n = counts[y];
    const first = (value) => Math.floor((value * 65536 + n - 1) / n);
    for (let x = 0; x < width; x++) {
      const slot = state & 65535, value = Math.imul(slot, n) >>> 16, start = first(value);
      state = Math.imul(first(value + 1) - start, state >>> 16) + slot - start | 0;
      if (state >>> 16 === 0) {
        state = state << 16 | bytes[at] | bytes[at + 1] << 8;
        at += 2;
      }
      samples[i++] = low + value;
    }
    coder.checkSpace(at);
  }
  coder.finish(state, at);
}
