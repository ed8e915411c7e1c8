/** Plane table and dequantisation (sections 5.3 and 7). */

import { ATTRIBUTES, bounded, storedComponents } from "./attributes.js";
import { unzigzag } from "./bytes.js";
import { CODECS } from "./codecs.js";
import { check, UnsupportedError } from "./errors.js";

/**
 * Read the plane table. The value of sample n of a plane, `offset` + q `step`, will stand at
 * n * `grid.slots` + `slot` in the values of its grid.
 */
export function readPlaneTable(cursor, count, grids, blending) {
  const entries = Array.from({ length: count }, () => {
    const how = cursor.u8(), number = cursor.u16(), first = unzigzag(cursor.varint32());
    const step = (256 + number % 256) * 2 ** ((number >> 8) - 136);
    const codec = how % 16, bits = (how >> 4) + 1, bytes = cursor.varint32();
    return { codec, bits, offset: first * step, step, bytes };
  });
  for (const { codec } of entries) {
    if (codec >= CODECS.length) throw new UnsupportedError(`it has an unknown codec ${codec}.`);
  }
  const expected = ATTRIBUTES.flatMap((attribute) => {
    const length = grids[attribute.grid].count && storedComponents(attribute, blending);
    return Array.from({ length }, (_, component) => ({ attribute, component }));
  });
  check(count === expected.length, "its plane table has not the planes of its counts.");
  const planes = entries.map((entry, i) => placed(entry, expected[i], grids));
  const bytes = planes.reduce((sum, plane) => sum + plane.bytes, 0);
  check(bytes <= cursor.left, "its planes are longer than its payload.");
  return planes;
}

/** Check an entry of the table; return it with its grid and its slot there. */
function placed(entry, { attribute, component }, grids) {
  const { bits, offset, step } = entry, { name, components, grid, low, high, slot } = attribute;
  const label = components === 1 ? name : `${name}.${component}`;
  const right = name !== "mode" || (bits === 3 && offset === 0 && step === 1);
  const inside = offset >= low && offset + (2 ** bits - 1) * step <= high;
  check(right && inside, `plane ${label} has wrong bits, or values out of bounds.`);
  return { ...entry, name: label, grid: grids[grid], slot: slot + component };
}

/** Put the values of a plane into those of its grid. */
export function dequantise({ grid: { values, slots, count }, slot, samples, offset, step }) {
  for (let n = 0, at = slot; n < count; n++, at += slots) values[at] = offset + samples[n] * step;
}

/** Return the value of a sample q that `k` bits `r` refine. */
export function refinedValue({ offset, step, slot }, q, k, r) {
  const parts = 2 << k;
  return bounded(Math.fround(offset + (q * parts + 2 * r + 1 - (1 << k)) * (step / parts)), slot);
}
