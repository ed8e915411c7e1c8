/** Attributes of Gaussians and grids, and the sizes of planes (section 5.4). */

/**
 * The attributes by number. The components of the attributes of one grid, counted through, are the
 * *slots* of its values: a new Gaussian has 13.
 */
export const ATTRIBUTES = [
  ["position", 2, "new", -1024, 1024],
  ["log_scale", 2, "new", -32, 13],
  ["rotation", 1, "new", -64, 64],
  ["colour", 3, "new", -65536, 65536],
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
  ["carried_indicator", 1, "moved", -2, 2],
  ["carried_linear", 2, "moved", -1024, 1024],
  ["carried_quadratic", 2, "moved", -1024, 1024],
].map(([name, components, grid, low, high]) => ({ name, components, grid, low, high }));

/** Slots of a Gaussian; the first of them are its look (section 8.3). */
export const SLOTS = 13, LOOK_SLOTS = 8;
/** First slots of the attributes of a Gaussian. */
export const LOG_SCALE = 2, ROTATION = 4, COLOUR = 5, INDICATOR = 8, LINEAR = 9, QUADRATIC = 11;
/** Bits of a mode, and the mode of a Gaussian that is dropped (section 5.5). */
export const MOVED = 1, CHANGED = 2, DROPPED = 4;

/** The attributes of the slots of a Gaussian. */
const SLOT_ATTRIBUTES = ATTRIBUTES.slice(0, 7)
  .flatMap((attribute) => Array(attribute.components).fill(attribute));

/** Clamp a value to the bounds of a slot of a Gaussian. */
export function bounded(value, slot) {
  const { low, high } = SLOT_ATTRIBUTES[slot];
  return value < low ? low : value > high ? high : value;
}

/** Return the grids of a GOP by name: the size of their planes, and how many samples count. */
export function gridsOf({ gaussians, grid: [gx, gy, gt], carried, dropped, changed, moved }) {
  const plane = (width, height, count = width * height) =>
    ({ width, height, count, slots: 0, planes: [], guided: false, columns: null });
  const list = (count) => {
    const width = Math.ceil(Math.sqrt(count));
    return plane(width, Math.ceil(count / (width || 1)), count);
  };
  return {
    new: { ...list(gaussians - (carried - dropped)), guided: true },
    xy: plane(gx, gy), xt: plane(gx, gt), yt: plane(gy, gt),
    reference: list(carried), changed: list(changed), moved: list(moved),
  };
}
