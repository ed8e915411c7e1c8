"""A GOP taken apart: `python -m tests.benchmarks.anatomy FILE.gsvr --frame N --out FILE.png`.

Panels: the picture; its Gaussians; their motion within the GOP (hue = direction, brightness =
speed); those that move against the camera, alone; planes as they are stored: colour and scale.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec.model.attributes import GopShape
from gsvrcodec.model.gop import Float32Array, Gop, grid_size
from gsvrcodec.model.prediction import look_at
from gsvrcodec.video import Rgb
from tests.benchmarks.ellipses import drawn, moments, picked
from tests.benchmarks.pictures import captioned, joined

#: Motion that is drawn as brightly as any, pixels of the coded frame from first to last frame.
_FASTEST = 60.0


def motion(gop: Gop, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a colour for the way of each Gaussian from the first to the last frame, (N, 3)."""
    way = (look_at(gop, 1.0).position - look_at(gop, -1.0).position) * np.array(size) / 2
    hue = np.degrees(np.arctan2(way[:, 1], way[:, 0])) % 360 / 2
    value = 50 + 205 * np.minimum(np.hypot(*way.T) / _FASTEST, 1)
    hsv = np.stack([hue, np.full_like(hue, 200), value], axis=1).astype(np.uint8)
    return np.asarray(cv2.cvtColor(hsv[None], cv2.COLOR_HSV2RGB)[0], np.uint8)


def planes(gop: Gop, values: Float32Array) -> Rgb:
    """Return values of all Gaussians, (N, 1) to (N, 3), as the planes that hold them."""
    width, height = GopShape(len(gop), grid_size(gop)).plane_size("gaussians")
    low, high = np.percentile(values, (2, 98))
    codes = np.clip(255 * (values - low) / (high - low), 0, 255).astype(np.uint8)
    grid = np.zeros((height * width, 3), np.uint8)
    grid[: len(gop), : values.shape[1]] = codes
    return grid.reshape(height, width, 3)


@click.command()
@click.argument("path", metavar="FILE.gsvr", type=click.Path(path_type=Path, exists=True))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="A .png or .jpg.")
@click.option("--frame", default=0, help="Which one.")
@click.option("--width", default=480, help="Of a panel, pixels.")
def main(path: Path, out: Path, frame: int, width: int) -> None:
    """Write six panels."""
    with gsvrcodec.open(path, size=(width, -2)) as decoder:
        size, coded = decoder.size, (decoder.metadata.width, decoder.metadata.height)
        picture = decoder[frame].data.astype(np.uint8)
    with gsvrcodec.open(path, size=(width, -2), layers="dynamic") as decoder:
        moving = decoder[frame].data.astype(np.uint8)
    gop, look = list(moments(path))[frame]
    panels = {
        "the picture": picture,
        f"its {len(gop)} Gaussians": drawn(look, picked(look, picture), size, coded[0]),
        "their motion: hue = direction": drawn(look, motion(gop, coded), size, coded[0]),
        "what moves against the camera": moving,
        "planes in the file: colours": _fitted(planes(gop, gop.colour), size),
        "planes in the file: scales": _fitted(planes(gop, gop.log_scale), size),
    }
    shown = [captioned(panel, text) for text, panel in panels.items()]
    rows = [joined(shown[first : first + 2], 1) for first in range(0, len(shown), 2)]
    cv2.imwrite(str(out), joined(rows, 0)[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    print(f"{out}: {out.stat().st_size:,} bytes")


def _fitted(picture: Rgb, size: tuple[int, int]) -> Rgb:
    """Return the middle of a picture that is as wide as a panel, cut to its shape."""
    height = round(picture.shape[1] * size[1] / size[0])
    top = max(0, (picture.shape[0] - height) // 2)
    return np.asarray(cv2.resize(picture[top : top + height], size), np.uint8)


if __name__ == "__main__":
    sys.exit(main())
