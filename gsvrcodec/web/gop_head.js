/** Summary, head and timing of a GOP (sections 5.1 and 5.2). */

import { check } from "./errors.js";
import { limit } from "./limits.js";

export const SUMMARY_BYTES = 44;
const GOP_HEAD_BYTES = 72;
/** Bounds of timestamps, durations and frame numbers, and of the ticks that a GOP spans. */
const MOST_TICKS = 2n ** 62n, MOST_SPAN = 2n ** 52n;

/** Read the summary of a GOP; check the rules that need no other GOP. */
export function readSummary(cursor) {
  const firstFrame = cursor.u64(), frames = cursor.u32(), gaussians = cursor.u32();
  const firstPts = cursor.i64(), lastPts = cursor.i64(), lastDuration = cursor.u64();
  const distance = cursor.u32(), endFrame = firstFrame + BigInt(frames);
  check(frames && endFrame <= MOST_TICKS, "its number of frames is out of bounds.");
  const inside = firstPts > -MOST_TICKS && firstPts <= lastPts && lastPts < MOST_TICKS
    && lastPts - firstPts < MOST_SPAN && lastDuration < MOST_TICKS;
  check(inside, "its timestamps are out of bounds.");
  check((frames === 1) === (firstPts === lastPts), "its frames and timestamps do not agree.");
  check(BigInt(distance) <= firstFrame, "its reference is before the first frame.");
  return { firstFrame, endFrame, frames, gaussians, firstPts, lastPts, lastDuration, distance };
}

/** Read the head of a GOP; check it, the maxima of the header, and the limits. */
export function readGopHead(cursor, header) {
  const summary = readSummary(cursor), { gaussians, frames, distance } = summary;
  const bytes = cursor.u16(), planes = cursor.u16();
  const grid = [cursor.u16(), cursor.u16(), cursor.u16()], plate = cursor.u16();
  const carried = cursor.u32(), dropped = cursor.u32();
  const changed = cursor.u32(), moved = cursor.u32();
  const newer = header.version[1] > 0 && bytes > GOP_HEAD_BYTES;
  check(newer || bytes === GOP_HEAD_BYTES, `its head has ${bytes} bytes.`);
  cursor.skip(bytes - GOP_HEAD_BYTES);
  const flat = grid.includes(0) && grid.some(Boolean);
  check(!flat, "its tri-plane is flat.");
  const allowed = header.plates && !distance ? 1 : 0;
  check(plate <= allowed, "it has a plate where none may be.");
  const most = Math.max(gaussians, carried), kept = carried - dropped;
  const agree = (distance || !carried) && kept >= 0 && kept <= gaussians
    && changed <= kept && moved <= kept;
  check(agree, "its numbers of Gaussians do not agree.");
  const small = most <= header.mostGaussians && frames <= header.mostFrames
    && grid.every((side, i) => side <= header.mostGrid[i]);
  check(small, "it exceeds a maximum of the header.");
  limit("gaussians", most, "its number of Gaussians");
  limit("gopFrames", frames, "its number of frames");
  return { ...summary, planes, plate, grid, carried, dropped, changed, moved };
}

/** Read the timing; return timestamps, ticks after the first one. */
export function readTiming(cursor, { frames, firstPts, lastPts, lastDuration }) {
  const pts = new Float64Array(frames);
  let done = 0, time = firstPts, last = time, duration = 0n;
  while (done < frames) {
    const count = Number(cursor.varint()), step = cursor.varint();
    duration = cursor.varint();
    const right = count >= 1 && count <= frames - done
      && step >= 1n && step < MOST_TICKS && duration < MOST_TICKS;
    check(right, "a run of its frames has a wrong length or wrong times.");
    // Exact in a GOP that is right, whose frames are within 2^52 ticks of the first.
    const first = Number(time - firstPts);
    for (let i = 0; i < count; i++) pts[done + i] = first + i * Number(step);
    done += count;
    last = time + step * BigInt(count - 1);
    time = last + step;
  }
  const same = last === lastPts && duration === lastDuration;
  check(same && time < 2n ** 63n, "its timing does not end as its head says.");
  return pts;
}
