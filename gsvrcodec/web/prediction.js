/** Deformation, prediction, and passages between GOPs (sections 8.1 to 8.3), in binary64. */

import {
  bounded, CHANGED, COLOUR, DROPPED, INDICATOR, LINEAR, LOG_SCALE, LOOK_SLOTS, MOVED, QUADRATIC,
  ROTATION, SLOTS,
} from "./attributes.js";
import { check } from "./errors.js";
import { allocate } from "./limits.js";

const LEAST_SCALE = 0.1, CHANNELS = 8;

/**
 * Return a predicted GOP, `{ pts, gaussians, grids, modes }`, with the Gaussians that it takes over
 * from its reference (section 8.3). `own` is what `unpackGop` returns.
 */
export function carryOver(own, reference) {
  const { pts, modes, changes, motions } = own, before = look(reference, 1);
  const same = modes.length * LOOK_SLOTS === before.length;
  check(same, "its reference has another number of Gaussians.");
  const kept = modes.filter((mode) => mode !== DROPPED).length;
  const start = pts.length > 1 ? -1 - 2 / (pts.length - 1) : -1;
  const gaussians = allocate(Float32Array, kept * SLOTS + own.gaussians.length);
  gaussians.set(own.gaussians, kept * SLOTS);
  let to = 0, change = 0, motion = 0;
  modes.forEach((mode, n) => {
    if (mode === DROPPED) return;
    for (let slot = 0; slot < LOOK_SLOTS; slot++) {
      const value = before[n * LOOK_SLOTS + slot];
      const changed = mode & CHANGED ? Math.fround(value + changes[change++]) : value;
      gaussians[to + slot] = bounded(changed, slot);
    }
    gaussians[to + INDICATOR] = 1;
    for (let slot = INDICATOR; mode & MOVED && slot < SLOTS; slot++) {
      gaussians[to + slot] = motions[motion++];
    }
    for (let axis = 0; axis < 2; axis++) {
      const linear = gaussians[to + LINEAR + axis], quadratic = gaussians[to + QUADRATIC + axis];
      const place = gaussians[to + axis] - (start * linear + start ** 2 * quadratic);
      gaussians[to + axis] = bounded(Math.fround(place), axis);
    }
    to += SLOTS;
  });
  return { pts, gaussians, grids: own.grids, modes };
}

/**
 * Return the way from the last frame of a GOP to the first frame of the next, which is predicted
 * from it (section 8.1), as two sets of static Gaussians, `from` and `to`: those carried over, the
 * new ones, those dropped. One that is not there yet, or no longer, has colour 0.
 */
export function passageBetween(before, after) {
  const last = look(before, 1), first = look(after, -1), kept = [], dropped = [];
  after.modes.forEach((mode, n) => (mode === DROPPED ? dropped : kept).push(n));
  const carried = kept.length, all = first.length / LOOK_SLOTS, count = all + dropped.length;
  const from = allocate(Float32Array, count * SLOTS), to = allocate(Float32Array, count * SLOTS);
  for (let i = 0, at = 0; i < count; i++, at += SLOTS) {
    const old = i < carried ? kept[i] : dropped[i - all];
    const isOld = i < carried || i >= all, isNew = i < all;
    for (let slot = 0; slot < LOOK_SLOTS; slot++) {
      const a = last[old * LOOK_SLOTS + slot], b = first[i * LOOK_SLOTS + slot];
      from[at + slot] = isOld ? a : slot < COLOUR ? b : 0;
      to[at + slot] = isNew ? b : slot < COLOUR ? a : 0;
    }
    from[at + INDICATOR] = to[at + INDICATOR] = 1;
  }
  return { from, to };
}

/** Return the looks of the Gaussians of a GOP in its first (-1) or last frame (1) (section 8.3). */
function look({ pts, gaussians: g, grids }, end) {
  const tau = pts.length > 1 ? end : 0, field = grids && fieldAt(grids, tau);
  const result = allocate(Float32Array, g.length / SLOTS * LOOK_SLOTS), none = Array(8).fill(0);
  for (let at = 0, to = 0; at < g.length; at += SLOTS, to += LOOK_SLOTS) {
    const bent = field && g[at + INDICATOR] !== 1;
    const f = bent ? field(g[at], g[at + 1], 1 - g[at + INDICATOR]) : none;
    for (let axis = 0; axis < 2; axis++) {
      const i = at + axis, logScale = g[i + LOG_SCALE];
      result[to + axis] = g[i] + g[i + LINEAR] * tau + g[i + QUADRATIC] * tau ** 2 + f[axis];
      result[to + LOG_SCALE + axis] =
        bent ? Math.log(Math.max(Math.exp(logScale) + f[2 + axis], LEAST_SCALE)) : logScale;
    }
    for (let slot = ROTATION; slot < LOOK_SLOTS; slot++) result[to + slot] = g[at + slot] + f[slot];
  }
  return result;
}

/** Return a function of a position and a strength: the offsets f of section 8.2. */
function fieldAt({ size: [gx, gy, gt], xy, xt, yt }, tau) {
  const f = new Float64Array(CHANNELS), t = cell(tau, gt);
  return (x, y, strength) => {
    const u = cell(x, gx), v = cell(y, gy);
    for (let k = 0; k < CHANNELS; k++) {
      f[k] = strength * bilinear(xy, gx, v, u, k) * bilinear(xt, gx, t, u, k)
        * bilinear(yt, gy, t, v, k);
    }
    return f;
  };
}

/** Return the grid points beside a place in [-1, 1], and the part of the way between them. */
function cell(place, size) {
  const at = Math.min(Math.max((place + 1) / 2 * (size - 1), 0), size - 1), low = Math.floor(at);
  return { low, high: Math.min(low + 1, size - 1), part: at - low };
}

/** Look channel k of a grid up, the row first. */
function bilinear(grid, columns, row, column, k) {
  const line = (i) => {
    const at = i * columns * CHANNELS + k, { low, high, part } = column;
    return (1 - part) * grid[at + low * CHANNELS] + part * grid[at + high * CHANNELS];
  };
  return (1 - row.part) * line(row.low) + row.part * line(row.high);
}
