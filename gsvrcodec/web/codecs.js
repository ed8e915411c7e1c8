/** Plane codecs (section 6): from bytes to samples. */

import { unzigzag } from "./bytes.js";
import { decodeContext } from "./context.js";
import { check, UnsupportedError } from "./errors.js";
import { inflate } from "./inflate.js";
import { decodePng } from "./png.js";
import { decodeRanges } from "./range_coder.js";

/** Decoders by number: (cursor over the bytes of the plane, plane, samples to fill). */
export const CODECS = [
  decodeConstant, decodeDeflate, decodePng, refuseJpegXl, decodeContext, decodeRanges,
];
/** The codecs that do not occur in a plain file. */
export const IMAGE_CODECS = [2, 3];

function decodeConstant(cursor, { bits }, samples) {
  const value = cursor.u16();
  check(cursor.left === 0 && value < 2 ** bits, "its constant is too long or too large.");
  samples.fill(value);
}

async function decodeDeflate(cursor, { bits, grid: { width } }, samples) {
  const count = samples.length, predictor = cursor.u8();
  check(predictor <= 1, "it has an unknown predictor.");
  const stream = cursor.take(cursor.left);
  const bytes = await inflate(stream, "deflate-raw", bits > 8 ? 2 * count : count);
  for (let i = 0; i < count; i++) {
    const value = bits > 8 ? bytes[i] | bytes[count + i] << 8 : bytes[i];
    check(value < 2 ** bits, "a value is too large.");
    const before = i === 0 ? 0 : samples[i % width === 0 ? i - width : i - 1];
    samples[i] = predictor ? before + unzigzag(value) & 2 ** bits - 1 : value;
  }
}

function refuseJpegXl() {
  throw new UnsupportedError("the film has JPEG XL planes, which a browser cannot decode; "
    + "encode it again without `--pack jxl`.");
}
