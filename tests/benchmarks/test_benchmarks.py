"""The benchmarks' own sums: what diverged, memory, frames between, and the page of results."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import gsvrcodec
from gsvrcodec.metrics import psnr
from gsvrcodec.report.compare import report
from gsvrcodec.video import open_video
from tests import making
from tests.benchmarks import ranges
from tests.benchmarks.clips import diverged, summary
from tests.benchmarks.encodes import MemoryWatch, Row, measure
from tests.benchmarks.interpolation import interpolate
from tests.benchmarks.page import PAGE, RESULTS, bd_section, clips_section, page
from tests.benchmarks.readme import PAGES, ROOT, filled
from tests.benchmarks.results_read import load

ROW = Row(
    table="seeds",
    clip="a.mp4",
    size=(64, 48),
    frames=4,
    settings={"seed": 0},
    psnr=30.0,
    psnr_min=29.0,
    float_psnr=30.1,
    ssim=0.9,
    ms_ssim=None,
    bpp=0.1,
    gops=2,
    gaussians=10,
    bits_per_gaussian={"position": 10.0},
    seconds_per_frame=0.1,
    memory=None,
    psnr_gops=(30.0, 31.0),
)


TIMED = {"seconds_per_frame": 1.0, "psnr": 35.0, "psnr_min": 34.0, "float_psnr": 35.1, "bpp": 0.1}


class TestDiverged:
    def test_none(self) -> None:
        assert list(diverged([ROW, replace(ROW, psnr_gops=(27.5, 33.0))])) == []

    def test_no_number(self) -> None:
        (line,) = diverged([ROW, replace(ROW, settings={"seed": 3}, psnr=float("nan"))])
        assert "'seed': 3" in line
        assert "not a number" in line

    def test_one_gop_far_below_the_other_seeds(self) -> None:
        fallen = replace(ROW, settings={"seed": 2}, psnr_gops=(30.0, 27.9))
        (line,) = diverged([ROW, ROW, fallen])
        assert line == "a.mp4, {'seed': 2}: GOP 1 27.90 dB, 31.00 usual"

    def test_clips_are_not_mixed(self) -> None:
        assert list(diverged([ROW, ROW, replace(ROW, clip="b.mp4", psnr_gops=(9.0, 9.0))])) == []

    def test_adaptive_gops_are_set_against_the_best_length(self) -> None:
        values = {15: 30.0, 30: 31.0, "adaptive": 31.5}
        rows = [
            replace(ROW, table="gop", settings={"gop": gop}, psnr=value)
            for gop, value in values.items()
        ]
        (line,) = summary(rows)
        assert line.endswith("best fixed length 30: 31.00 dB (+0.50)")


class TestEncodes:
    def test_memory(self) -> None:
        with MemoryWatch() as before:
            pass
        with MemoryWatch() as after:
            held = np.ones(300_000_000, np.uint8)
        if before.peak is None or after.peak is None:
            pytest.skip("this system does not tell")
        assert after.peak - before.peak > 0.8 * held.nbytes

    def test_figures_are_those_of_the_file(self, tmp_path: Path) -> None:
        file = tmp_path / "a.gsvr"
        settings = {"preset": "fastest", "gaussians": 60}
        row = measure("x", making.NOISE, file, settings, {"frames": 4, "audio": False})
        found = report(making.NOISE, file)
        assert (row.psnr, row.psnr_min) == (found.psnr_rgb, found.psnr_rgb_min)
        assert (row.frames, row.size, row.settings) == (4, (160, 120), settings)
        total = sum(value for value in row.bits_per_gaussian.values() if value is not None)
        assert total * row.gaussians / 8 == pytest.approx(file.stat().st_size)
        assert len(row.psnr_gops) == row.gops


class TestInterpolation:
    def test_frames_seen_and_between(self, tmp_path: Path) -> None:
        settings = {"preset": "fastest", "gaussians": 60}
        found = interpolate(making.NOISE, (160, 120, 0, 0), 6, settings, tmp_path)
        seen = report(tmp_path / "every-second.mkv", tmp_path / "every-second.gsvr")
        assert found.train == pytest.approx(seen.psnr_rgb)
        assert len(found.train_frames) == 3
        assert len(found.test_frames) == 2
        with (
            open_video(making.NOISE, frames=6) as video,
            gsvrcodec.open(tmp_path / "every-second.gsvr") as decoder,
        ):
            shots = [shot.rgb for shot in video]
            first, second = decoder.render(0.04), decoder.render(0.12)
        expected = [
            psnr(shots[number], picture.astype(np.uint8))
            for number, picture in ((1, first), (3, second))
        ]
        assert found.test_frames == pytest.approx(expected)
        assert found.test == pytest.approx(fmean(expected))


class TestClipsPage:
    """The section of other clips."""

    CURVE = MappingProxyType(
        {
            "label": "x264 medium",
            "bd_rate": {"percent": -12.3, "low": 30.0, "high": 39.0},
        }
    )

    def lines(self, curve: Mapping[str, Any], **more: Any) -> list[str]:
        result = {"rows": [], "machine": "none", "summary": [], "refused": []}
        return list(clips_section({"clips-x": result | {"against": {"a.mp4": [curve]}} | more}))

    def test_bd_rates_by_both_metrics(self) -> None:
        lines = self.lines({**self.CURVE, "bd_rate_ms_ssim": None})
        row = "| a.mp4 | x264 medium | -12 % | 30.0 to 39.0 dB | - | no MS-SSIM in common |"
        assert row in lines

    def test_older_results_have_one(self) -> None:
        assert "| a.mp4 | x264 medium | -12 % | 30.0 to 39.0 dB |" in self.lines(self.CURVE)

    def test_qualities_at_equal_bits(self) -> None:
        other = {"psnr": 33.0, "ms_ssim_db": None}
        row = {"bpp": 0.05, "psnr": 34.0, "ms_ssim_db": 12.5, "others": {"x264 medium": other}}
        lines = self.lines(self.CURVE, at_equal_bits={"a.mp4": [row]})
        assert "| 0.0500 | 34.00, 12.50 | 33.00, - |" in lines


class TestPage:
    def test_it_is_what_the_results_say(self) -> None:
        """If this fails: python -m tests.benchmarks.page."""
        assert (PAGE / "README.md").read_text() == page(load(RESULTS))

    @pytest.mark.parametrize("name", PAGES)
    def test_pages_are_what_the_results_say(self, name: str) -> None:
        """If this fails: python -m tests.benchmarks.readme."""
        text = (ROOT / name).read_text("utf-8")
        assert "<!-- " in text
        assert text == filled(text, load(RESULTS))

    def test_rates_are_interpolated(self) -> None:
        points = [(0.02, 33.0), (0.04, 36.0), (0.2, 41.0)]
        encodes = [
            {
                "bpp": 2 * bpp,
                "quality": {"psnr_rgb": db},
                "encode_fps": 10.0 * number,
                "decode_fps": 100.0,
            }
            for number, (bpp, db) in enumerate(points, 1)
        ]
        settings = {"bpp": 0, "time_budget": 4.0}
        row = {"table": "rate", "settings": settings, "bits_per_gaussian": {"position": 1.0}}
        results = {
            "bunny-time": {
                "machine": "none",
                "rows": [{**row, "table": "time", "settings": {"time_budget": 1.0}, **TIMED}],
            },
            "bunny-zzz": {
                "machine": "none",
                "rows": [row | {"bpp": bpp, "psnr": db} for bpp, db in points],
            },
            "bunny-references": {
                "machine": "none",
                "libraries": "none",
                "curves": [
                    {
                        "label": "twice",
                        "version": "9",
                        "reference": {"codec": "x"},
                        "points": encodes,
                    }
                ],
            },
        }
        lines = page(results).splitlines()
        (bd_rate,) = (line for line in lines if line.startswith("| twice | -50 %"))
        assert "33.0 to 41.0 dB" in bd_rate
        (rates,) = (line for line in lines if line.startswith("| twice | 0.0400 "))
        assert rates.endswith("| 20 | 100 |")

    def test_means_over_clips(self) -> None:
        def curve(percent: float, similar: float | None) -> dict[str, Any]:
            similar_rate = None if similar is None else {"percent": similar}
            return {"label": "x", "bd_rate": {"percent": percent}, "bd_rate_ms_ssim": similar_rate}

        results = {
            "clips-bits-a": {"against": {"a.mp4, equal-bits": [curve(-30.0, 10.0)]}},
            "clips-bits-b": {"against": {"b.mp4, equal-bits": [curve(10.0, None)]}},
            "clips-long-a": {"against": {"a.mp4, equal-bits": [curve(-50.0, None)]}},
            "clips-other": {"against": {"c.mp4": [curve(99.0, 99.0)]}},
        }
        assert list(bd_section(results, "clips-bits-", 96))[-4:] == [
            "| a.mp4 | -30 (+10) |",
            "| b.mp4 | +10 (-) |",
            "| mean | -10 (+10) |",
            "",
        ]
        assert list(bd_section(results, "clips-long-", 240))[-3:-1] == [
            *("| a.mp4 | -50 (-) |", "| mean | -50 (-) |"),
        ]
        assert not list(bd_section({}, "clips-bits-", 96))


def test_a_seek_reads_little_more_than_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranges, "GAUSSIANS", 300)
    monkeypatch.setattr(ranges, "NEW", 20)
    result = CliRunner().invoke(ranges.main, ["--minutes", "1", "--seeks", "5"])
    assert result.exit_code == 0, result.output
    found = re.search(r"at most ([\d.]+)% more than needed", result.output)
    assert found is not None
    assert float(found[1]) < 1
