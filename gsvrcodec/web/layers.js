/** Which Gaussians move against the camera: the layers of gsvrcodec's decoder. */

/** Floats of a Gaussian, and where its linear and quadratic motion stand. */
const FLOATS = 13;
const MOTION = 9;
/** Least way of a moving Gaussian against the median motion, in longer sides of the frame. */
const LEAST_WAY = 1 / 160;

function median(values) {
  const sorted = values.slice().sort();
  const middle = sorted.length >> 1;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

/** Return 1 for each Gaussian whose polynomial takes it away from the median motion, else 0. */
export function findMoving(gaussians, width, height) {
  const count = gaussians.length / FLOATS;
  const [linearX, linearY, quadraticX, quadraticY] = [0, 1, 2, 3].map((part) => {
    const values = Float32Array.from({ length: count }, (_, n) => gaussians[n * FLOATS + MOTION + part]);
    const camera = count ? median(values) : 0;
    const half = (part % 2 ? height : width) / 2;
    return values.map((value) => (value - camera) * half);
  });
  const least = LEAST_WAY * Math.max(width, height);
  return Uint8Array.from({ length: count }, (_, n) => {
    const way = (sign) => Math.hypot(quadraticX[n] + sign * linearX[n], quadraticY[n] + sign * linearY[n]);
    return Math.max(way(1), way(-1)) > least ? 1 : 0;
  });
}
