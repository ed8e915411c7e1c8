"""The regular class of pictures, in which decoders agree (spec section "Conformance")."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np
import torch
from numpy.typing import NDArray

from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import look_at
from gsvrcodec.model.pyramid import level_size
from gsvrcodec.model.reconstruction import CUTOFF, GROUND, LEVELS
from gsvrcodec.render.backend import Size
from gsvrcodec.render.native import NativeBackend
from gsvrcodec.render.reference import ReferenceBackend, Splats, deform, upsample
from tests.vectors.description import Picture, gop_at

#: Longest side of a picture, and what the longest side times a sample's sensitivity may be, pixels.
_SIDE = 4096
#: Largest sensitivity of a regular sample.
_SENSITIVITY = 64
#: Gaussians count where e is over this: a decoder may take it for more than 1/64.
_COUNTED = 255 / 16384


def irregular(reader: GsvrReader, picture: Picture) -> Iterator[str]:
    """Yield what keeps a picture out of the class, or a sample of it from being regular."""
    header, size = reader.header, (picture.width, picture.height)
    coded = header.width, header.height
    if max(*size, *coded) > _SIDE:
        yield "a side of it"
    whole, tau = gop_at(reader, Fraction(picture.time))
    gop, plate = whole.gop, None
    if whole.plate is not None:
        plate = whole.plate.sums(size)[..., :3].astype(np.float64)
    look = look_at(gop, tau, header.blending)
    if not (np.abs(look.position) <= 4).all():
        yield "a centre"
    scale, angle = np.exp(look.log_scale.max(axis=1, initial=-32)), np.abs(look.rotation)
    if (scale > max(coded)).any():
        yield "a scale"
    if not ((angle * scale <= 2**13) | (angle <= 4)).all():
        yield "an angle"
    colour = np.abs(look.colour)
    if (colour > 8).any():
        yield "a colour"
    if header.blending == "mean":
        if not regular_samples(gop, tau, size, coded, plate).all():
            yield "a sensitive sample"
        return
    # The magnitudes, drawn with a tri-plane that leaves them as they are.
    xy = gop.xy.copy()
    xy[..., 5:] = 0
    backend = NativeBackend(blending="sum")
    drawn = backend.prepare(replace(gop, colour=colour, xy=xy))
    if backend.picture(drawn, tau, size, coded).max() > 32:
        yield "a sum of weights"


def regular_samples(
    gop: Gop,
    tau: float,
    size: Size,
    coded_size: Size,
    plate: NDArray[np.float64] | None = None,
) -> NDArray[np.bool_]:
    """Return which samples of a mean, (H, W, 3), decoders agree in."""
    most = min(_SENSITIVITY, _SIDE / max(*size, *coded_size))
    return sensitivity(gop, tau, size, coded_size, plate) <= most


def sensitivity(
    gop: Gop,
    tau: float,
    size: Size,
    coded_size: Size,
    plate: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return the most that samples of a mean change, (H, W, 3), for a relative change of each e.

    An upper bound: by the root of the mean square of the differences to the picture. A plate has
    the colours (H, W, 3) with which it is drawn at the size of the picture.
    """
    splats = deform(ReferenceBackend().prepare(gop), tau, size, coded_size)
    share, colour = splats.factors[:, 3:], splats.factors[:, :3] / splats.factors[:, 3:]
    of_weight = splats.factors
    of_e = share * torch.cat([torch.ones_like(share), colour, colour**2], 1)
    sums = torch.zeros(*reversed(level_size(size, LEVELS - 1)), 11, dtype=torch.float64)
    for level in reversed(range(LEVELS)):
        own = level_size(size, level)
        sums = sums if level == LEVELS - 1 else upsample(sums, own)
        for n in torch.nonzero(splats.level == level).flatten().tolist():
            rows, columns, e = _drawn(splats, n, own)
            weight = (e - CUTOFF).clamp(min=0)
            counted = torch.where(e > _COUNTED, e, 0.0)
            sums[rows, columns, :4] += weight[:, :, None] * of_weight[n]
            sums[rows, columns, 4:] += counted[:, :, None] * of_e[n]
    total, weight = sums[..., :3], sums[..., 3:4] + GROUND
    if plate is not None:
        total, weight = total + torch.from_numpy(plate), weight + 1
    picture = total / weight
    counted, first, second = sums[..., 4:5], sums[..., 5:8], sums[..., 8:]
    spread = second - 2 * picture * first + picture**2 * counted
    found: NDArray[np.float64] = ((counted * spread.clamp(min=0)).sqrt() / weight).numpy()
    return found


def _drawn(splats: Splats, n: int, size: Size) -> tuple[slice, slice, torch.Tensor]:
    """Return the rows and columns of a level where a Gaussian counts, and its e there."""
    centre, covariance = splats.centre[n], splats.covariance[n]
    reach = (2 * math.log(1 / _COUNTED) * covariance.diagonal()).sqrt()
    first = (centre - reach).floor().clamp(min=0).int().tolist()
    end = (centre + reach).ceil().int().tolist()
    columns, rows = (slice(a, max(a, min(b, c))) for a, b, c in zip(first, end, size, strict=True))
    x = torch.arange(columns.start, columns.stop, dtype=torch.float64) + 0.5 - centre[0]
    y = torch.arange(rows.start, rows.stop, dtype=torch.float64)[:, None] + 0.5 - centre[1]
    inverse = torch.linalg.inv(covariance)
    squared = inverse[0, 0] * x * x + 2 * inverse[0, 1] * x * y + inverse[1, 1] * y * y
    return rows, columns, torch.exp(-squared / 2)
