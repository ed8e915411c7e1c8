"""The report: figures that can be computed by hand, and files that do not belong together."""

from __future__ import annotations

import csv
import json
import logging
from pathlib import Path
from statistics import fmean

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.errors import CorruptError, NotAVideoError, UsageError
from gsvrcodec.report.compare import report
from tests import making


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """A .gsvr file and a lossless video that is brighter by one, two, ... in each frame."""
    gsvr = making.gsvr_file(tmp_path / "a.gsvr")
    with gsvrcodec.open(gsvr) as decoder:
        pictures = [
            np.where(f.data > 127, f.data - n - 1, f.data + n + 1) for n, f in enumerate(decoder)
        ]
    pictures = [picture.astype(np.uint8) for picture in pictures]
    return making.write_video(tmp_path / "a.mkv", pictures), gsvr


class TestFigures:
    def test_known_errors(self, pair: tuple[Path, Path]) -> None:
        result = report(*pair)
        expected = [20 * np.log10(255 / (n + 1)) for n in range(12)]
        pooled = 10 * np.log10(255**2 / fmean((n + 1) ** 2 for n in range(12)))
        assert [frame.psnr_rgb for frame in result.frames] == pytest.approx(expected)
        assert result.psnr_rgb == pytest.approx(fmean(expected))
        assert result.psnr_rgb_pooled == pytest.approx(pooled)
        assert result.psnr_rgb_min == pytest.approx(expected[-1])
        likeness = [frame.ssim for frame in result.frames if frame.ssim is not None]
        assert result.ssim == pytest.approx(fmean(likeness))
        assert 0.5 < min(likeness) < max(likeness) == likeness[0] < 1
        assert result.ms_ssim is None  # 32 rows are too few
        assert result.gops == 3
        assert result.bytes == pair[1].stat().st_size
        assert result.bpp == 8 * result.bytes / (12 * 48 * 32)
        assert [frame.frame for frame in result.frames] == list(range(12))

    def test_copied_streams_are_left_out_of_bpp(self, tmp_path: Path) -> None:
        plain = making.gsvr_file(tmp_path / "a.gsvr")
        sound = making.gsvr_file(tmp_path / "b.gsvr", auxiliary={b"strm": bytes(5000)})
        with gsvrcodec.open(plain) as one, gsvrcodec.open(sound) as other:
            assert other.metadata.streams_bytes == 5020
            # One more entry in the index.
            assert 0 < other.metadata.bpp - one.metadata.bpp < 8 * 64 / (12 * 48 * 32)

    def test_json(self, pair: tuple[Path, Path]) -> None:
        result = report(*pair)
        data = json.loads(result.to_json())
        assert data["bytes"] == result.bytes
        assert data["bpp"] == result.bpp
        assert data["psnr_rgb"] == result.psnr_rgb
        assert [f["psnr_rgb"] for f in data["frames"]] == [f.psnr_rgb for f in result.frames]

    def test_csv(self, pair: tuple[Path, Path]) -> None:
        result = report(*pair)
        rows = list(csv.DictReader(result.to_csv().splitlines()))
        assert list(rows[0]) == ["frame", "pts", "seconds", "psnr_rgb", "ssim", "ms_ssim"]
        assert [float(row["psnr_rgb"]) for row in rows] == [f.psnr_rgb for f in result.frames]
        assert rows[3]["pts"] == "1536"


class TestSettingsOfTheFile:
    def test_crop_and_start_are_used(self, tmp_path: Path) -> None:
        crop = [48, 32, None, 10]
        settings = {"crop": crop, "start_frame": 5}
        gsvr = making.gsvr_file(
            tmp_path / "a.gsvr", times=[(1024 * n, 1024) for n in range(5, 17)], settings=settings
        )
        result = report(making.NOISE, gsvr)
        assert len(result.frames) == 12
        given = report(making.NOISE, gsvr, crop=(48, 32, None, 10), start_frame=5)
        assert given == result
        moved = report(making.NOISE, gsvr, crop=(48, 32, 0, 0))
        assert moved.psnr_rgb != result.psnr_rgb

    @pytest.mark.parametrize("crop", [None, 7, [1, 2], ["a", 1, 2, 3], {"w": 1}, [True, 1, 1, 1]])
    def test_nonsense_is_ignored(self, tmp_path: Path, crop: object) -> None:
        settings = {"crop": crop, "start_frame": "x"}
        gsvr = making.gsvr_file(tmp_path / "a.gsvr", size=(160, 120), settings=settings)
        assert len(report(making.NOISE, gsvr).frames) == 12


class TestOtherSources:
    def test_other_size_fails(self, pair: tuple[Path, Path]) -> None:
        with pytest.raises(UsageError, match=r"pictures of 160x120, the file has 48x32"):
            report(making.NOISE, pair[1])

    def test_too_short_fails(self, pair: tuple[Path, Path]) -> None:
        with pytest.raises(UsageError, match="ends after 10 of the 12 frames"):
            report(pair[0], pair[1], start_frame=2)

    def test_other_times_are_warned_of(
        self, pair: tuple[Path, Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        late = making.gsvr_file(tmp_path / "b.gsvr", times=[(n + 9, 1) for n in range(12)])
        with caplog.at_level(logging.WARNING):
            report(pair[0], late)
        assert caplog.text.count("the source?") == 1

    def test_text_fails(self, pair: tuple[Path, Path], tmp_path: Path) -> None:
        text = tmp_path / "a.txt"
        text.write_text("no video\n")
        with pytest.raises(NotAVideoError):
            report(text, pair[1])
        with pytest.raises(CorruptError):
            report(pair[0], text)
