/** Index and end chunk (section 9). */

import { Cursor } from "./bytes.js";
import { isType, OVERHEAD_BYTES, readChunkHead, readPayload, readType } from "./chunks.js";
import { check, orFault } from "./errors.js";
import { readSummary, SUMMARY_BYTES } from "./gop_head.js";
import { limit } from "./limits.js";

const ENTRY_BYTES = 56;
const END_CHUNK_BYTES = OVERHEAD_BYTES + 16;

/** Return the chunks from byte `start` to the index, GOPs with their `summary`. */
export async function readIndex(source, start) {
  const { size } = source, stop = size - END_CHUNK_BYTES;
  const end = stop < start ? null : await orFault(readChunkHead(source, stop));
  check(end?.type === "fend" && end.end === size, "It has no end chunk.");
  const cursor = new Cursor(await readPayload(source, end));
  const offset = Number(cursor.u64()), said = Number(cursor.u64());
  check(said === size && offset >= start && offset < stop, "Its end chunk is of another file.");
  const index = await readChunkHead(source, offset);
  check(index.type === "indx" && index.end === stop, `It has no index at byte ${offset}.`);
  return parseEntries(await readPayload(source, index), start, offset);
}

/** Parse the entries, whose chunks fill the bytes from `start` to `stop`. */
function parseEntries(payload, start, stop) {
  const cursor = new Cursor(payload), chunks = [], firstFrames = new Set();
  const count = cursor.u32();
  check(cursor.left === count * ENTRY_BYTES, "Its index has a wrong length.");
  limit("chunks", count, "The number of chunks");
  let offset = start, last = null;
  for (let i = 0; i < count; i++) {
    const type = readType(cursor), length = Number(cursor.u64());
    const allowed = isType(type) && !["HEAD", "indx", "fend"].includes(type);
    const chunk = { type, offset, length, end: offset + OVERHEAD_BYTES + length };
    check(allowed && chunk.end <= stop, "Its index lists a chunk that it must not.");
    const summary = cursor.take(SUMMARY_BYTES);
    if (type === "GOPD") {
      chunk.summary = last = follow(readSummary(new Cursor(summary)), last, firstFrames);
    } else {
      check(!summary.some(Boolean), "Its index has a summary of a chunk that is no GOP.");
    }
    chunks.push(chunk);
    offset = chunk.end;
  }
  check(offset === stop, "Its index does not list all chunks.");
  return chunks;
}

/** Check that a GOP follows the `last` one, and its reference comes before. */
function follow(summary, last, firstFrames) {
  const { firstFrame, firstPts, distance } = summary;
  const next = firstFrame === (last?.endFrame ?? 0n) && (!last || firstPts > last.lastPts);
  const found = !distance || firstFrames.has(firstFrame - BigInt(distance));
  check(next && found, "Its index lacks frames, or the reference of a GOP.");
  firstFrames.add(firstFrame);
  return summary;
}
