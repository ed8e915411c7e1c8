"""The axes of Gaussians, along which an optimiser moves them.

A large Gaussian may be pixels away from its best place where a small one is a fraction of a pixel
away, and a long one mostly along its longer axis. So positions take steps along the axes, in
proportion to the scales.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor


class Axes:
    """The axes of N Gaussians, as long as their scales in the mean scale of all.

    Args:
        tensors: the decoder's parameters, by the names of `Gop`.
        size: width and height of the coded frame, pixels.
    """

    #: Shortest and longest axis, in the mean scale. 0.1 and 10 cost 0.01 dB.
    _RANGE = (0.3, 3.0)

    def __init__(self, tensors: Mapping[str, Tensor], size: tuple[int, int]) -> None:
        log_scale, rotation = tensors["log_scale"], tensors["rotation"]
        self._lengths = torch.exp(log_scale - log_scale.mean()).clamp_(*self._RANGE)
        # Rotations as complex numbers: as fast as one multiplication of arrays.
        self._turn = torch.polar(torch.ones_like(rotation), rotation)
        pixel = torch.tensor([2 / size[0], 2 / size[1]], device=log_scale.device)
        self._pixel = pixel.repeat(len(log_scale), 1)

    def gradient(self, gradient: Tensor) -> Tensor:
        """Return the gradient by steps along the axes, from that by positions; (N, 2) both."""
        pixels = torch.view_as_complex(gradient * self._pixel)
        return torch.view_as_real(pixels * self._turn.conj()) * self._lengths

    def offset(self, steps: Tensor) -> Tensor:
        """Return the offsets of positions, halves of the frame, of steps along the axes."""
        along = torch.view_as_complex(steps * self._lengths)
        return torch.view_as_real(along * self._turn) * self._pixel
