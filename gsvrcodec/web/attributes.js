/** Attributes of Gaussians and grids, and the sizes of planes (section 5.4). */

import { MOST_LOG_OPACITY } from "./reconstruction.js";

/** Floats of all attributes of a grid: the *slots* of its values. */
const slotsOf = {};

/** The attributes by number. Components have slots from `slot` on; without a plane, these are 0. */
export const ATTRIBUTES = /** @type {[string, number, string, number, number][]} */ ([
  ["position", 2, "new", -1024, 1024],
  ["log_scale", 2, "new", -32, 13],
  ["rotation", 1, "new", -64, 64],
  ["colour", 3, "new", -65536, 65536],
  ["log_opacity", 1, "new", -MOST_LOG_OPACITY, MOST_LOG_OPACITY],
  ["indicator", 1, "new", -2, 2],
  ["linear", 2, "new", -1024, 1024],
  ["quadratic", 2, "new", -1024, 1024],
  ["xy", 8, "xy", -1024, 1024],
  ["xt", 8, "xt", -1024, 1024],
  ["yt", 8, "yt", -1024, 1024],
  ["mode", 1, "reference", 0, 7],
  ["position_change", 2, "changed", -1024, 1024],
  ["log_scale_change", 2, "changed", -45, 45],
  ["rotation_change", 1, "changed", -64, 64],
  ["colour_change", 3, "changed", -65536, 65536],
  ["log_opacity_change", 1, "changed", -24, 24],
  ["carried_indicator", 1, "moved", -2, 2],
  ["carried_linear", 2, "moved", -1024, 1024],
  ["carried_quadratic", 2, "moved", -1024, 1024],
]).map(([name, components, grid, low, high]) => {
  const slot = slotsOf[grid] ?? 0;
  slotsOf[grid] = slot + components;
  return { name, components, grid, low, high, slot };
});

/** Slots of a Gaussian; the first are its look (section 8.3). */
export const SLOTS = 14, LOOK_SLOTS = 9;
/** First slots of the attributes of a Gaussian. */
export const LOG_SCALE = 2, ROTATION = 4, COLOUR = 5, LOG_OPACITY = 8, INDICATOR = 9, LINEAR = 10;
export const QUADRATIC = 12;
/** Channels of a tri-plane; the first are all that means store. */
export const CHANNELS = 8, MEAN_CHANNELS = 6;
/** The one of the log-opacity, in means. */
export const OPACITY_CHANNEL = 5;
/** Bits of a mode, and the mode of a Gaussian that is dropped (section 5.5). */
export const MOVED = 1, CHANGED = 2, DROPPED = 4;

const SLOT_ATTRIBUTES = ATTRIBUTES.filter(({ grid }) => grid === "new")
  .flatMap((attribute) => Array(attribute.components).fill(attribute));

/** Clamp a value to the bounds of a Gaussian's slot. */
export function bounded(value, slot) {
  const { low, high } = SLOT_ATTRIBUTES[slot];
  return value < low ? low : value > high ? high : value;
}

/** Return whether the Gaussian at `at` looks the same in all frames of its GOP (section 8.2). */
export function isStill(gaussians, at) {
  const moves = (slot) => gaussians[at + slot] || gaussians[at + slot + 1];
  return gaussians[at + INDICATOR] === 1 && !moves(LINEAR) && !moves(QUADRATIC);
}

/** Return how many components of an attribute have planes. */
export function storedComponents({ name, components }, blending) {
  if (blending === "mean") return components === CHANNELS ? MEAN_CHANNELS : components;
  return name.startsWith("log_opacity") ? 0 : components;
}

/** Return the grids of a GOP by name: size of their planes, and how many samples count. */
export function gridsOf({ gaussians, grid, carried, dropped, changed, moved }) {
  const [gx, gy, gt] = grid;
  const plane = (width, height, count = width * height) =>
    ({ width, height, count, slots: 0, values: null, planes: [], guided: false, columns: null });
  const list = (count) => {
    const width = Math.ceil(Math.sqrt(count));
    return plane(width, Math.ceil(count / (width || 1)), count);
  };
  const grids = {
    new: { ...list(gaussians - (carried - dropped)), guided: true },
    xy: plane(gx, gy), xt: plane(gx, gt), yt: plane(gy, gt),
    reference: list(carried), changed: list(changed), moved: list(moved),
  };
  for (const [name, grid] of Object.entries(grids)) grid.slots = slotsOf[name];
  return grids;
}
