"""The regular class of pictures, in which decoders agree (spec section "Conformance")."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np

from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.model.prediction import look_at
from gsvrcodec.render.native import NativeBackend
from tests.vectors.description import Picture, gop_at


def irregular(reader: GsvrReader, picture: Picture) -> Iterator[str]:
    """Yield what keeps a picture out of the class."""
    header, size = reader.header, (picture.width, picture.height)
    coded = header.width, header.height
    if max(*size, *coded) > 4096:
        yield "a side of it"
    gop, tau = gop_at(reader, Fraction(picture.time))
    look = look_at(gop, tau)
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
    # The magnitudes, drawn with a tri-plane that leaves them as they are.
    xy = gop.xy.copy()
    xy[..., 5:] = 0
    backend = NativeBackend()
    drawn = backend.prepare(replace(gop, colour=colour, xy=xy))
    if backend.picture(drawn, tau, size, coded).max() > 32:
        yield "a sum of weights"
