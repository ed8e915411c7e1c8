/** The walk from chunk head to chunk head (section 11), for streams and damaged files. */

import { crc32, Cursor } from "./bytes.js";
import { CutError, HEAD_BYTES, readChunkHead, refuseUnknown } from "./chunks.js";
import { check, CorruptError, located, orFault } from "./errors.js";
import { readSummary, SUMMARY_BYTES } from "./gop_head.js";
import { limit } from "./limits.js";

const WINDOW_BYTES = 2 ** 20;
const MOST_FAULTS = 20;

/**
 * Return `{ chunks, faults, ended }`: chunks from byte `start` on, of GOPs the sound ones with
 * their `summary`; sentences on damage; whether there is an end chunk.
 */
export async function walk(source, start, { stream }) {
  const chunks = [], faults = [];
  let offset = start, last = null, ended = false, steps = 0;
  const fault = (sentence) => {
    if (faults.length < MOST_FAULTS) faults.push(sentence);
    else faults[MOST_FAULTS] = "There is more of the same.";
  };
  const headAt = (place) => {
    limit("chunks", ++steps, "The number of chunks");
    return orFault(readChunkHead(source, place));
  };
  while (offset < source.size && !ended) {
    const chunk = await headAt(offset);
    if (chunk instanceof CorruptError) {
      offset = await nextGop(source, offset + 1, headAt);
      const cut = stream && chunk instanceof CutError && offset === source.size;
      if (!cut) fault(chunk.message);
      continue;
    }
    check(chunk.type !== "HEAD", `The file has a second header at byte ${offset}.`);
    refuseUnknown(chunk);
    if (chunk.type === "GOPD") {
      const summary = await orFault(soundSummary(source, chunk, last));
      if (summary instanceof CorruptError) {
        fault(located(summary, `The GOP at byte ${offset} is left out`).message);
      } else {
        if (summary.firstFrame !== (last?.endFrame ?? 0n)) {
          fault(`Frames before frame ${summary.firstFrame} are lost.`);
        }
        chunk.summary = last = summary;
      }
    }
    if (chunk.summary || chunk.type !== "GOPD") chunks.push(chunk);
    ended = chunk.type === "fend";
    offset = chunk.end;
  }
  if (offset < source.size) fault("There are bytes behind the end of the film.");
  return { chunks, faults, ended };
}

/** Return the summary of a sound GOP behind the last one. */
async function soundSummary(source, { offset, length }, last) {
  const start = offset + HEAD_BYTES, end = start + length;
  let crc = 0;
  for (let at = start; at < end; at += WINDOW_BYTES) {
    crc = crc32(await source.read(at, Math.min(WINDOW_BYTES, end - at)), crc);
  }
  check(new Cursor(await source.read(end, 4)).u32() === crc, "its CRC is wrong.");
  const bytes = await source.read(start, Math.min(length, SUMMARY_BYTES));
  const summary = readSummary(new Cursor(bytes));
  const later = !last || (summary.firstFrame >= last.endFrame && summary.firstPts > last.lastPts);
  check(later, "it does not come after the last one.");
  return summary;
}

/** Return the offset of the next GOP with a sound head, or the size of the file. */
async function nextGop(source, start, headAt) {
  const { size } = source;
  for (let at = start; at < size; at += WINDOW_BYTES) {
    // Windows overlap: a type may lie across their border.
    const bytes = await source.read(at, Math.min(WINDOW_BYTES + 3, size - at));
    for (let i = bytes.indexOf(71); i >= 0; i = bytes.indexOf(71, i + 1)) {
      const named = bytes[i + 1] === 79 && bytes[i + 2] === 80 && bytes[i + 3] === 68;
      if (named && !(await headAt(at + i) instanceof CorruptError)) return at + i;
    }
  }
  return size;
}
