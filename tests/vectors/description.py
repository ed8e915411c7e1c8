"""What a decoder must find in a file: fields, hashes of values, and pictures in binary64."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.gop_chain import GopUnpacker, WholeGop
from gsvrcodec.bitstream.gop_payload import GopContent, unpack_gop, unpack_plate
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import MODE, attributes_of
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.time import time_at
from gsvrcodec.render.backend import Backend, Codes


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture to decode."""

    file: str  #: name of the PNG
    time: str  #: ticks, a fraction
    width: int  #: pixels
    height: int  #: pixels
    bits: int  #: of a sample


def description(name: str, data: bytes) -> dict[str, object]:
    """Header, chunks, timing and hashes of all coded values, and the pictures that are compared."""
    with GsvrReader(io.BytesIO(data), Limits()) as reader:
        header = asdict(reader.header)
        header["time_base"] = str(header["time_base"])
        header["sample_aspect"] = str(header["sample_aspect"])
        return {
            "header": header,
            "chunks": [[chunk.name, chunk.offset, chunk.size] for chunk in reader.chunks],
            "gops": gops_of(reader),
            "pictures": [asdict(picture) for picture in pictures_of(name, reader)],
        }


def gops_of(reader: GsvrReader) -> list[dict[str, object]]:
    """Timing and hashes of all values of each GOP."""
    found = []
    for position in range(len(reader.gops)):
        content = unpack_gop(reader.read_gop(position), reader.header, Limits())
        found.append(
            {
                "first_frame": content.first_frame,
                "reference": content.reference,
                "pts": content.pts.tolist(),
                "durations": content.durations.tolist(),
                "values": {
                    name: {"shape": list(array.shape), "sha256": _digest(array)}
                    for name, array in _values(content, reader.header.blending)
                },
            }
        )
    return found


def _values(content: GopContent, blending: Blending) -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Attributes that have samples, and their values: the last axis holds the components.

    A plate that the GOP stores stands first.
    """
    if content.plate is not None:
        yield "plate", unpack_plate(content.plate).ycc.transpose(1, 2, 0)
    for attribute in attributes_of(blending):
        if attribute is MODE or attribute.change_of:
            if content.carried is None:
                return
            array = getattr(content.carried, attribute.change_of or attribute.name)
        else:
            array = getattr(content.new, attribute.name)
        if not array.size:
            continue
        if attribute is not MODE:
            array = array[:, None] if array.ndim == 1 else array[..., : attribute.components]
        yield attribute.name, array


def _digest(array: NDArray[np.generic]) -> str:
    return hashlib.sha256(array.astype(array.dtype.newbyteorder("<")).tobytes()).hexdigest()


def pictures_of(name: str, reader: GsvrReader) -> list[Picture]:
    """The first and the last frame, and a moment between two frames at another size."""
    header, gops = reader.header, reader.gops
    size, bits = (header.width, header.height), max(8, header.bit_depth)
    longest = max(gops, key=lambda gop: gop.last_pts - gop.start_pts)
    between = longest.start_pts + Fraction(longest.last_pts - longest.start_pts, 3)
    other = max(1, 2 * header.width // 3), 5 * header.height // 4
    wanted = [(Fraction(gops[0].start_pts), size), (Fraction(gops[-1].last_pts), size)]
    if longest.frames > 1:
        wanted.append((between, other))
    return [
        Picture(f"{name}-{number}.png", str(time), *shape, bits)
        for number, (time, shape) in enumerate(dict.fromkeys(wanted))
    ]


def render(reader: GsvrReader, picture: Picture, backend: Backend) -> Codes:
    """The codes of a picture, (H, W, 3), uint8 or uint16."""
    whole, tau = gop_at(reader, Fraction(picture.time))
    backend = backend.over(whole.plate)
    codes: Codes = backend.render(
        backend.prepare(whole.gop),
        np.array([tau], np.float32),
        (picture.width, picture.height),
        (reader.header.width, reader.header.height),
        bit_depth=picture.bits,
    )[0]
    return codes


def gop_at(reader: GsvrReader, time: Fraction) -> tuple[WholeGop, float]:
    """The GOP that is shown at a time, ticks, and its normalised time tau."""
    gops = enumerate(reader.gops)
    position = next(n for n, gop in gops if gop.start_pts <= time <= gop.last_pts)
    whole = GopUnpacker(reader, Limits()).unpack(position)
    return whole, float(time_at(whole.pts, time))
