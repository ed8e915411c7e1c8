"""Settings: what contradicts itself is refused by the name of the option."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any, get_type_hints

import pytest

import gsvrcodec
from gsvrcodec.encoder.settings import DEFAULT_CRF, EncodeOptions, EncodeSettings
from gsvrcodec.errors import UsageError


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"params": 3_000_000, "time_budget": 2.0},
        {"gaussians": 1, "preset": "slowest"},
        {"gop": 1},
        {"bpp": 0.05, "time_budget": 2.0},
        {"bitrate": 1_500_000, "workers": 2},
        {"target_size": 10_000_000},
        {"target_psnr": 38.5},
        {"crf": 23.5},
        {"crf": 0},
        {"gop_min": 7, "gop_max": 7},
        {"keyint": 0, "target_psnr": 30.0},
        {"keyint": 0.25},
        {"profile": "paper", "deform": "triplane", "pack": "png", "qat": False},
        {"crop": (16, 16, None, None), "start_frame": 3, "frames": 1},
        {"crop": [16, 16, 0, 0]},
    ],
)
def test_good(settings: dict[str, Any]) -> None:
    assert EncodeSettings(**settings).recorded()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"params": 1, "gaussians": 1}, "`params` and `gaussians` exclude each other"),
        ({"preset": "slow", "time_budget": 1.0}, "`preset` and `time_budget` exclude each other"),
        ({"bpp": 0.1, "bitrate": 1000}, "`bpp` and `bitrate` exclude each other; give one"),
        ({"params": 9, "target_size": 9}, "`params` and `target_size` exclude each other"),
        ({"target_psnr": 38, "profile": "paper"}, "cannot meet `target_psnr`"),
        ({"crf": 23, "bpp": 0.1}, "`crf` and `bpp` exclude each other; give one"),
        ({"crf": 23, "params": 9}, "`params` and `crf` exclude each other; give one"),
        ({"crf": 23, "profile": "paper"}, "cannot meet `crf`"),
        ({"crf": -1}, "`crf` must be 0 to 51, not -1"),
        ({"crf": 51.5}, "`crf` must be 0 to 51, not 51.5"),
        ({"crf": float("nan")}, "`crf` must be 0 to 51, not nan"),
        ({"bpp": 0.0}, "`bpp` must be above 0 bits a pixel, not 0.0"),
        ({"target_psnr": float("nan")}, "`target_psnr` must be above 0 dB"),
        ({"target_size": 0}, "`target_size` must be above 0 bytes, not 0"),
        ({"bitrate": -5}, "`bitrate` must be above 0 bits a second"),
        ({"workers": -1}, "`workers` must be at least 0"),
        ({"gop_min": 9, "gop_max": 8}, "`gop_min=9` is more than `gop_max=8`"),
        ({"preset": "quick"}, "`preset` must be one of fastest, medium, slow, slowest"),
        ({"profile": "ours"}, "`profile` must be one of main, paper, not 'ours'"),
        ({"deform": "none"}, "`deform` must be one of hybrid, triplane, polynomial"),
        ({"flow": "farneback"}, "`flow` must be one of dis, raft"),
        ({"pack": "zip"}, "`pack` must be one of auto, entropy, jxl, png, deflate"),
        ({"gop": "shot"}, "`gop` must be 'adaptive' or a number of frames"),
        ({"gop": 12.5}, "`gop` must be 'adaptive' or a number of frames, not 12.5"),
        ({"gop": 0}, "`gop` must be at least 1"),
        ({"crf": "high"}, "`crf` must be a number, not 'high'"),
        ({"crf": True}, "`crf` must be a number, not True"),
        ({"frames": 2.5}, "`frames` must be a whole number, not 2.5"),
        ({"keyint": None}, "`keyint` must be a number, not None"),
        ({"audio": "no"}, "`audio` must be True or False, not 'no'"),
        ({"device": 0}, "`device` must be text, not 0"),
        ({"crop": (64, 48)}, "`crop` must be \\(width, height, x, y\\) in pixels"),
        ({"crop": "64:48"}, "`crop` must be \\(width, height, x, y\\) in pixels, .*, not '64:48'"),
        ({"gop_min": 0}, "`gop_min` must be at least 1"),
        ({"params": 0}, "`params` must be at least 1"),
        ({"gaussians": -5}, "`gaussians` must be at least 1, not -5"),
        ({"gaussians": 2**24 + 1}, "`gaussians` must be at most 16777216, not 16777217"),
        ({"gop": 10**9}, "`gop` must be at most"),
        ({"gop_max": 10**9}, "`gop_max` must be at most"),
        ({"frames": 0}, "`frames` must be at least 1"),
        ({"start_frame": -1}, "`start_frame` must be at least 0"),
        ({"seed": -1}, "`seed` must be at least 0"),
        ({"threads": -1}, "`threads` must be at least 0"),
        ({"keyint": -0.5}, "`keyint` must be 0 or more seconds, not -0.5"),
        ({"keyint": float("inf")}, "`keyint` must be 0 or more seconds"),
        ({"keyint": float("nan")}, "`keyint` must be 0 or more seconds"),
        ({"time_budget": 0.0}, "`time_budget` must be above 0"),
        ({"time_budget": float("inf")}, "`time_budget` must be above 0"),
        ({"time_budget": float("nan")}, "`time_budget` must be above 0"),
    ],
)
def test_bad(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        EncodeSettings(**settings)


@pytest.mark.parametrize(
    ("settings", "quality"),
    [
        ({}, DEFAULT_CRF),
        ({"crf": 20.5}, 20.5),
        ({"params": 5}, None),
        ({"bpp": 0.1}, None),
        ({"target_psnr": 30.0}, None),
        ({"profile": "paper"}, None),
    ],
)
def test_constant_quality_unless_a_size_is_given(
    settings: dict[str, Any], quality: float | None
) -> None:
    chosen = EncodeSettings(**settings)
    assert chosen.quality == chosen.recorded()["crf"] == quality


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("prset", "`prset` is not an argument of `encode`; did you mean `preset`\\?"),
        ("quality", "`quality` is not an argument of `encode`"),
    ],
)
def test_unknown(name: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        gsvrcodec.encode("film.mp4", **{name: "fast"})  # type: ignore[arg-type]


def test_editors_know_each_argument() -> None:
    assert get_type_hints(EncodeOptions) == get_type_hints(EncodeSettings)


def test_recorded_is_json_of_all_that_shapes_the_file() -> None:
    recorded = EncodeSettings(params=5, crop=(2, 2, None, None)).recorded()
    assert json.loads(json.dumps(recorded)) == {**recorded, "crop": [2, 2, None, None]}
    assert set(recorded) == {field.name for field in fields(EncodeSettings)} - {
        "device",
        "threads",
        "workers",
    }


@pytest.mark.parametrize(
    ("settings", "predicts"),
    [
        ({}, True),
        ({"keyint": 0.5, "bpp": 0.1}, True),
        ({"gaussians": 50}, True),
        ({"params": 5000}, False),
        ({"keyint": 0.0}, False),
        ({"keyint": 0}, False),
        ({"profile": "paper"}, False),
    ],
)
def test_when_gops_may_be_predicted(settings: dict[str, Any], predicts: bool) -> None:
    assert EncodeSettings(**settings).predicts == predicts
