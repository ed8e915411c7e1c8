"""A film that turns into its Gaussians and back: `python -m tests.benchmarks.ellipses FILE.gsvr`.

Every Gaussian is an ellipse of one sigma with the colour of the picture at its centre, larger ones
behind smaller ones, at the time of the frame beside it. A border between picture and ellipses goes
over the film and back.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import av
import click
import cv2
import numpy as np
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.limits import Limits
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import Look, look_at
from gsvrcodec.model.time import normalised_time
from gsvrcodec.video import Rgb

#: Radius of an ellipse, sigmas; Gaussians of a lower opacity are not drawn.
RADIUS = 1.0
LEAST_OPACITY = 0.3
#: OpenCV takes coordinates in 1/16 pixels.
_SHIFT = 4
#: Ellipses of a larger half axis, pixels, have an outline, which is darker by this factor.
_OUTLINED, _EDGE = 1.5, 0.8
_GROUND = 24  # grey where no ellipse is


def moments(path: Path) -> Iterator[tuple[Gop, Look]]:
    """Yield the GOP of each frame, and its Gaussians as they are drawn."""
    with path.open("rb") as file:
        reader = GsvrReader(file)
        unpacker = GopUnpacker(reader, Limits())
        for position in range(len(reader.gops)):
            whole = unpacker.unpack(position)
            for tau in normalised_time(whole.pts):
                yield whole.gop, look_at(whole.gop, float(tau))


def picked(look: Look, frame: Rgb) -> NDArray[np.uint8]:
    """Return the colour of a frame at the centre of each Gaussian, (N, 3)."""
    height, width = frame.shape[:2]
    place = np.round((look.position + 1) / 2 * (width, height) - 0.5).astype(int)
    columns, rows = np.clip(place, 0, (width - 1, height - 1)).T
    return np.asarray(frame[rows, columns])


def drawn(look: Look, colours: NDArray[np.uint8], size: tuple[int, int], coded_width: int) -> Rgb:
    """Return a picture of the ellipses.

    Args:
        look: The Gaussians, N.
        colours: Of each, (N, 3).
        size: Width and height of the picture, pixels.
        coded_width: Of the coded frame, pixels.
    """
    picture = np.full((size[1], size[0], 3), _GROUND, np.uint8)
    order = np.argsort(-look.log_scale.sum(axis=1))
    order = order[np.exp(look.log_opacity[order]) >= LEAST_OPACITY]
    look = look[order]
    centres = (look.position + 1) / 2 * size - 0.5
    axes = np.maximum(RADIUS * size[0] / coded_width * np.exp(look.log_scale), 0.5)
    for centre, axis, angle, colour in zip(
        np.round(centres * 2**_SHIFT).astype(int).tolist(),
        np.round(axes * 2**_SHIFT).astype(int).tolist(),
        np.degrees(look.rotation).tolist(),
        colours[order].tolist(),
        strict=True,
    ):
        shape = centre, axis, angle, 0.0, 360.0
        cv2.ellipse(picture, *shape, colour, -1, cv2.LINE_AA, _SHIFT)
        if min(axis) > _OUTLINED * 2**_SHIFT:
            edge = [_EDGE * channel for channel in colour]
            cv2.ellipse(picture, *shape, edge, 1, cv2.LINE_AA, _SHIFT)
    return picture


def border(count: int) -> NDArray[np.float64]:
    """Return where the border is in each of so many frames, 0 = left: to the right and back."""
    return 0.5 - 0.62 * np.cos(np.arange(count) / count * 2 * np.pi)


@click.command()
@click.argument("path", metavar="FILE.gsvr", type=click.Path(path_type=Path, exists=True))
@click.option("--out", type=click.Path(path_type=Path), default=Path(), help="Directory.")
@click.option("--width", default=560, help="Of the film, pixels.")
@click.option("--start", default=0, help="First frame.")
@click.option("--frames", default=50, help="How many.")
@click.option("--step", default=2, help="Take every one of so many.")
@click.option("--quality", default=75, help="Of the WebP, up to 100.")
def main(
    path: Path,
    out: Path,
    width: int,
    start: int,
    frames: int,
    step: int,
    quality: int,
) -> None:
    """Write ellipses.webp."""
    with gsvrcodec.open(path, size=(width, -2)) as decoder:
        rate = decoder.metadata.average_rate
        size, coded = decoder.size, decoder.metadata.width
        film = decoder[start : start + step * frames : step].data.astype(np.uint8)
    found = [look for _, look in moments(path)]
    pictures = []
    for number, place in enumerate(border(frames)):
        ellipses = _ellipses(found[start + step * number], film[number], size, coded)
        pictures.append(_beside(ellipses, film[number], place))
    _write(out / "ellipses.webp", pictures, rate / step, quality)
    print(
        f"{(out / 'ellipses.webp').stat().st_size:,} bytes, {len(found[start].position)} Gaussians"
    )


def _ellipses(look: Look, frame: Rgb, size: tuple[int, int], coded_width: int) -> Rgb:
    return drawn(look, picked(look, frame), size, coded_width)


def _write(path: Path, pictures: Sequence[Rgb], rate: Fraction, quality: int) -> None:
    """Write an animation that begins anew for ever."""
    with av.open(str(path), "w", format="webp", options={"loop": "0"}) as file:
        stream = file.add_stream("libwebp_anim", rate=rate)
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"quality": str(quality), "compression_level": "6"}
        for picture in pictures:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        file.mux(stream.encode(None))


def _beside(left: Rgb, right: Rgb, place: float) -> Rgb:
    """Return two pictures with a border between them; `place` 0 = all of the right one."""
    column = round(place * left.shape[1])
    joined = right.copy()
    joined[:, : max(0, column)] = left[:, : max(0, column)]
    if 1 <= column < left.shape[1]:
        joined[:, column - 1 : column + 1] = 255
    return joined


if __name__ == "__main__":
    sys.exit(main())
