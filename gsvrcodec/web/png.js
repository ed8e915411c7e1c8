/** Codec 2, PNG (section 6): a grey image of 8 or 16 bits. Its numbers are big-endian. */

import { crc32 } from "./bytes.js";
import { check } from "./errors.js";
import { inflate } from "./inflate.js";
import { allocate } from "./limits.js";

const PNG_SIGNATURE = [0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A];

/** Decode a plane into `samples`, a Uint16Array in raster order. */
export async function decodePng(cursor, { bits, grid: { width, height } }, samples) {
  const size = bits <= 8 ? 1 : 2, stride = 1 + width * size;
  check(String(cursor.take(8)) === String(PNG_SIGNATURE), "it is no PNG.");
  const wanted = new DataView(new ArrayBuffer(13));
  wanted.setUint32(0, width);
  wanted.setUint32(4, height);
  wanted.setUint8(8, 8 * size);
  const { type, data } = readPngChunk(cursor);
  const same = type === "IHDR" && String(data) === String(new Uint8Array(wanted.buffer));
  check(same, "its PNG header is not that of the plane.");
  const raw = await inflate(readImageData(cursor), "deflate", height * stride);
  for (let y = 0, at = 0; y < height; y++, at += stride) {
    unfilter(raw, at, stride, size);
    for (let x = 0; x < width; x++) {
      const i = at + 1 + x * size;
      const sample = size === 1 ? raw[i] : raw[i] << 8 | raw[i + 1];
      check(sample < 2 ** bits, "a sample is too large.");
      samples[y * width + x] = sample;
    }
  }
}

function readPngChunk(cursor) {
  const length = cursor.view.getUint32(cursor.skip(4));
  const body = cursor.take(4 + length), crc = cursor.view.getUint32(cursor.skip(4));
  check(crc32(body) === crc, "a chunk of its PNG has a wrong CRC.");
  return { type: String.fromCharCode(...body.subarray(0, 4)), data: body.subarray(4) };
}

/** Return the data of the IDAT chunks, behind which IEND must end the file. */
function readImageData(cursor) {
  const joined = allocate(Uint8Array, cursor.left);
  for (let at = 0; ;) {
    const { type, data } = readPngChunk(cursor);
    if (type === "IEND" && data.length === 0 && cursor.left === 0) return joined.subarray(0, at);
    check(type === "IDAT", "its PNG has another chunk, or does not end with the plane.");
    joined.set(data, at);
    at += data.length;
  }
}

/** Undo the filter of the row at `at`, where its number is. */
function unfilter(raw, at, stride, size) {
  const filter = raw[at];
  check(filter <= 4, "a row of its PNG has an unknown filter.");
  for (let x = 1; x < stride; x++) {
    const i = at + x, inside = x > size;
    const left = inside ? raw[i - size] : 0, up = at ? raw[i - stride] : 0;
    const corner = at && inside ? raw[i - stride - size] : 0;
    if (filter === 1) raw[i] += left;
    if (filter === 2) raw[i] += up;
    if (filter === 3) raw[i] += left + up >> 1;
    if (filter === 4) raw[i] += paeth(left, up, corner);
  }
}

function paeth(left, up, corner) {
  const toLeft = Math.abs(up - corner), toUp = Math.abs(left - corner);
  const toCorner = Math.abs(left + up - 2 * corner);
  if (toLeft <= toUp && toLeft <= toCorner) return left;
  return toUp <= toCorner ? up : corner;
}
