"""Colour: what is written comes back, in 8 and in 10 bits, for every matrix and range."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.bitstream.header import ColourInfo
from gsvrcodec.video import OutputInfo, open_video, open_writer
from tests import making

#: Odd in width, so that it is written with a chroma sample for every pixel.
WIDTH, HEIGHT = 161, 96

#: CICP matrix, and the shares of red and blue in its luma.
MATRICES = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}

each_matrix = pytest.mark.parametrize("matrix", MATRICES)
each_range = pytest.mark.parametrize("full", [False, True], ids=["limited", "full"])


def picture(bits: int) -> NDArray[np.uint16]:
    """Return saturated bars, ramps of grey and of each primary, and random colours."""
    top = 2**bits - 1
    bars = np.array([[r, g, b] for r in (0, top) for g in (0, top) for b in (0, top)])
    rows = [bars[np.arange(WIDTH) * 8 // WIDTH]]
    ramp = np.linspace(0, top, WIDTH).round()
    rows += [
        ramp[:, None] * np.array(mask) for mask in ((1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    ]
    rows += [np.random.default_rng(1).integers(0, top + 1, (WIDTH, 3))]
    return np.repeat(np.array(rows), HEIGHT // 6, 0).astype(np.uint16)


def written(path: Path, rgb: NDArray[np.uint16], bits: int, colour: ColourInfo) -> Path:
    """Write a picture without loss, but for the way to YCbCr."""
    info = OutputInfo(
        width=rgb.shape[1],
        height=rgb.shape[0],
        time_base=Fraction(1, 25),
        rate=Fraction(25),
        frames=1,
        bit_depth=bits,
        colour=colour,
        crf=0,
    )
    with open_writer(path, info) as writer:
        writer.write(rgb.astype(np.uint8) if bits == 8 else rgb, 0, 1)
    return path


def first_frame(path: Path) -> av.VideoFrame:
    """Decode the first frame."""
    with av.open(str(path)) as container:
        return next(container.decode(video=0))


def by_definition(frame: av.VideoFrame, matrix: int, full: bool) -> NDArray[np.float64]:
    """Convert a frame of 10 bits to RGB as H.273 defines it, 0 to 1023."""
    planes = [
        np.frombuffer(bytes(plane), "<u2").reshape(plane.height, -1)[:, : plane.width]
        for plane in frame.planes
    ]
    luma, cb, cr = (
        values.repeat(frame.height // values.shape[0], 0)
        .repeat(frame.width // values.shape[1], 1)
        .astype(np.float64)
        for values in planes
    )
    kr, kb = MATRICES[matrix]
    y = luma / 1023 if full else (luma - 64) / 876
    pb, pr = ((c - 512) / (1023 if full else 896) for c in (cb, cr))
    r, b = y + 2 * (1 - kr) * pr, y + 2 * (1 - kb) * pb
    g = (y - kr * r - kb * b) / (1 - kr - kb)
    return 1023 * np.stack([r, g, b], 2)


@each_matrix
@each_range
def test_8_bits_within_two_code_values(tmp_path: Path, matrix: int, full: bool) -> None:
    rgb = picture(8)
    path = written(tmp_path / "a.mp4", rgb, 8, ColourInfo(1, 1, matrix, full))
    video = open_video(path)
    assert np.abs(next(iter(video)).rgb.astype(int) - rgb).max() <= 2
    assert video.info.colour == ColourInfo(1, 1, matrix, full)
    assert video.info.bit_depth == 8


@each_matrix
@each_range
@pytest.mark.parametrize("suffix", [".mp4", ".y4m"])
def test_10_bits_within_two_code_values(
    tmp_path: Path, matrix: int, full: bool, suffix: str
) -> None:
    rgb = picture(10)
    path = written(tmp_path / f"a{suffix}", rgb, 10, ColourInfo(9, 16, matrix, full))
    frame = first_frame(path)
    assert frame.format.name == "yuv444p10le"
    assert np.abs(by_definition(frame, matrix, full) - rgb).max() <= 2
    if suffix == ".mp4":
        info = open_video(path).info
        assert (info.codec, info.bit_depth) == ("hevc", 10)
        assert info.colour == ColourInfo(9, 16, matrix, full)


def test_10_bits_read_as_8(tmp_path: Path) -> None:
    rgb = picture(10)
    path = written(tmp_path / "a.mp4", rgb, 10, ColourInfo(1, 1, 1, False))
    read = next(iter(open_video(path))).rgb
    assert np.abs(read - rgb / 1023 * 255).max() <= 2


@pytest.mark.parametrize("suffix", [".mp4", ".y4m"])
def test_10_bits_with_a_chroma_sample_for_four_pixels(tmp_path: Path, suffix: str) -> None:
    rgb = picture(10)[::2, :80].repeat(2, 0).repeat(2, 1)
    path = written(tmp_path / f"a{suffix}", rgb, 10, ColourInfo(9, 18, 9, False))
    frame = first_frame(path)
    assert frame.format.name == "yuv420p10le"
    assert np.abs(by_definition(frame, 9, full=False) - rgb).max() <= 2


def test_10_bits_without_loss(tmp_path: Path) -> None:
    rgb = picture(10)
    frame = first_frame(written(tmp_path / "a.mkv", rgb, 10, ColourInfo(9, 16, 9, False)))
    assert frame.format.name == "gbrp10le"
    assert np.array_equal(frame.to_ndarray(), rgb)
    assert (frame.color_primaries, frame.color_trc) == (9, 16)


def test_10_bits_as_png(tmp_path: Path) -> None:
    rgb = picture(10)
    frame = first_frame(written(tmp_path / "a.png", rgb, 10, ColourInfo()))
    assert frame.format.name == "rgb48be"
    read = frame.to_ndarray().astype(np.uint16)
    assert np.array_equal(read >> 6, rgb)
    assert read.max() == 65535


def test_10_bits_of_a_tiny_picture(tmp_path: Path) -> None:
    rgb = picture(10)[:4, :6]
    path = written(tmp_path / "a.mp4", rgb, 10, ColourInfo(1, 1, 1, False))
    assert first_frame(path).format.name == "yuv420p10le"


@pytest.mark.parametrize("matrix", [2, 8])
def test_unknown_matrices_are_there_and_back(tmp_path: Path, matrix: int) -> None:
    """Without a tag that is known, the YCbCr of the source comes back, and so does the tag."""
    source = written(tmp_path / "a.mp4", picture(8), 8, ColourInfo(matrix=matrix))
    video = open_video(source)
    rgb = next(iter(video)).rgb
    again = written(tmp_path / "b.mp4", rgb.astype(np.uint16), 8, video.info.colour)
    first, second = first_frame(source), first_frame(again)
    assert first.colorspace == second.colorspace == matrix
    assert np.abs(first.to_ndarray().astype(int) - second.to_ndarray()).max() <= 1


def test_rgb_sources_become_bt601(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mp4", picture(8), 8, ColourInfo(matrix=0))
    assert open_video(path).info.colour.matrix == 6


def test_grey(tmp_path: Path) -> None:
    grey = np.linspace(0, 255, 64).astype(np.uint8)[None].repeat(48, 0)
    with av.open(str(tmp_path / "a.mkv"), "w") as file:
        stream = file.add_stream("ffv1", rate=25)
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "gray"
        file.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="gray")))
        file.mux(stream.encode(None))
    read = next(iter(open_video(tmp_path / "a.mkv"))).rgb
    assert np.abs(read - grey[:, :, None].astype(int)).max() <= 1


def test_sources_of_10_bits_are_recorded() -> None:
    depths = [open_video(path).info.bit_depth for path in (making.TEN_BIT, making.BUNNY_SMALL)]
    assert depths == [10, 8]
