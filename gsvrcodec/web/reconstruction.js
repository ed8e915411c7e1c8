/** Constants of the reconstruction (section 8). */

/** Smallest scale of a Gaussian, pixels of the coded frame. */
export const MIN_SCALE = 0.1;
/** Subtracted from each weight; a Gaussian ends where its weight is this. */
export const CUTOFF = 1 / 64;
/** Weight of the black ground behind all Gaussians, where a picture is a mean. */
export const GROUND = 1 / 1024;
/** Greatest magnitude of the logarithm of an opacity, at any time. */
export const MOST_LOG_OPACITY = 12;
/** Least share of its opacity that a Gaussian has between two GOPs. */
export const LEAST_SHARE = 2 ** -16;
