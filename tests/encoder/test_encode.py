"""The whole encoder on real clips: what it writes, what it refuses, what it leaves behind."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.encoder.encode import EncodeResult, Progress
from gsvrcodec.encoder.rate import qscale_of
from gsvrcodec.errors import InputError, NotAVideoError, OutputError, UsageError
from gsvrcodec.report.compare import report
from gsvrcodec.report.inspect import inspect
from gsvrcodec.video import open_video
from tests import making

#: dB that the least effort must reach, 1.5 dB or more below what it does.
LEAST_PSNR = {
    making.BUNNY_SMALL: 30.0,
    making.TEN_BIT: 31.0,
    making.ODD: 29.0,
    making.VFR_ROTATED: 35.0,
    making.NOISE: 28.0,
}


def quick(source: Path, target: Path, **settings: Any) -> EncodeResult:
    """Encode with the least effort."""
    return gsvrcodec.encode(source, target, **({"preset": "fastest"} | settings))


class TestRealClips:
    @pytest.mark.parametrize("source", LEAST_PSNR, ids=lambda path: path.stem)
    def test_pictures_times_and_figures(self, source: Path, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        result = quick(source, target, seed=3)
        with open_video(source) as video, gsvrcodec.open(target) as decoder:
            shots = list(video)
            meta = decoder.metadata
            assert len(decoder) == result.frames == len(shots)
            assert (meta.width, meta.height) == (video.info.width, video.info.height)
            assert meta.time_base == video.info.time_base
            assert [(f.pts, f.duration) for f in decoder] == [(s.pts, s.duration) for s in shots]
            assert meta.rotation == video.info.rotation
            assert meta.bit_depth == video.info.bit_depth
            assert (meta.gops, meta.gaussians) == (result.gops, result.gaussians)
        measured = report(source, target)
        assert measured.psnr_rgb == pytest.approx(result.psnr, abs=0.02)
        assert measured.psnr_rgb > LEAST_PSNR[source]
        # All clips have the steps of one slope, so rounding costs more dB the better the fit is:
        # 0.4 to 0.7 dB here.
        assert -0.1 < result.float_psnr - result.psnr < 0.8
        assert measured.bpp == pytest.approx(result.bpp)
        assert result.bytes == target.stat().st_size
        assert result.path == target

    def test_a_cut_starts_a_gop(self, tmp_path: Path) -> None:
        quick(making.ODD, tmp_path / "a.gsvr", gop_min=2, frames=16)
        with gsvrcodec.open(tmp_path / "a.gsvr") as decoder:
            content = [decoder.metadata.gops, len(decoder)]
        assert content == [2, 16]


class TestSettings:
    @pytest.mark.parametrize("params", [6_000, 60_000])
    def test_params_bound_what_is_stored(self, params: int, tmp_path: Path) -> None:
        quick(making.NOISE, tmp_path / "a.gsvr", params=params, gop=10)
        assert 0.98 * params < inspect(tmp_path / "a.gsvr").parameters <= params

    def test_too_few_params_fail(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="raise `params`"):
            quick(making.NOISE, tmp_path / "a.gsvr", params=20)
        assert not list(tmp_path.iterdir())

    def test_gaussians_and_fixed_gops(self, tmp_path: Path) -> None:
        settings: dict[str, Any] = {"gaussians": 30, "gop": 7, "frames": 16}
        result = quick(making.NOISE, tmp_path / "a.gsvr", keyint=0, **settings)
        assert (result.frames, result.gops, result.gaussians) == (16, 3, 90)
        result = quick(making.NOISE, tmp_path / "b.gsvr", **settings)
        assert [gop.gaussians for gop in result.gop_stats] == [30, 30, 30]
        assert result.gaussians == 90

    def test_constant_quality_is_one_slope(self, tmp_path: Path) -> None:
        fine, coarse = (
            quick(making.ODD, tmp_path / f"{crf}.gsvr", crf=crf, gop=6, frames=24)
            for crf in (26, 36)
        )
        for result, crf in (fine, 26), (coarse, 36):
            assert len(result.gop_stats) > 2
            assert {gop.qscale for gop in result.gop_stats} == {qscale_of(crf)}
        assert fine.bytes > 1.5 * coarse.bytes
        assert fine.psnr > coarse.psnr + 0.5

    def test_crop_and_range(self, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        crop = (101, 77, 40, 12)
        result = quick(making.BUNNY_SMALL, target, crop=crop, start_frame=5, frames=3)
        with open_video(making.BUNNY_SMALL, crop, 5, 3) as video, gsvrcodec.open(target) as decoder:
            assert [frame.pts for frame in decoder] == [shot.pts for shot in video]
            assert decoder[0].data.shape == (77, 101, 3)
        assert report(making.BUNNY_SMALL, target).psnr_rgb == pytest.approx(result.psnr, abs=0.02)

    def test_more_frames_than_there_are(self, tmp_path: Path) -> None:
        result = quick(making.NOISE, tmp_path / "a.gsvr", start_frame=18, frames=100)
        assert result.frames == 2

    def test_settings_are_kept_in_the_file(self, tmp_path: Path) -> None:
        chosen = {"gaussians": 20, "seed": 4, "frames": 2, "crop": (64, 48, None, None)}
        quick(making.NOISE, tmp_path / "a.gsvr", threads=2, **chosen)
        with gsvrcodec.open(tmp_path / "a.gsvr") as decoder:
            kept = decoder.metadata.settings
        assert kept.items() >= json.loads(json.dumps(chosen)).items()
        assert kept["preset"] == "fastest"
        assert "threads" not in kept

    def test_same_settings_same_bytes(self, tmp_path: Path) -> None:
        names = [tmp_path / name for name in ("a.gsvr", "b.gsvr", "c.gsvr")]
        for name, seed in zip(names, (0, 0, 1), strict=True):
            quick(making.NOISE, name, frames=4, seed=seed)
        first, again, other = (name.read_bytes() for name in names)
        assert first == again
        assert first != other

    def test_time_budget(self, tmp_path: Path) -> None:
        least, result = (
            gsvrcodec.encode(making.NOISE, tmp_path / f"{budget}.gsvr", time_budget=budget)
            for budget in (0.0001, 0.1)
        )
        assert least.frames == result.frames == 20
        assert result.psnr > max(15, least.psnr)
        # Two seconds are spent, but for what no budget bounds.
        assert 0.7 * 2 < result.seconds < 1.3 * 2 + least.seconds

    def test_paper(self, tmp_path: Path) -> None:
        result = quick(making.NOISE, tmp_path / "a.gsvr", profile="paper", gop=10)
        assert result.psnr > 18


class TestProgress:
    def test_is_called_before_the_first_gop_and_after_each(self, tmp_path: Path) -> None:
        calls: list[Progress] = []
        result = quick(making.NOISE, tmp_path / "a.gsvr", gop=8, progress=calls.append)
        assert (calls[0].phase, calls[0].gops) == ("analysing", 0)
        assert calls[0].psnr is calls[0].seconds_per_frame is calls[0].bitrate is None
        assert {call.frames for call in calls} == {20}
        fitting = {call.gop: call for call in calls if call.phase == "fitting"}
        assert [(n, call.gops) for n, call in fitting.items()] == [(n, 3) for n in range(4)]
        assert [call.frames_done for call in fitting.values()] == [0, 8, 16, 20]
        assert all(fitting[n].seconds_per_frame for n in range(1, 4))
        assert calls[-1].psnr == pytest.approx(result.psnr)
        assert calls[-1].eta_seconds == 0
        seconds = 20 / 15  # of the film, whose file has more than its GOPs
        gops = sum(gop.bytes for gop in result.gop_stats)
        assert calls[-1].bitrate == pytest.approx(8 * gops / seconds)
        assert result.bitrate == pytest.approx(8 * result.bytes / seconds)

    def test_an_interrupted_encode_leaves_its_parts(self, tmp_path: Path) -> None:
        def interrupt(state: Progress) -> None:
            if state.gop == 1:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt) as caught:
            quick(making.NOISE, tmp_path / "a.gsvr", gop=4, progress=interrupt)
        assert caught.value.__notes__ == [
            f"1 finished GOP is kept in {tmp_path}/a.gsvr.part, `resume=True` goes on from there"
        ]
        assert [path.name for path in tmp_path.iterdir()] == ["a.gsvr.part"]

    def test_a_failed_encode_keeps_the_old_file(self, tmp_path: Path) -> None:
        def fail(state: Progress) -> None:
            raise RuntimeError("no more")

        target = tmp_path / "a.gsvr"
        target.write_bytes(b"old")
        with pytest.raises(RuntimeError, match="no more"):
            quick(making.NOISE, target, overwrite=True, progress=fail)
        assert target.read_bytes() == b"old"
        assert list(tmp_path.iterdir()) == [target]


class TestStats:
    def test_they_add_up(self, tmp_path: Path) -> None:
        result = quick(making.ODD, tmp_path / "a.gsvr", gop_min=2, frames=16)
        first, second = result.gop_stats
        assert (first.first_frame, second.first_frame) == (0, first.frames)
        assert first.frames + second.frames == 16
        assert first.cut
        assert second.cut
        assert first.key
        assert second.key
        assert (result.gops, result.key_gops) == (2, 2)
        assert first.qscale
        assert first.motion > 0
        assert sum(gop.gaussians for gop in result.gop_stats) == result.gaussians
        size = sum(gop.bytes for gop in result.gop_stats)
        assert result.bytes - 2000 < size < result.bytes
        assert first.bpp == 8 * first.bytes / (first.frames * 241 * 135)
        assert all(gop.seconds > 0 for gop in result.gop_stats)

    def test_bits_that_nothing_needs_are_left(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        target = tmp_path / "a.gsvr"
        result = gsvrcodec.encode(making.NOISE, target, frames=8, bpp=4.0, time_budget=0.02)
        assert result.bpp < 1.0
        (record,) = caplog.records
        assert "of the bits asked for" in record.getMessage()

    def test_quality_that_nothing_reaches_is_missed(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        target = tmp_path / "a.gsvr"
        result = gsvrcodec.encode(making.NOISE, target, frames=8, target_psnr=45, time_budget=0.02)
        assert result.psnr < 44.0
        (record,) = caplog.records
        assert record.getMessage().startswith(f"the film has {result.psnr:.1f} dB where 45 were")

    def test_no_word_of_bits_without_a_target(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        quick(making.NOISE, tmp_path / "a.gsvr", frames=8)
        assert not caplog.records


class TestRefused:
    def test_output_that_exists(self, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        target.write_bytes(b"mine")
        with pytest.raises(OutputError, match="exists already"):
            quick(making.NOISE, target)
        assert target.read_bytes() == b"mine"
        quick(making.NOISE, target, overwrite=True, frames=1)
        assert target.stat().st_size > 4

    def test_output_that_is_the_input(self, tmp_path: Path) -> None:
        source = tmp_path / "a.mp4"
        source.write_bytes(making.NOISE.read_bytes())
        (tmp_path / "b.mp4").symlink_to(source)
        for target in (source, tmp_path / "b.mp4"):
            with pytest.raises(OutputError, match="is the input itself"):
                quick(source, target, overwrite=True)
        assert source.read_bytes() == making.NOISE.read_bytes()

    def test_input(self, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        (tmp_path / "a.txt").write_text("not a video, but a few words\n")
        with pytest.raises(InputError, match="does not exist"):
            quick(tmp_path / "none.mp4", target)
        with pytest.raises(InputError, match="is a directory"):
            quick(tmp_path, target)
        with pytest.raises(NotAVideoError):
            quick(tmp_path / "a.txt", target)
        with pytest.raises(NotAVideoError, match="audio"):
            quick(making.audio_only(tmp_path / "a.wav"), target)
        with pytest.raises(NotAVideoError):
            quick(making.zero_frames(tmp_path / "a.y4m"), target)
        assert not target.exists()

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"crop": (1000, 10, None, None)}, "larger than the picture"),
            ({"crop": (100, 100, 100, 0)}, "reaches outside"),
            ({"start_frame": 20}, "past the end"),
            ({"params": 10**6, "gaussians": 10}, "exclude each other"),
            ({"time_budget": 1.0}, "exclude each other"),
        ],
    )
    def test_settings(self, settings: dict[str, Any], message: str, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=message):
            quick(making.NOISE, tmp_path / "a.gsvr", **settings)
        assert not list(tmp_path.iterdir())


class TestSmallest:
    @pytest.mark.parametrize("size", [(1, 1), (1, 40), (3, 2), (33, 17)])
    @pytest.mark.parametrize("frames", [1, 2])
    def test_tiny_videos(self, size: tuple[int, int], frames: int, tmp_path: Path) -> None:
        rng = np.random.default_rng(0)
        pictures = list(rng.integers(0, 256, (frames, size[1], size[0], 3), np.uint8))
        source = making.write_video(tmp_path / "a.y4m", pictures)
        result = quick(source, tmp_path / "a.gsvr")
        with gsvrcodec.open(tmp_path / "a.gsvr") as decoder:
            assert len(decoder) == result.frames == frames
            assert decoder[-1].data.shape == (size[1], size[0], 3)
            assert decoder.metadata.time_base == Fraction(1, 25)
