/** Refinement of the values of new Gaussians (section 5.6). */

import {
  COLOUR, isStill, LINEAR, LOG_OPACITY, LOG_SCALE, QUADRATIC, ROTATION, SLOTS,
} from "./attributes.js";
import { check } from "./errors.js";
import { allocate } from "./limits.js";
import { refinedValue } from "./plane_table.js";

const LOG2_E = 1.4426950408889634;
const MOST_BITS = 8;

/** By the table: first slot, components, and factors of eight times the level. */
const REFINED = [
  { slot: 0, components: 2, area: -1, shape: 3, opacity: 2 },
  { slot: LOG_SCALE, components: 2, area: 2, shape: 0, opacity: 3 },
  { slot: ROTATION, components: 1, area: 2, shape: 8, opacity: 3 },
  { slot: COLOUR, components: 3, area: 3, shape: 0, opacity: 3 },
  { slot: LINEAR, components: 2, area: -1, shape: 3, opacity: 2 },
  { slot: QUADRATIC, components: 2, area: -1, shape: 3, opacity: 2 },
];

/** Read the refinement, the rest of a payload, and refine the grid `new`. */
export function refine(cursor, grid) {
  const entries = REFINED.map((entry) => ({ ...entry, least: cursor.i8(), most: cursor.u8() }))
    .filter(({ least, most }) => {
      const right = most <= MOST_BITS && (most > 0 ? grid.count > 0 : least === 0);
      check(right, "its refinement has a wrong table.");
      return most > 0;
    });
  const traits = traitsOf(grid), { bytes, end } = cursor;
  const table = entries.map((entry) => ({ ...entry, ...countBits(entry, traits) }));
  const total = table.reduce((sum, entry) => sum + entry.components * entry.total, 0);
  check(cursor.left === Math.ceil(total / 8), "its refinement has another number of bytes.");
  check((bytes[end - 1] & (1 << (-total & 7)) - 1) === 0, "its refinement ends with ones.");
  const place = { bytes, byte: cursor.at, bit: 0 };
  for (const { slot, components, counts } of table) {
    for (const plane of grid.planes) {
      if (plane.slot >= slot && plane.slot < slot + components) refinePlane(plane, counts, place);
    }
  }
}

/** Refine a plane by the bits from `place` on; move that behind them. */
function refinePlane(plane, counts, place) {
  const { samples, slot, grid: { values } } = plane, { bytes } = place;
  let { byte, bit } = place;
  for (let n = 0; n < counts.length; n++) {
    const k = counts[n];
    if (k === 0) continue;
    const r = (bytes[byte] << 8 | bytes[byte + 1]) >> 16 - bit - k & (1 << k) - 1;
    byte += bit + k >> 3;
    bit = bit + k & 7;
    values[n * SLOTS + slot] = refinedValue(plane, samples[n], k, r);
  }
  Object.assign(place, { byte, bit });
}

/** Return what levels depend on, from base values. */
function traitsOf({ count, values: v }) {
  const [area, shape, opacity, still] = [0, 0, 0, 0].map(() => allocate(Int8Array, count));
  for (let n = 0, at = 0; n < count; n++, at += SLOTS) {
    const l0 = v[at + LOG_SCALE], l1 = v[at + LOG_SCALE + 1];
    area[n] = Math.floor((l0 + l1) * LOG2_E);
    shape[n] = Math.floor(Math.abs(l0 - l1) * LOG2_E);
    opacity[n] = Math.floor(v[at + LOG_OPACITY] * LOG2_E);
    still[n] = isStill(v, at);
  }
  return { area, shape, opacity, still };
}

/** Return the number k of bits of each Gaussian for an attribute, and their sum. */
function countBits(entry, { area, shape, opacity, still }) {
  const counts = allocate(Uint8Array, area.length), { least, most } = entry;
  let total = 0;
  for (let n = 0; n < counts.length; n++) {
    const weighted = entry.area * area[n] + entry.shape * shape[n] + entry.opacity * opacity[n];
    const k = (weighted >> 3) - least;
    if (entry.slot < LINEAR || !still[n]) counts[n] = k < 0 ? 0 : k > most ? most : k;
    total += counts[n];
  }
  return { counts, total };
}
