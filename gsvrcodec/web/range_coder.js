/** The range coder of codecs 4 and 5 (section 6): rANS with a state of 32 bits. */

import { check } from "./errors.js";

const LEAST_STATE = 1 << 16;

/**
 * The two ends of a coded plane: words at the front, bits at the back.
 *
 * The loops over the samples keep in variables of their own the `state`, an int32 of the same bits,
 * and the offset `at` of the next word, which is due when `state >>> 16` is 0. They read without a
 * look at the ends, which does no harm in JavaScript, and call `checkSpace` once a row.
 */
export class RangeCoder {
  /** `cursor` stands behind the head of the plane, and ends with the plane. */
  constructor(cursor) {
    this.state = cursor.u32() | 0;
    check(this.state >>> 16, "the state of its coder is too small.");
    this.bytes = cursor.bytes;
    this.at = cursor.at;
    this.end = cursor.end;
    this.used = 0;
  }

  /** Return the next number of up to 16 bits from the back. */
  bits(count) {
    const { bytes, used } = this;
    const last = this.end - 1 - (used >>> 3);
    const window = bytes[last] << 16 | bytes[last - 1] << 8 | bytes[last - 2];
    this.used = used + count;
    return window >>> 24 - (used & 7) - count & (1 << count) - 1;
  }

  /** Check that words, which were read up to the offset `at`, and bits do not overlap. */
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
