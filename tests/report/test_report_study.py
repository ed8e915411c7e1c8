"""Several files and other encoders on the same frames: figures, JSON, plots, refusals."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import log10
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange

from gsvrcodec.errors import UsageError
from gsvrcodec.metrics import psnr
from gsvrcodec.report import reference as references
from gsvrcodec.report.plot import plot, reference_styles
from gsvrcodec.report.quality import PictureQuality
from gsvrcodec.report.reference import Curve, measure, parse_reference
from gsvrcodec.report.study import Study, study
from gsvrcodec.video import open_video
from gsvrcodec.video.colour import to_rgb
from gsvrcodec.video.elementary import (
    encode_stream,
    has_own_samples,
    source_frames,
    ycbcr_frames,
)
from tests import making
from tests.cli.tools import Runner

CODECS = ("x264", "x265", "svtav1")


def curve_of(
    text: str,
    source: Path = making.NOISE,
    frames: int = 6,
    crfs: Sequence[int] | None = (16, 30, 45),
) -> Curve:
    with open_video(source, frames=frames) as video:
        return measure(parse_reference(text), video, frames, crfs=crfs, threads=1)


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """Two files of random Gaussians, of 6 frames each, against x264."""
    folder = tmp_path_factory.mktemp("study")
    files = [
        making.gsvr_file(folder / f"{n}.gsvr", size=(160, 120), frames=(4, 2), grid=grid)
        for n, grid in enumerate([(4, 3, 5), (0, 0, 0)])
    ]
    return study(making.NOISE, files, [parse_reference("x264:key=same")], threads=1)


class TestReferences:
    @pytest.mark.parametrize("codec", CODECS)
    def test_rate_and_quality_fall_with_crf(self, codec: str) -> None:
        points = curve_of(codec).points
        assert len(points) == 3
        for better, worse in pairwise(points):
            assert better.crf < worse.crf
            assert better.bpp > worse.bpp
            assert better.quality.psnr_rgb > worse.quality.psnr_rgb
        assert points[0].quality.psnr_rgb > 36
        assert points[0].bpp == 8 * points[0].bytes / (6 * 160 * 120)
        assert {point.key_frames for point in points} == {1}

    @pytest.mark.parametrize("codec", CODECS)
    @pytest.mark.parametrize(("setting", "keys"), [("key=2", 3), ("intra", 6)])
    def test_key_frames(self, codec: str, setting: str, keys: int) -> None:
        (point,) = curve_of(f"{codec}:{setting}", crfs=[30]).points
        assert point.key_frames == keys

    @pytest.mark.parametrize(("codec", "encoder"), [("x264", "libx264"), ("x265", "libx265")])
    def test_a_cut_makes_no_key_frame_of_its_own(self, codec: str, encoder: str) -> None:
        options = references.encoder_options(parse_reference(f"{codec}:key=4"), 30)
        with open_video(making.NOISE, frames=6) as video:
            frames = ycbcr_frames((shot.rgb for shot in video), video.info)
            stream = encode_stream(frames, video.info, encoder, options, threads=1)
        assert b"scenecut=0" in stream.start  # the encoder names its settings there

    @pytest.mark.usefixtures("exact_x264")
    def test_figures_are_those_of_the_decoded_stream(self) -> None:
        with open_video(making.NOISE, frames=6) as video:
            shots = [shot.rgb for shot in video]
            options = {"preset": "medium", "crf": "24", "x264-params": "asm=0"}
            frames = ycbcr_frames(shots, video.info)
            stream = encode_stream(frames, video.info, "libx264", options, threads=1)
        pictures = list(stream.pictures("h264"))
        told: list[tuple[int, int]] = []
        with open_video(making.NOISE, frames=6) as video:
            curve = measure(
                parse_reference("x264:input=rgb"),
                video,
                6,
                crfs=[24, 40],
                threads=1,
                progress=lambda *done: told.append(done),
            )
        assert told == [(6, 12), (12, 12)]
        point = curve.points[0]
        assert point.bytes == stream.size
        expected = [psnr(shot, picture) for shot, picture in zip(shots, pictures, strict=True)]
        assert point.quality.psnr_rgb == pytest.approx(sum(expected) / 6)
        assert point.quality.psnr_rgb_min == pytest.approx(min(expected))
        assert point.quality.ms_ssim is None

    def test_versions_of_the_libraries(self) -> None:
        assert (curve_of("x264", frames=2, crfs=[30]).version or "").startswith("1")
        assert "." in (curve_of("x265", frames=2, crfs=[30]).version or "")

    @pytest.mark.parametrize("source", [making.ODD, making.TEN_BIT])
    def test_odd_sizes_and_deep_colour(self, source: Path) -> None:
        best, _, worst = curve_of("x264", source, 2).points
        assert best.quality.psnr_rgb > 34 > worst.quality.psnr_rgb

    @pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="not on this system")
    def test_other_work_is_scheduled_as_before(self) -> None:
        before = os.sched_getscheduler(0)
        curve_of("svtav1", crfs=[50])
        assert os.sched_getscheduler(0) == before

    def test_refusing_encoder_is_named(self) -> None:
        with open_video(making.NOISE, (16, 16, 0, 0), frames=2) as video:
            chosen = parse_reference("svtav1:preset=99")
            with pytest.raises(UsageError, match=r"libsvtav1 refuses pictures of 16x16"):
                measure(chosen, video, 2)


class TestSourceFrames:
    def test_they_are_what_the_reader_converts(self) -> None:
        crop = (64, 48, 10, 20)
        with open_video(making.NOISE, crop, 3, 2) as video:
            assert has_own_samples(video)
            shots = [shot.rgb for shot in video]
            frames = list(source_frames(video))
        inner = slice(4, -4)  # swscale looks at chroma beyond the crop's edge
        for shot, frame in zip(shots, frames, strict=True):
            assert frame.format.name == "yuv420p"
            rgb = to_rgb(frame)
            assert PictureQuality.of(shot[inner, inner], rgb[inner, inner]).psnr_rgb > 60

    def test_frames_are_chosen_by_time_too(self) -> None:
        with open_video(making.NOISE, start_seconds=0.2, stop_seconds=0.4) as video:
            shots = [shot.rgb for shot in video]
            frames = [to_rgb(frame) for frame in source_frames(video)]
        np.testing.assert_array_equal(frames, shots)

    def test_the_source_itself_is_the_better_input(self) -> None:
        own, ours = (curve_of(f"x264{text}", crfs=[16]).points[0] for text in ("", ":input=rgb"))
        assert own.quality.psnr_rgb > ours.quality.psnr_rgb + 0.3

    @pytest.mark.parametrize("name", CODECS)
    def test_full_range_of_the_old_name(self, name: str, tmp_path: Path) -> None:
        """JPEG and H.264 of phones decode to yuvj420p, which SVT-AV1 does not take."""
        source = tmp_path / "full.mkv"
        with open_video(making.NOISE, frames=2) as video, av.open(str(source), "w") as file:
            stream = file.add_stream("mjpeg", rate=25, options={"qmin": "1", "qscale": "1"})
            assert isinstance(stream, av.VideoStream)
            stream.width, stream.height = video.info.width, video.info.height
            stream.pix_fmt = "yuvj420p"
            for frame in video.frames():
                full = frame.reformat(format="yuvj420p", dst_color_range=ColorRange.JPEG)
                file.mux(stream.encode(full))
            file.mux(stream.encode(None))
        curve = curve_of(name, source, frames=2, crfs=[10])
        assert curve.points[0].quality.psnr_rgb > 35

    @pytest.mark.parametrize(
        ("source", "options"),
        [
            (making.ODD, {}),
            (making.TEN_BIT, {}),
            (making.NOISE, {"crop": (64, 48, 3, 0)}),
            (making.VFR_ROTATED, {"bake_rotation": True}),
        ],
    )
    def test_other_pictures_are_converted(self, source: Path, options: dict[str, Any]) -> None:
        with open_video(source, frames=2, **options) as video:
            assert not has_own_samples(video)
            shots = [shot.rgb for shot in video]
            frames = [to_rgb(frame) for frame in source_frames(video)]
        for shot, frame in zip(shots, frames, strict=True):
            assert shot.shape == frame.shape
            assert psnr(shot, frame) > 30


class TestNames:
    @pytest.mark.parametrize(
        ("text", "label"),
        [
            ("x264", "x264 medium"),
            ("x265:key=12", "x265 medium key 12"),
            ("svtav1:preset=4:intra", "SVT-AV1 4 all intra"),
            ("x264:tune=psnr:input=rgb", "x264 medium tune psnr from RGB"),
            ("x264:key=same", "x264 medium key same"),
        ],
    )
    def test_labels(self, text: str, label: str) -> None:
        assert parse_reference(text).label == label

    @pytest.mark.parametrize("text", ["vp9", "", "x264:key=0", "x264:key", "x264:fast", "x264:"])
    def test_nonsense_fails(self, text: str) -> None:
        with pytest.raises(UsageError, match=r"the encoders are x264|' is none of intra, key=N"):
            parse_reference(text)

    def test_library_that_was_left_out_fails(self, monkeypatch: pytest.MonkeyPatch) -> None:
        missing = replace(references._LIBRARIES["x265"], encoder="libnone")
        monkeypatch.setitem(references._LIBRARIES, "x265", missing)
        with pytest.raises(UsageError, match=r"without libnone; it has x264, svtav1"):
            parse_reference("x265")


class TestStudy:
    def test_same_key_frames_as_the_file(self, noisy: Study) -> None:
        (curve,) = noisy.curves
        assert curve.label == "x264 medium key 3"
        assert {point.key_frames for point in curve.points} == {2}

    def test_json(self, noisy: Study) -> None:
        data = json.loads(noisy.to_json())
        first, second = noisy.reports
        assert (data["bpp"], data["psnr_rgb"]) == (first.bpp, first.psnr_rgb)
        assert data["frames"][5]["psnr_rgb"] == first.frames[5].psnr_rgb
        assert [other["bpp"] for other in data["more"]] == [second.bpp]
        assert data["decode_fps"] > 0
        (curve,) = data["against"]
        assert curve["label"] == "x264 medium key 3"
        assert curve["points"][0]["quality"]["psnr_rgb"] > 36
        assert curve["bd_rate"] is None  # random Gaussians are far below
        assert curve["bpp_at_equal_psnr"] == [None, None]

    def test_bd_rate_is_that_of_the_points(self, noisy: Study) -> None:
        points = noisy.curves[0].points
        doubled = tuple(
            replace(noisy.reports[0], bpp=2 * point.bpp, psnr_rgb=point.quality.psnr_rgb)
            for point in points[1:4]
        )
        twice = replace(noisy, reports=doubled)
        found = twice.bd_rate(noisy.curves[0])
        assert found is not None
        # Not exactly twice: the ends of the shorter curve bend otherwise.
        assert found.percent == pytest.approx(100, abs=2)
        assert (found.low, found.high) == (doubled[-1].psnr_rgb, doubled[0].psnr_rgb)

    def test_bd_rate_by_ms_ssim_is_that_of_the_points(self, noisy: Study) -> None:
        (curve,) = noisy.curves
        similar = tuple(
            replace(point, quality=replace(point.quality, ms_ssim=1 - 0.1 * 0.5**number))
            for number, point in enumerate(reversed(curve.points[:4]))
        )
        half = tuple(
            replace(noisy.reports[0], bpp=point.bpp / 2, ms_ssim=point.quality.ms_ssim)
            for point in similar
        )
        found = replace(noisy, reports=half).bd_rate_ms_ssim(replace(curve, points=similar))
        assert found is not None
        assert found.percent == pytest.approx(-50)
        assert (found.low, found.high) == pytest.approx((10, 10 + 30 * log10(2)))

    def test_no_bd_rate_by_ms_ssim_of_small_frames(self, noisy: Study) -> None:
        assert noisy.bd_rate_ms_ssim(noisy.curves[0]) is None

    def test_files_of_other_frames_fail(self, tmp_path: Path) -> None:
        files = [
            making.gsvr_file(tmp_path / f"{n}.gsvr", size=(160, 120), frames=(n,)) for n in (2, 3)
        ]
        with pytest.raises(UsageError, match=r"2 frames of 160x120, .* 3 frames of 160x120"):
            study(making.NOISE, files)


class TestPlot:
    @pytest.mark.parametrize(("suffix", "start"), [(".png", b"\x89PNG"), (".pdf", b"%PDF")])
    def test_formats(self, noisy: Study, tmp_path: Path, suffix: str, start: bytes) -> None:
        target = tmp_path / f"plot{suffix}"
        plot(noisy, target)
        assert target.read_bytes().startswith(start)

    def test_what_is_drawn(self, noisy: Study) -> None:
        from matplotlib.figure import Figure

        from gsvrcodec.report.plot import plot_frames, plot_rates

        upper, lower = Figure().subplots(2)
        plot_rates(upper, noisy)
        plot_frames(lower, noisy.reports)
        ours, other = upper.get_lines()
        assert sorted(ours.get_xdata()) == sorted(report.bpp for report in noisy.reports)
        assert list(other.get_xdata()) == [point.bpp for point in noisy.curves[0].points]
        drawn = [line for line in lower.get_lines() if len(line.get_xdata()) == 6]
        assert len(drawn) == 2
        assert list(drawn[0].get_ydata()) == [f.psnr_rgb for f in noisy.reports[0].frames]

    def test_every_curve_looks_different(self) -> None:
        codecs = ["x264"] * 5 + ["x265"] * 3 + ["svtav1"] * 4
        styles = [tuple(style.values()) for style in reference_styles(codecs)]
        assert len(set(styles)) == len(codecs)

    def test_other_format_fails(self, noisy: Study, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=r"\.png, \.svg, \.pdf"):
            plot(noisy, tmp_path / "plot.txt")

    def test_without_matplotlib_nothing_is_measured(
        self,
        capsys: pytest.CaptureFixture[str],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setitem(sys.modules, "matplotlib", None)
        monkeypatch.setattr("gsvrcodec.report.study.report", None)
        path = making.gsvr_file(tmp_path / "a.gsvr")
        args = (making.NOISE, path, "--plot", tmp_path / "plot.png")
        assert "pip install matplotlib" in Runner(capsys).fails(2, "gsvrreport", *args)
