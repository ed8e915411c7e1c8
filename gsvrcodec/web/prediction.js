/** Deformation, prediction, and passages between GOPs (sections 8.1 to 8.3), in binary64. */

import {
  bounded, CHANGED, CHANNELS, COLOUR, DROPPED, INDICATOR, LINEAR, LOG_OPACITY, LOG_SCALE,
  LOOK_SLOTS, MOVED, OPACITY_CHANNEL, QUADRATIC, ROTATION, SLOTS,
} from "./attributes.js";
import { check } from "./errors.js";
import { allocate } from "./limits.js";
import { LEAST_SHARE, MIN_SCALE, MOST_LOG_OPACITY } from "./reconstruction.js";

/** Return a GOP, of which `own` is what it stores, with what it takes over (section 8.3). */
export function carryOver(own, reference) {
  const { pts, modes, changes, motions, grids, blending } = own, before = look(reference, 1);
  const same = modes.length * LOOK_SLOTS === before.length;
  check(same, "its reference has another number of Gaussians.");
  const kept = modes.filter((mode) => mode !== DROPPED).length;
  const start = pts.length > 1 ? -1 - 2 / (pts.length - 1) : -1;
  const gaussians = allocate(Float32Array, kept * SLOTS + own.gaussians.length);
  gaussians.set(own.gaussians, kept * SLOTS);
  let to = 0, change = 0, motion = 0;
  modes.forEach((mode, n) => {
    if (mode === DROPPED) return;
    const units = mode & CHANGED ? unitsOf(before, n * LOOK_SLOTS) : [];
    for (let slot = 0; slot < LOOK_SLOTS; slot++) {
      const value = before[n * LOOK_SLOTS + slot];
      const added = mode & CHANGED ? units[slot] * changes[change++] : 0;
      gaussians[to + slot] = bounded(Math.fround(value + added), slot);
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
  return { pts, gaussians, grids, modes, blending };
}

/** Return the units of the changes of the look at `at` (section 8.3). */
function unitsOf(looks, at) {
  const [l0, l1] = looks.subarray(at + LOG_SCALE), opacity = looks[at + LOG_OPACITY];
  const area = l0 + l1, shape = Math.min(Math.abs(l0 - l1), 4);
  const place = 3 * area - 4 * shape - opacity, scale = -area - shape - opacity;
  const colour = -2 * area - opacity;
  return [place, place, scale, scale, area - 7 * shape, colour, colour, colour, 0]
    .map((eighths) => Math.exp(eighths / 8));
}

/**
 * Return the way from the last frame of a GOP to the first of the next, which is predicted from it
 * (section 8.1), as two sets of static Gaussians, `from` and `to`: those carried over, new ones
 * from number `carried` on, dropped ones from number `all` on.
 */
export function passageBetween(before, after) {
  const last = look(before, 1), first = look(after, -1), kept = [], dropped = [];
  after.modes.forEach((mode, n) => (mode === DROPPED ? dropped : kept).push(n));
  const carried = kept.length, all = first.length / LOOK_SLOTS, count = all + dropped.length;
  const from = allocate(Float32Array, count * SLOTS), to = allocate(Float32Array, count * SLOTS);
  const put = (to, i, looks, n) => {
    to.set(looks.subarray(n * LOOK_SLOTS, (n + 1) * LOOK_SLOTS), i * SLOTS);
    to[i * SLOTS + INDICATOR] = 1;
  };
  for (let i = 0; i < count; i++) {
    const old = i < carried ? kept[i] : dropped[i - all];
    const isOld = i < carried || i >= all, isNew = i < all;
    put(from, i, isOld ? last : first, isOld ? old : i);
    put(to, i, isNew ? first : last, isNew ? i : old);
  }
  return { from, to, carried, all, blending: after.blending };
}

/** Put a passage, `weight` of the way, into `gaussians`. */
export function mix({ from, to, carried, all, blending }, weight, gaussians) {
  for (let n = 0; n < from.length; n++) gaussians[n] = (1 - weight) * from[n] + weight * to[n];
  for (let i = carried, at = i * SLOTS; at < gaussians.length; i++, at += SLOTS) {
    const share = i < all ? weight : 1 - weight;
    if (blending === "mean") {
      gaussians[at + LOG_OPACITY] += Math.log(Math.max(share, LEAST_SHARE));
    } else {
      for (let slot = COLOUR; slot < LOG_OPACITY; slot++) gaussians[at + slot] *= share;
    }
  }
}

/** Return the looks of the Gaussians of a GOP at a time, -1 to 1 (section 8.3). */
export function look({ pts, gaussians: g, grids, blending }, time) {
  const tau = pts.length > 1 ? time : 0, field = grids && fieldAt(grids, tau);
  const result = allocate(Float32Array, g.length / SLOTS * LOOK_SLOTS), none = Array(8).fill(0);
  for (let at = 0, to = 0; at < g.length; at += SLOTS, to += LOOK_SLOTS) {
    const bent = field && g[at + INDICATOR] !== 1;
    const f = bent ? field(g[at], g[at + 1], 1 - g[at + INDICATOR]) : none;
    for (let axis = 0; axis < 2; axis++) {
      const i = at + axis, logScale = g[i + LOG_SCALE];
      result[to + axis] = g[i] + g[i + LINEAR] * tau + g[i + QUADRATIC] * tau ** 2 + f[axis];
      result[to + LOG_SCALE + axis] =
        bent ? Math.log(Math.max(Math.exp(logScale) + f[2 + axis], MIN_SCALE)) : logScale;
    }
    result[to + ROTATION] = g[at + ROTATION] + f[4];
    for (let slot = COLOUR; slot < LOG_OPACITY; slot++) {
      result[to + slot] = g[at + slot] + (blending === "sum" ? f[slot] : 0);
    }
    const bend = blending === "mean" ? f[OPACITY_CHANNEL] : 0, opacity = g[at + LOG_OPACITY] + bend;
    result[to + LOG_OPACITY] = Math.min(Math.max(opacity, -MOST_LOG_OPACITY), MOST_LOG_OPACITY);
  }
  return result;
}

/** Return the function that gives the offsets f of section 8.2. */
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

/** Return the grid points beside a place in [-1, 1], and the way between them. */
function cell(place, size) {
  const at = Math.min(Math.max((place + 1) / 2 * (size - 1), 0), size - 1), low = Math.floor(at);
  return { low, high: Math.min(low + 1, size - 1), part: at - low };
}

function bilinear(grid, columns, row, column, k) {
  const line = (i) => {
    const at = i * columns * CHANNELS + k, { low, high, part } = column;
    return (1 - part) * grid[at + low * CHANNELS] + part * grid[at + high * CHANNELS];
  };
  return (1 - row.part) * line(row.low) + row.part * line(row.high);
}
