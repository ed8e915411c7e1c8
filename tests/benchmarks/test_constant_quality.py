"""The benchmarks of constant quality: what they leave behind is what they measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from tests import making
from tests.benchmarks import crf, defaults, presets

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
    _, left = run(presets.main, tmp_path, "--frames", "4")
    fastest, medium = left["rows"]
    assert medium["gain"] == pytest.approx(0, abs=1e-6)
    assert fastest["gain"] < -0.3
