"""Pictures as AVIF: what comes back, and what is no such picture."""

from __future__ import annotations

import io
from contextlib import suppress

import av
import cv2
import imagecodecs
import numpy as np
import pytest

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes import avif
from tests.making import colour_bars

PICTURE = np.asarray(cv2.GaussianBlur(colour_bars(160, 96), (0, 0), 3), np.uint8)


def test_comes_back() -> None:
    y, cb, cr = avif.decode(avif.encode(PICTURE, 90), (160, 96)).astype(np.float64)
    red, blue = y + 1.402 * (cr - 128), y + 1.772 * (cb - 128)
    assert np.abs(red - PICTURE[..., 0]).mean() < 2
    assert np.abs(blue - PICTURE[..., 2]).mean() < 2


def test_quality() -> None:
    sizes = [len(avif.encode(PICTURE, quality)) for quality in (20, 60, 95)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[2]
    assert avif.encode(PICTURE, 60) == avif.encode(PICTURE, 60)


def test_the_quick_speed_tells_the_size() -> None:
    """Of pictures full of detail, nearly; of smooth ones it says too much."""
    noise = np.random.default_rng(0).integers(0, 256, PICTURE.shape, np.uint8)
    for picture, most in (PICTURE, 1.4), (noise, 1.1):
        size, about = (len(avif.encode(picture, 70, quick=quick)) for quick in (False, True))
        assert size < about < most * size


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (241, 135)])
def test_odd_sizes(size: tuple[int, int]) -> None:
    picture = np.asarray(cv2.resize(PICTURE, size), np.uint8)
    assert avif.decode(avif.encode(picture, 80), size).shape == (3, size[1], size[0])
    assert avif.decode(avif.encode(picture, 80), None).shape == (3, size[1], size[0])


def avif_of(pixelformat: str) -> bytes:
    return bytes(imagecodecs.avif_encode(PICTURE, level=60, pixelformat=pixelformat))


def h264() -> bytes:
    """A film of one frame that is as a plate has to be, but for its codec."""
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as output:
        stream = output.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 160, 96, "yuvj444p"
        output.mux(stream.encode(av.VideoFrame.from_ndarray(PICTURE, format="rgb24")))
        output.mux(stream.encode(None))
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "no AVIF picture"),
        (b"no picture at all", "no AVIF picture"),
        (avif.encode(PICTURE, 60)[:200], "no AVIF picture"),
        (avif.encode(PICTURE[:48], 60), "of 160x48 pixels"),
        (avif.encode(PICTURE.repeat(10, 0).repeat(10, 1), 60), "no AVIF picture"),
        (avif_of("420"), "expected 4:4:4"),
        (avif_of("400"), "expected 4:4:4"),
        (bytes(imagecodecs.png_encode(PICTURE)), "no AVIF picture"),
        (h264(), "coded as h264, expected AV1"),
    ],
    ids=["empty", "text", "cut", "size", "larger", "420", "grey", "PNG", "H.264"],
)
def test_anything_else_fails(data: bytes, says: str) -> None:
    with pytest.raises(CorruptError, match=says):
        avif.decode(data, (160, 96))


def test_a_changed_byte_raises_our_errors_alone() -> None:
    data, draw = avif.encode(PICTURE, 40), np.random.default_rng(0)
    for at in draw.integers(0, len(data), 60).tolist():
        changed = bytearray(data)
        changed[at] ^= 1 << draw.integers(8)
        with suppress(CorruptError):
            assert avif.decode(bytes(changed), (160, 96)).shape == (3, 96, 160)
