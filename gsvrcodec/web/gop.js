/** The payload of a GOP chunk (section 5), decoded in the order of section 11. */

import { CHANGED, DROPPED, gridsOf, MOVED } from "./attributes.js";
import { Cursor } from "./bytes.js";
import { CODECS, IMAGE_CODECS } from "./codecs.js";
import { check, CorruptError, located } from "./errors.js";
import { readGopHead, readTiming } from "./gop_head.js";
import { allocate, limit, limitExpansion } from "./limits.js";
import { decodePlate } from "./plate.js";
import { dequantise, readPlaneTable } from "./plane_table.js";
import { refine } from "./refinement.js";

/**
 * Return what a GOP itself stores: `pts`, `grids` and `blending` as in `Film.gop`; `gaussians`, the
 * new ones; `modes`, one of each Gaussian of the reference, null in a key GOP; `changes`, 9 floats
 * of each changed Gaussian, `motions`, 5 of each moved one; `plate`, of `decodePlate`, or null.
 * Floats are in the order of section 5.4; those without planes are 0.
 */
export async function unpackGop(payload, header) {
  const cursor = new Cursor(payload);
  const head = readGopHead(cursor, header);
  const pts = readTiming(cursor, head);
  const coded = head.plate ? cursor.take(cursor.u32()) : null;
  const grids = gridsOf(head);
  const planes = readPlaneTable(cursor, head.planes, grids, header.blending);
  const plain = !planes.some(({ codec }) => IMAGE_CODECS.includes(codec));
  check(plain || header.imageCodecs, "it has an image in a film without image codecs.");
  const sizes = planes.map(({ grid }) => grid.width * grid.height);
  limitExpansion(sizes.reduce((sum, size) => sum + size, 0), payload.length);
  for (const size of sizes) limit("planeSamples", size, "the size of a plane");

  for (const grid of Object.values(grids)) {
    grid.values = allocate(Float32Array, grid.count * grid.slots);
  }
  for (const plane of planes) await decodePlane(cursor, plane);
  refine(cursor, grids.new);
  const modes = new Uint8Array(grids.reference.values);
  checkModes(modes, head);
  const plate = coded && await decodePlate(coded, header);
  const [xy, xt, yt] = [grids.xy, grids.xt, grids.yt].map(({ values }) => values);
  return {
    pts, gaussians: grids.new.values, grids: head.grid[0] ? { size: head.grid, xy, xt, yt } : null,
    modes: head.distance ? modes : null,
    changes: grids.changed.values, motions: grids.moved.values, plate,
    blending: header.blending,
  };
}

/** Decode a plane, and add it to those of its grid. */
async function decodePlane(cursor, plane) {
  const { grid, codec } = plane;
  const start = cursor.skip(plane.bytes);
  plane.samples = allocate(Uint16Array, grid.width * grid.height);
  try {
    await CODECS[codec](new Cursor(cursor.bytes, start, cursor.at), plane, plane.samples);
  } catch (error) {
    throw error instanceof CorruptError ? located(error, `plane ${plane.name}`) : error;
  }
  grid.planes.push(plane);
  dequantise(plane);
}

/** Check that modes are as many as the head says (section 5.5). */
function checkModes(modes, { dropped, changed, moved }) {
  const count = (bit) => modes.reduce((sum, mode) => sum + (mode & bit ? 1 : 0), 0);
  const known = modes.every((mode) => mode <= DROPPED);
  const same = count(DROPPED) === dropped && count(CHANGED) === changed && count(MOVED) === moved;
  check(known && same, "its modes are not those that its head counts.");
}
