/** The range coder (section 6), rANS with a state of 32 bits, and codec 5, which is little else. */

import { unzigzag } from "./bytes.js";
import { check } from "./errors.js";

const LEAST_STATE = 1 << 16;

/**
 * A coded plane: words at the front, bits at the back.
 *
 * Loops keep in variables the `state`, an int32 of the same bits, and the offset `at` of the next
 * word, which is due when `state >>> 16` is 0. They may read beyond the ends, which does no harm,
 * and call `checkSpace` once a row.
 */
export class RangeCoder {
  /** `cursor` stands behind the head of the plane. */
  constructor(cursor) {
    this.state = cursor.u32() | 0;
    check(this.state >>> 16, "the state of its coder is too small.");
    this.bytes = cursor.bytes;
    this.at = cursor.at;
    this.end = cursor.end;
    this.used = 0;
  }

  /** Return the next bits, up to 16, from the back. */
  bits(count) {
    const { bytes, used } = this;
    const last = this.end - 1 - (used >>> 3);
    const window = bytes[last] << 16 | bytes[last - 1] << 8 | bytes[last - 2];
    this.used = used + count;
    return window >>> 24 - (used & 7) - count & (1 << count) - 1;
  }

  /** Check that words, read up to `at`, and bits do not overlap. */
  checkSpace(at) {
    check(at + (this.used + 7 >>> 3) <= this.end, "it is cut short.");
  }

  /** Check the end of the plane. */
  finish(state, at) {
    this.checkSpace(at);
    check(state === LEAST_STATE && this.bits(-this.used & 7) === 0, "its coder ends elsewhere.");
    check(at + (this.used >>> 3) === this.end, "there are bytes left over.");
  }
}

/** Codec 5, ranges: decode a plane into `samples`, in raster order. */
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
