"""How much the picture changes with each parameter, and so how exactly it has to be stored."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.native import _core
from gsvrcodec.render.native import parameters

#: Frames that are looked at.
_FRAMES = 8
#: 8-bit codes squared, mean of the channels: the unit that quality is measured in.
_CODES = 255.0**2 / 3


def sensitivity(
    gop: Gop,
    taus: Float32Array,
    size: tuple[int, int],
    rng: np.random.Generator,
    threads: int = 0,
    *,
    repeats: int = 1,
) -> Gop:
    """Squared error that a change of each parameter by one makes, over all pixels and frames.

    The diagonal of J^T J by Hutchinson's estimator: with noise r of unit variance in place of a
    picture's error, the square of the gradient J^T r is the wanted sum of squares in the mean.

    Args:
        gop: The state to look at.
        taus: (F,) normalised times of all frames.
        size: Width and height of the frames, pixels.
        rng: Source of the noise.
        threads: Native threads.
        repeats: How often each frame is shown.

    Returns:
        In place of each parameter its sum, squared 8-bit codes (mean of the channels).
    """
    width, height = size
    total = {f.name: np.zeros_like(getattr(gop, f.name)) for f in fields(Gop)}
    shown = np.unique(np.linspace(0, len(taus) - 1, _FRAMES).round().astype(np.intp))
    gradient = Gop(**{name: np.empty_like(sums) for name, sums in total.items()})
    scale = np.float32(_CODES * repeats * len(taus) / len(shown))
    for tau in taus[shown]:
        _core.backward_float(
            parameters(gop),
            float(tau),
            _noise((height, width, 3), rng),
            width,
            height,
            parameters(gradient),
            threads,
        )
        for name, sums in total.items():
            sums += scale * np.square(getattr(gradient, name))
    return Gop(**total)


def _noise(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Ones of random sign."""
    count = int(np.prod(shape))
    bits = np.unpackbits(np.frombuffer(rng.bytes(-(-count // 8)), np.uint8), count=count)
    noise: NDArray[np.float32] = (2 * bits.astype(np.float32) - 1).reshape(shape)
    return noise
