"""Films made in memory: random Gaussians, and a disc that flies over a textured ground."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import NamedTuple

import imagecodecs
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.bitstream.header import Header
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Gop
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.prediction import CHANGED, DROPPED, MOVED, Carried, start_of_motion
from gsvrcodec.model.quantise import Precision
from gsvrcodec.model.reconstruction import MOST_LOG_OPACITY, Blending
from gsvrcodec.model.static import select_gaussians, static_gop
from gsvrcodec.planes import PACKS

#: Of whose steps 0 and 1 are multiples, so that still Gaussians are still when decoded.
_EXACT: Precision = {"indicator": (2**-10,), "linear": (2**-12,) * 2, "quadratic": (2**-12,) * 2}
_PRECISION: Precision = {**{attribute.name: 16 for attribute in ATTRIBUTES}, **_EXACT}
_TICKS = 40


class Part(NamedTuple):
    """A GOP, or what a predicted one stores."""

    gop: Gop
    frames: int
    carried: Carried | None = None
    plate: bytes | None = None


def film(parts: Sequence[Part], size: tuple[int, int], blending: Blending) -> bytes:
    """Return the file of GOPs, each predicted from the one before where `carried` is given."""
    file = io.BytesIO()
    header = Header(width=size[0], height=size[1], time_base=Fraction(1, 1000), blending=blending)
    first = 0
    with GsvrWriter(file, header) as writer:
        for number, (gop, frames, carried, plate) in enumerate(parts):
            payload = pack_gop(
                gop,
                _TICKS * np.arange(first, first + frames),
                np.full(frames, _TICKS),
                first,
                _PRECISION,
                PACKS["deflate"],
                reference=0 if carried is None else parts[number - 1].frames,
                carried=carried,
                blending=blending,
                plate=plate,
            )
            writer.add_gop(payload)
            first += frames
    return file.getvalue()


#: Width and height of the film of `random_film`.
RANDOM_SIZE = (64, 48)


def random_plate(
    seed: int, size: tuple[int, int] = RANDOM_SIZE, *, shade: int = 0, pixelformat: str = "444"
) -> bytes:
    """Return a plate of random colours, which are lighter by `shade`."""
    width, height = size
    draw = np.random.default_rng(seed)
    coarse = draw.integers(32, 192, (-(-height // 8), -(-width // 8), 3), np.uint8)
    blocks = np.kron(coarse, np.ones((8, 8, 1), np.uint8))[:height, :width]
    picture = (blocks ^ draw.integers(0, 32, blocks.shape, np.uint8)) + np.uint8(shade)
    return bytes(imagecodecs.avif_encode(picture, level=95, speed=6, pixelformat=pixelformat))


def plates_alone() -> bytes:
    """Return a film of two key GOPs without Gaussians, of which each has its plate."""
    none = _random_gop(np.random.default_rng(0), "mean", 0, 1)
    parts = [Part(none, 4, plate=random_plate(1, shade=shade)) for shade in (0, 20)]
    return film(parts, RANDOM_SIZE, "mean")


def random_film(
    blending: Blending, *, spread: float = 2, frames: int = 4, plates: Sequence[bytes | None] = ()
) -> bytes:
    """Return a film of 64x48 of three GOPs, of which the second is predicted.

    Args:
        blending: How pictures are formed.
        spread: Standard deviation of the logarithms of the opacities.
        frames: Frames of each GOP.
        plates: Those of the first and the third GOP, none = neither has one.
    """
    first, last = plates or (None, None)
    draw = np.random.default_rng(3)
    mode = (draw.permutation(400) % (DROPPED + 1)).astype(np.uint8)
    changed, moved = (int(np.count_nonzero(mode & bit)) for bit in (CHANGED, MOVED))
    changes = _random_gop(draw, blending, changed, spread)
    motions = _random_gop(draw, blending, moved, spread)
    small = np.float32(1 / 8)
    carried = Carried(
        mode,
        small * changes.position,
        small * changes.log_scale,
        small * changes.rotation,
        small * changes.colour,
        small * changes.log_opacity,
        motions.indicator,
        motions.linear,
        motions.quadratic,
    )
    parts = [
        Part(_random_gop(draw, blending, 400, spread), frames, plate=first),
        Part(_random_gop(draw, blending, 60, spread), frames, carried),
        Part(_random_gop(draw, blending, 400, spread), frames, plate=last),
    ]
    return film(parts, RANDOM_SIZE, blending)


def _random_gop(draw: np.random.Generator, blending: Blending, count: int, spread: float) -> Gop:
    """Gaussians on all levels of the pyramid, a third of them still, and a tri-plane."""
    still = draw.uniform(size=(count, 1)) < 1 / 3
    brightest = 1 if blending == "mean" else 1 / 8
    arrays: dict[str, NDArray[np.float64]] = {
        "position": draw.uniform(-1, 1, (count, 2)),
        "log_scale": draw.normal(1, 0.8, (count, 2)),
        "rotation": draw.uniform(0, 3, count),
        "colour": draw.uniform(0, brightest, (count, 3)),
        "log_opacity": draw.normal(0, spread, count).clip(-MOST_LOG_OPACITY, MOST_LOG_OPACITY),
        "indicator": np.where(still[:, 0], 1, draw.uniform(0, 1, count)),
        "linear": np.where(still, 0, draw.normal(0, 0.05, (count, 2))),
        "quadratic": np.where(still, 0, draw.normal(0, 0.02, (count, 2))),
        "xy": draw.normal(0, 0.1, (2, 3, TRIPLANE_CHANNELS)),
        "xt": draw.normal(1, 0.1, (4, 3, TRIPLANE_CHANNELS)),
        "yt": draw.normal(1, 0.1, (4, 2, TRIPLANE_CHANNELS)),
    }
    return Gop(**{name: np.ascontiguousarray(a, np.float32) for name, a in arrays.items()})


#: Width and height of the film of `flight`, and frames of each of its three GOPs.
FLIGHT_SIZE = (160, 90)
FLIGHT_FRAMES = 8


def flight(*, with_disc: bool) -> bytes:
    """Return a film of three GOPs: over a textured ground flies a white disc, and a red one back.

    The second GOP is predicted; it takes most Gaussians of the white disc over and replaces three.

    Args:
        with_disc: Whether the white disc is there; the red one is.
    """
    draw = np.random.default_rng(0)
    ground = _ground(draw)
    # Ways from the middle of a GOP to its last frame; from GOP to GOP it is more by a frame.
    way, back = np.array([0.2, 0]), np.array([-0.15, 0.05])
    step = 1 - start_of_motion(FLIGHT_FRAMES)
    white = [_disc((-0.6 + n * step * way[0], -0.4), way, (1, 1, 1)) for n in range(3)]
    red = [_disc(np.array([0.5, 0.3]) + n * step * back, back, (1, 0, 0)) for n in range(3)]
    replaced = np.arange(len(white[0])) < 3
    if not with_disc:
        white = [select_gaussians(each, np.zeros(len(each), np.bool_)) for each in white]
        replaced = replaced[:0]
    keys = [_together(white[n], red[n], ground) for n in range(3)]
    # As packed: from the top strip down.
    order = strip_order(keys[0].position)
    modes = np.where(keys[0].linear.any(1), MOVED, 0).astype(np.uint8)
    modes[: len(replaced)][replaced] = DROPPED
    moved = np.flatnonzero(modes[order] == MOVED)
    first = select_gaussians(keys[1], order[moved])
    none = np.zeros((0, 2), np.float32)
    carried = Carried(
        mode=modes[order],
        position=none,
        log_scale=none,
        rotation=none[:, 0],
        colour=np.zeros((0, 3), np.float32),
        log_opacity=none[:, 0],
        indicator=first.indicator,
        linear=first.linear,
        quadratic=first.quadratic,
    )
    new = select_gaussians(white[1], replaced)
    parts = [
        Part(keys[0], FLIGHT_FRAMES),
        Part(new, FLIGHT_FRAMES, carried),
        Part(keys[2], FLIGHT_FRAMES),
    ]
    return film(parts, FLIGHT_SIZE, "mean")


def _ground(draw: np.random.Generator) -> Gop:
    """Still Gaussians of random colours, 5 pixels apart."""
    y, x = np.mgrid[-1:1:19j, -1:1:33j].reshape(2, -1)
    count = len(x)
    return static_gop(
        np.stack([x, y], 1).astype(np.float32),
        np.full((count, 2), np.log(4), np.float32),
        np.zeros(count, np.float32),
        draw.uniform(0, 0.5, (count, 3)).astype(np.float32),
        draw.normal(0, 0.5, count).astype(np.float32),
    )


def _disc(place: ArrayLike, way: NDArray[np.float64], colour: tuple[int, int, int]) -> Gop:
    """Opaque Gaussians of one colour around a place, which all go one way."""
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    half = np.array(FLIGHT_SIZE) / 2
    centre = np.asarray(place) + np.stack([np.cos(angle), np.sin(angle)], 1) * 6 / half
    gop = static_gop(
        centre.astype(np.float32),
        np.full((12, 2), np.log(3), np.float32),
        np.zeros(12, np.float32),
        np.tile(np.array(colour, np.float32), (12, 1)),
        np.full(12, 6, np.float32),
    )
    return replace(gop, linear=np.tile(way.astype(np.float32), (12, 1)))


def _together(*gops: Gop) -> Gop:
    """Return a GOP with the Gaussians of several."""
    joined = {
        name: np.concatenate([getattr(gop, name) for gop in gops])
        for name in (attribute.name for attribute in ATTRIBUTES if attribute.grid == "gaussians")
    }
    return replace(gops[0], **joined)
