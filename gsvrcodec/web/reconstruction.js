/** Constants of the reconstruction (section 8). */

/** Smallest scale, pixels of the coded frame. */
export const MIN_SCALE = 0.1;
/** Added to variances on level 0, square pixels of the coded frame. */
export const DILATION = 0.1;
/** Of frames smaller than that, square pixels of them. */
export const ANTIALIAS = 0.25;
/** Levels of the pyramid. */
export const LEVELS = 5;
/** Variance that upsampling adds, square pixels of a level. */
export const UPSAMPLING = 0.1875;
/** Least variance on a level above 0, square pixels of it. */
export const MIN_VARIANCE = 0.5;
/** Subtracted from each weight: a Gaussian ends there. */
export const CUTOFF = 1 / 64;
/** Weight of the black ground behind means. */
export const GROUND = 1 / 1024;
/** Weight of each pixel of a plate. */
export const PLATE_WEIGHT = 1;
/** Greatest magnitude of a log-opacity. */
export const MOST_LOG_OPACITY = 12;
/** Least share of an opacity between two GOPs. */
export const LEAST_SHARE = 2 ** -16;
