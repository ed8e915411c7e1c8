"""The constants of reconstruction (spec section "Reconstruction"), for all backends that render.

`gsvrcodec/native/render/reconstruction.hpp` holds the same numbers for C++; a test compares them.
"""

from __future__ import annotations

from typing import Literal

#: How a picture is formed: the mean of the colours of its Gaussians, weighted by their opacities,
#: or the sum of their colours.
Blending = Literal["mean", "sum"]

#: Smallest scale of a Gaussian, pixels of the coded frame.
MIN_SCALE = 0.1
#: Added to the variances of Gaussians on level 0, squared pixels of the coded frame.
DILATION = 0.1
#: Subtracted from each weight; a Gaussian ends where its weight is this.
CUTOFF = 1 / 64
#: Weight of the black ground behind all Gaussians, where a picture is a mean.
GROUND = 1 / 1024
#: What each pixel of a plate weighs; a Gaussian of opacity 1 weighs about as much in its centre.
PLATE_WEIGHT = 1.0
#: Greatest magnitude of the logarithm of an opacity, at any time.
MOST_LOG_OPACITY = 12.0
#: Variance of the filter against aliasing, squared pixels of a frame smaller than the coded one.
ANTIALIAS = 1 / 4
#: Number of pyramid levels; level l has 1/2^l of the frame's width and height.
LEVELS = 5
#: Smallest scale of a Gaussian on a level above 0, pixels of that level.
LEVEL_SCALE = 1.0
#: Variance that bilinear upsampling of a level adds to a Gaussian, squared pixels of that level.
UPSAMPLING = 3 / 16
#: Smallest variance of a Gaussian on a level above 0, squared pixels of that level.
MIN_VARIANCE = 1 / 2
