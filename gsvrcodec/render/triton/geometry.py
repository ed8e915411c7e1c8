"""Shared by the kernels: constants of spec section "Reconstruction", ellipses, compaction.

SUMS, a compile-time value of most kernels, is how many sums a pixel has: 3 of a picture that is the
sum of its Gaussians; 4 of a mean, the last of which is that of the weights.
"""

import math

import triton
import triton.language as tl

from gsvrcodec.model import reconstruction

#: Gaussians that are deformed together and have common bounds.
BLOCK = tl.constexpr(64)
#: Floats of a splat's ellipse: centre x, y, slope, across, down. Its factors of the weight follow:
#: red, green, blue and, of a mean, that of the sum of weights.
ELLIPSE = tl.constexpr(5)

CHANNELS = tl.constexpr(8)  # of the tri-plane
LEVELS = tl.constexpr(reconstruction.LEVELS)
MIN_SCALE = tl.constexpr(reconstruction.MIN_SCALE)
DILATION = tl.constexpr(reconstruction.DILATION)
CUTOFF = tl.constexpr(reconstruction.CUTOFF)
GROUND = tl.constexpr(reconstruction.GROUND)
MOST_LOG_OPACITY = tl.constexpr(reconstruction.MOST_LOG_OPACITY)
UPSAMPLING = tl.constexpr(reconstruction.UPSAMPLING)
MIN_VARIANCE = tl.constexpr(reconstruction.MIN_VARIANCE)
LOG2E = tl.constexpr(1.4426950408889634)
#: Exponents at a splat's end, where its weight is the cut-off: to the base e and to the base 2.
SUPPORT = tl.constexpr(-math.log(reconstruction.CUTOFF))
END = tl.constexpr(-math.log2(reconstruction.CUTOFF))


@triton.jit
def locate(pixel, size):
    """Index of the first pixel whose centre is at `pixel` or beyond, kept in [0, size].

    Near a whole number it may be one too small, never one too large.
    """
    return tl.minimum(tl.maximum(pixel + 0.4999, 0.0), 1.0 * size).to(tl.int32)


@triton.jit
def span(first, last, slope, across, down):
    """Range of v, from the centre, that an ellipse covers over u in [first, last].

    The ellipse is across u^2 + down (v - slope u)^2 <= END.
    """
    # Where v is extreme: the ellipse is symmetrical about its centre.
    steep = across + down * slope * slope
    extreme = slope * tl.sqrt(down / (across * steep) * END)
    low = tl.minimum(tl.maximum(-extreme, first), last)
    high = tl.minimum(tl.maximum(extreme, first), last)
    below = slope * low - tl.sqrt(tl.maximum(-across * low * low + END, 0.0) / down)
    above = slope * high + tl.sqrt(tl.maximum(-across * high * high + END, 0.0) / down)
    return below, above


@triton.jit
def level_size(level, width, height, SUMS: tl.constexpr):
    """Width and height of a level of the pyramid, and the floats of those before it in a frame."""
    before = tl.zeros([], tl.int64)
    for n in tl.static_range(LEVELS - 1):
        coarser = level > n
        before += tl.where(coarser, SUMS * tl.cast(width, tl.int64) * height, 0)
        width = tl.where(coarser, (width + 1) // 2, width)
        height = tl.where(coarser, (height + 1) // 2, height)
    return width, height, before


@triton.jit
def compact(list_ptr, values, chosen):
    """Write the chosen values one after the other, in order; return how many they are."""
    chosen = chosen.to(tl.int32)
    tl.store(list_ptr + tl.cumsum(chosen, 0) - 1, values, mask=chosen > 0)
    return tl.sum(chosen, 0)
