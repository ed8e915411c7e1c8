/** Which Gaussians move against the camera: the layers of gsvrcodec's decoder. */

import { LINEAR, SLOTS } from "./attributes.js";

/** Least way of a moving Gaussian against the median motion, in longer sides of the frame. */
export const LEAST_WAY = 1 / 160;

function median(values) {
  const sorted = values.slice().sort();
  const middle = sorted.length >> 1;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

/** Return 1 for each Gaussian whose polynomial takes it away from the median motion, else 0. */
export function findMoving(gaussians, width, height) {
  const count = gaussians.length / SLOTS;
  const [linearX, linearY, quadraticX, quadraticY] = [0, 1, 2, 3].map((part) => {
    const values = new Float32Array(count);
    for (let n = 0; n < count; n++) values[n] = gaussians[n * SLOTS + LINEAR + part];
    const camera = count ? median(values) : 0;
    const half = (part % 2 ? height : width) / 2;
    return values.map((value) => (value - camera) * half);
  });
  const least = LEAST_WAY * Math.max(width, height);
  return Uint8Array.from({ length: count }, (_, n) => {
    const [x, y, dx, dy] = [quadraticX[n], quadraticY[n], linearX[n], linearY[n]];
    return Math.max(Math.hypot(x + dx, y + dy), Math.hypot(x - dx, y - dy)) > least ? 1 : 0;
  });
}
