/** Signature and chunks (sections 2 and 3). */

import { crc32, Cursor } from "./bytes.js";
import { check, CorruptError, UnsupportedError } from "./errors.js";
import { limit, LIMITS } from "./limits.js";

const SIGNATURE = [0x89, 0x47, 0x53, 0x56, 0x0D, 0x0A, 0x1A, 0x0A];
export const SIGNATURE_BYTES = 8, HEAD_BYTES = 16;
/** Bytes of a chunk besides its payload. */
export const OVERHEAD_BYTES = HEAD_BYTES + 4;

/** The file ends inside of a chunk. */
export class CutError extends CorruptError {}

/** Check the first bytes of a file. */
export async function checkSignature(source) {
  const start = await source.read(0, Math.min(source.size, SIGNATURE_BYTES));
  check(SIGNATURE.every((byte, i) => start[i] === byte), "This is no .gsvr file.");
}

/** Return the type of a chunk, a string of four characters. */
export function readType(cursor) {
  return String.fromCharCode(...cursor.take(4));
}

export function isType(type) {
  return /^[A-Za-z]{4}$/.test(type);
}

/** Refuse an unknown critical chunk. */
export function refuseUnknown({ type, offset }) {
  if (type[0] < "a" && type !== "HEAD" && type !== "GOPD") {
    throw new UnsupportedError(`The chunk ${type} at byte ${offset} is needed, but not known.`);
  }
}

/** Return the chunk `{ type, offset, length, end }` at an offset, by its head. */
export async function readChunkHead(source, offset) {
  const there = source.size - offset >= OVERHEAD_BYTES;
  if (!there) throw new CutError(`The chunk at byte ${offset} is cut short.`);
  return parseHead(await source.read(offset, HEAD_BYTES), offset, source.size);
}

/** Return the payload of a chunk, which must be as `chunk` says. */
export async function readPayload(source, chunk) {
  const { type, offset, length } = chunk, end = HEAD_BYTES + length;
  const bytes = await source.read(offset, length > LIMITS.chunkBytes ? HEAD_BYTES : end + 4);
  const place = `The chunk ${type} at byte ${offset}`;
  const found = parseHead(bytes, offset, source.size);
  const same = found.type === type && found.length === length;
  check(same, `${place} is not the one that the index names.`);
  limit("chunkBytes", length, `The length of the chunk at byte ${offset}`);
  const payload = bytes.subarray(HEAD_BYTES, end);
  check(crc32(payload) === new Cursor(bytes, end).u32(), `${place}: its CRC is wrong.`);
  return payload;
}

function parseHead(bytes, offset, size) {
  const cursor = new Cursor(bytes);
  const type = readType(cursor), length = Number(cursor.u64());
  const sound = crc32(bytes.subarray(0, 12)) === cursor.u32() && isType(type);
  check(sound, `The chunk at byte ${offset} has a damaged head.`);
  const end = offset + OVERHEAD_BYTES + length;
  if (end > size) throw new CutError(`The chunk at byte ${offset} ends behind the file.`);
  return { type, offset, length, end };
}
