/** Plane table and dequantisation (sections 5.3 and 7). */

import { ATTRIBUTES, storedComponents } from "./attributes.js";
import { CODECS } from "./codecs.js";
import { check, UnsupportedError } from "./errors.js";

/**
 * Read the plane table; `blending` says how pictures are formed. The value of sample n of a plane,
 * `offset` + q `step`, will stand at n * `grid.slots` + `slot` in the values of its grid.
 */
export function readPlaneTable(cursor, count, grids, blending) {
  check(16 * count <= cursor.left, "its plane table is cut short.");
  const entries = Array.from({ length: count }, () => ({
    attribute: cursor.u8(), component: cursor.u8(), codec: cursor.u8(), bits: cursor.u8(),
    offset: cursor.f32(), step: cursor.f32(), bytes: cursor.u32(),
  }));
  for (const { attribute, codec } of entries) {
    if (attribute >= ATTRIBUTES.length || codec >= CODECS.length) {
      throw new UnsupportedError(`it has an unknown attribute ${attribute} or codec ${codec}.`);
    }
  }
  const expected = ATTRIBUTES.flatMap((attribute, number) => {
    const length = grids[attribute.grid].count && storedComponents(attribute, blending);
    return Array.from({ length }, (_, i) => `${number}.${i}`);
  });
  const found = entries.map(({ attribute, component }) => `${attribute}.${component}`);
  check(String(found) === String(expected), "its plane table has not the planes of its counts.");
  const planes = entries.map((entry) => placed(entry, grids));
  const bytes = planes.reduce((sum, plane) => sum + plane.bytes, 0);
  check(bytes <= cursor.left, "its planes are longer than its payload.");
  return planes;
}

/** Check an entry of the table; return it with its grid and its slot there. */
function placed(entry, grids) {
  const { attribute, component, codec, bits, offset, step } = entry;
  const { name, components, grid, low, high, slot } = ATTRIBUTES[attribute];
  const label = components === 1 ? name : `${name}.${component}`;
  const right = bits >= 1 && bits <= 16 && (step > 0 || (step === 0 && codec === 0))
    && (name !== "mode" || (bits === 3 && offset === 0 && step === 1));
  check(right, `plane ${label} has wrong bits or a wrong step.`);
  const last = offset + (2 ** bits - 1) * step;
  check(offset >= low && last <= high, `plane ${label} exceeds the bounds of its values.`);
  return { ...entry, name: label, low, high, grid: grids[grid], slot: slot + component };
}

/** Put the values of a plane, without padding, into those of its grid. */
export function dequantise({ grid: { values, slots, count }, slot, samples, offset, step }) {
  for (let n = 0, at = slot; n < count; n++, at += slots) values[at] = offset + samples[n] * step;
}

/** Return the value of a sample q of a plane that `k` bits `r` refine. */
export function refinedValue({ offset, step, low, high }, q, k, r) {
  const parts = 2 << k;
  const value = Math.fround(offset + (q * parts + 2 * r + 1 - (1 << k)) * (step / parts));
  return value < low ? low : value > high ? high : value;
}
