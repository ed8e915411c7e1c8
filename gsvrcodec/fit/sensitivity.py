"""Sensitivity of the picture to each parameter, which decides how finely it is stored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.anchor import Anchor
from gsvrcodec.fit.footage import Footage, backdrop, some_frames
from gsvrcodec.fit.tuned import STEPS
from gsvrcodec.model.gop import Gop
from gsvrcodec.render.backend import Backend

#: 8-bit codes squared, mean of the channels: the unit that quality is measured in.
_CODES = 255.0**2 / 3


def sensitivities(
    footage: Footage,
    gop: Gop,
    rng: np.random.Generator,
    backend: Backend,
    anchor: Anchor | None = None,
    *,
    frames: int = STEPS.frames,
) -> Gop:
    """Squared error of a change of each parameter by one, over all pixels and frames.

    The diagonal of J^T J by Hutchinson's estimator: with noise r of unit variance in place of a
    picture's error, the square of the gradient J^T r is that diagonal in the mean.

    Args:
        footage: The frames that show the GOP.
        gop: The state to look at.
        rng: Source of the noise.
        backend: Gives gradients.
        anchor: What the stored values are relative to; the position follows from the motion.
        frames: Most frames that are looked at.

    Returns:
        In place of each parameter its sum, squared 8-bit codes (mean of the channels).
    """
    (width, height), taus = footage.size, footage.taus
    total = {name: np.zeros_like(getattr(gop, name)) for name in Gop.__slots__}
    chosen = some_frames(len(taus), frames)
    behind = backdrop(footage.background, footage.size, footage.size, backend)
    scale = np.float32(_CODES * len(taus) / len(chosen))
    for tau in taus[chosen]:
        random = noise((height, width, 3), rng)
        gradient = backend.gradient(gop, float(tau), random, footage.size, behind)
        if anchor is not None:
            there = anchor.carried[:, None] * gradient.position
            gradient = replace(
                gradient,
                linear=gradient.linear - np.float32(anchor.start) * there,
                quadratic=gradient.quadratic - np.float32(anchor.start**2) * there,
            )
        for name, sums in total.items():
            sums += scale * np.square(getattr(gradient, name))
    return Gop(**total)


def noise(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return ones of random sign."""
    count = int(np.prod(shape))
    bits = np.unpackbits(np.frombuffer(rng.bytes(-(-count // 8)), np.uint8), count=count)
    noise: NDArray[np.float32] = (2 * bits.astype(np.float32) - 1).reshape(shape)
    return noise
