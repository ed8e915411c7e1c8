/** Which Gaussians move against the camera: the layers of gsvrcodec's decoder. */

import { LINEAR, LOG_SCALE, SLOTS } from "./attributes.js";

/** Least way of a moving Gaussian against the median motion, in longer sides. */
export const LEAST_WAY = 1 / 160;

/** The least value that half of the weights reach. */
function median(values, weights) {
  const order = Uint32Array.from(values.keys()).sort((one, other) => values[one] - values[other]);
  const half = weights.reduce((sum, weight) => sum + weight, 0) / 2;
  let at = 0, reached = weights[order[0]];
  while (reached < half) reached += weights[order[++at]];
  return values[order[at]];
}

/** Return 1 for each Gaussian that moves against the median, taken for the camera's, else 0. */
export function findMoving(gaussians, width, height) {
  const count = gaussians.length / SLOTS;
  const areas = Float64Array.from({ length: count }, (_, n) =>
    Math.exp(gaussians[n * SLOTS + LOG_SCALE] + gaussians[n * SLOTS + LOG_SCALE + 1]));
  const [linearX, linearY, quadraticX, quadraticY] = [0, 1, 2, 3].map((part) => {
    const values = new Float32Array(count);
    for (let n = 0; n < count; n++) values[n] = gaussians[n * SLOTS + LINEAR + part];
    const camera = count ? median(values, areas) : 0;
    const half = (part % 2 ? height : width) / 2;
    return values.map((value) => (value - camera) * half);
  });
  const least = LEAST_WAY * Math.max(width, height);
  return Uint8Array.from({ length: count }, (_, n) => {
    const [x, y, dx, dy] = [quadraticX[n], quadraticY[n], linearX[n], linearY[n]];
    return Math.max(Math.hypot(x + dx, y + dy), Math.hypot(x - dx, y - dy)) > least ? 1 : 0;
  });
}
