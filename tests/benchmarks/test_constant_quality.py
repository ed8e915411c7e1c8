"""The benchmarks of constant quality: what they leave behind is what they measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from tests import making
from tests.benchmarks import crf, defaults, presets
from tests.benchmarks.page_quality import quality_sections

pytestmark = pytest.mark.slow

ORIGIN = {"machine": "m", "command": "c"}
SETTINGS = ["--frames", "4", "--set", "preset=fastest", "--set", "workers=1"]


def run(command: Any, tmp_path: Path, *options: str) -> tuple[str, dict[str, Any]]:
    """Run a benchmark with the sample of Bunny; return what it prints, and what it leaves."""
    output = tmp_path / "out.json"
    result = CliRunner().invoke(
        command, [str(making.BUNNY_SMALL), *options, "--json", str(output)], catch_exceptions=False
    )
    return result.output, json.loads(output.read_text())


def test_defaults(tmp_path: Path) -> None:
    printed, left = run(defaults.main, tmp_path, *SETTINGS)
    (row,) = left["rows"]
    moving = left["moving_psnr"][making.BUNNY_SMALL.name]
    assert row["psnr_min"] < row["psnr"]
    assert moving < row["psnr"]
    assert f"{row['bpp']:8.4f}{row['psnr']:8.2f}{row['psnr_min']:8.2f}{moving:8.2f}" in printed


def test_numbers_beside_x264(tmp_path: Path) -> None:
    printed, left = run(crf.main, tmp_path, *SETTINGS, "--crf", "24", "--crf", "34")
    fine, coarse = left["rows"]
    assert fine["psnr"] > coarse["psnr"] + 1
    assert fine["bpp"] > coarse["bpp"]
    assert fine["x264_psnr"] > coarse["x264_psnr"] + 1
    assert f"{coarse['psnr']:8.2f}{'':19}{coarse['x264_psnr']:8.2f}" in printed


def test_presets_are_compared_at_equal_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(presets, "get_args", lambda _: ("fastest", "medium"))
    _, left = run(presets.main, tmp_path, "--frames", "12")
    fastest, medium = left["rows"]
    assert medium["gain"] == pytest.approx(0, abs=1e-6)
    assert fastest["gain"] < -0.3


class TestPage:
    def test_numbers(self) -> None:
        keys = ("clip", "crf", "psnr", "x264_psnr", "bpp", "x264_bpp")
        rows = [
            ("a", 24, 38, 37, 0.2, 0.1),
            ("b", 24, 36, 38, 0.1, 0.1),
            ("a", 32, 33, 34, 0.1, 0.1),
        ]
        parts = [
            [dict(zip(keys, row, strict=True)) for row in part] for part in (rows[:2], rows[2:])
        ]
        results = {f"crf-{n}": {**ORIGIN, "rows": part} for n, part in enumerate(parts)}
        lines = list(quality_sections(results))
        assert "| a | 38.0, 37.0, x2.0 | 33.0, 34.0, x1.0 |" in lines
        assert "| b | 36.0, 38.0, x1.0 | - |" in lines
        assert "| mean PSNR | 37.00, 37.50 | 33.00, 34.00 |" in lines

    def test_presets(self) -> None:
        keys = ("clip", "preset", "seconds_per_frame", "gain")
        rows = [
            ("a", "fast", 0.2, -1),
            ("b", "fast", 0.4, -2),
            ("a", "slow", 1, 1),
            ("b", "slow", 2, 0),
        ]
        common = {"frames": 24, "crf": 28.0}
        rows_of = [dict(zip(keys, row, strict=True)) for row in rows]
        lines = list(quality_sections({"presets": {**ORIGIN, "common": common, "rows": rows_of}}))
        assert "| preset | s a frame | a | b | mean |" in lines
        assert "| fast | 0.30 | -1.00 | -2.00 | -1.50 |" in lines
        assert "| slow | 1.50 | +1.00 | +0.00 | +0.50 |" in lines

    def test_nothing_measured(self) -> None:
        assert list(quality_sections({})) == []
