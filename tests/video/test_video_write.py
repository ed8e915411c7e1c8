"""Writing: times, colour and orientation come back; nothing half-written is left."""

from __future__ import annotations

import hashlib
import logging
import os
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from gsvrcodec.bitstream.header import ColourInfo
from gsvrcodec.errors import OutputError, UsageError
from gsvrcodec.video import OutputInfo, SourceFrame, muxer_of, open_video, open_writer
from tests import making

BARS = making.colour_bars()


def copy(source: Path, target: Path) -> tuple[list[SourceFrame], list[SourceFrame]]:
    """Write the frames of one video to another; return both as read."""
    video = open_video(source)
    info, frames = video.info, list(video)
    assert info.average_rate is not None
    output = OutputInfo(
        width=info.width,
        height=info.height,
        time_base=info.time_base,
        rate=info.average_rate,
        frames=len(frames),
        sample_aspect=info.sample_aspect,
        rotation=info.rotation,
        colour=info.colour,
    )
    with open_writer(target, output) as writer:
        for frame in frames:
            writer.write(frame.rgb, frame.pts, frame.duration)
    return frames, list(open_video(target))


def seconds(path: Path, frames: list[SourceFrame]) -> list[tuple[Fraction, Fraction]]:
    """Return when and how long each frame is shown."""
    base = open_video(path).info.time_base
    return [(frame.pts * base, frame.duration * base) for frame in frames]


class TestMp4:
    @pytest.mark.parametrize(
        "path",
        [making.BUNNY_SMALL, making.ODD, making.VFR_ROTATED, making.NOISE],
        ids=lambda path: path.stem,
    )
    def test_times_are_exact(self, tmp_path: Path, path: Path) -> None:
        target = tmp_path / "out.mp4"
        source, written = copy(path, target)
        assert seconds(path, source) == seconds(target, written)
        assert min(making.psnr(a.rgb, b.rgb) for a, b in zip(source, written, strict=True)) > 39

    def test_rotation_is_kept(self, tmp_path: Path) -> None:
        target = tmp_path / "out.mp4"
        copy(making.VFR_ROTATED, target)
        assert open_video(target).info.rotation == 90

    @pytest.mark.parametrize("base", [Fraction(1, 90_000), Fraction(1001, 30_000)])
    def test_late_start_and_odd_bases(self, tmp_path: Path, base: Fraction) -> None:
        times = [(48_601, 3), (48_604, 1), (48_605, 100), (48_705, 7)]
        target = tmp_path / "out.mp4"
        with open_writer(target, making.output_info([BARS], time_base=base)) as writer:
            for pts, duration in times:
                writer.write(BARS, pts, duration)
        expected = [(pts * base, duration * base) for pts, duration in times]
        assert seconds(target, list(open_video(target))) == expected

    @pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
    @pytest.mark.parametrize("aspect", ["4/3", "16/11", "10/11", "64/45", "255/254"])
    def test_sample_aspect_is_kept(
        self, tmp_path: Path, suffix: str, aspect: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        pictures = [BARS, BARS[:, ::-1]]
        info = replace(making.output_info(pictures), sample_aspect=Fraction(aspect))
        target = making.write_video(tmp_path / f"out{suffix}", pictures, info)
        video = open_video(target)
        assert video.info.sample_aspect == Fraction(aspect)
        assert len(list(video)) == 2
        assert not caplog.records

    @pytest.mark.parametrize("size", [(1, 1), (1, 9), (16, 3), (3, 16), (2, 2)])
    def test_small_and_odd_sizes(self, tmp_path: Path, size: tuple[int, int]) -> None:
        picture = np.full((size[1], size[0], 3), (200, 100, 50), np.uint8)
        target = making.write_video(tmp_path / "out.mp4", [picture] * 2)
        read = list(open_video(target))
        assert [frame.rgb.shape for frame in read] == [picture.shape] * 2
        assert np.abs(read[0].rgb.astype(int) - picture).max() <= 4

    def test_too_fine_a_time_base_fails(self, tmp_path: Path) -> None:
        info = making.output_info([BARS], time_base=Fraction(1, 2**32 - 1))
        with pytest.raises(OutputError, match="too fine"):
            making.write_video(tmp_path / "out.mp4", [BARS], info)


class TestColour:
    @pytest.mark.parametrize("full_range", [False, True], ids=["limited", "full"])
    @pytest.mark.parametrize(
        ("suffix", "primaries", "transfer", "matrix"),
        [
            (".mp4", 2, 2, 2),
            (".mp4", 6, 6, 6),
            (".mp4", 5, 6, 5),
            (".mp4", 1, 1, 1),
            (".mp4", 9, 16, 9),
            (".mp4", 9, 18, 9),
            (".mp4", 1, 13, 0),
            # Y4M carries no matrix, so only what a reader assumes without one comes back.
            (".y4m", 2, 2, 2),
            (".y4m", 6, 6, 6),
        ],
    )
    def test_bars_come_back(
        self,
        tmp_path: Path,
        suffix: str,
        full_range: bool,
        primaries: int,
        transfer: int,
        matrix: int,
    ) -> None:
        colour = ColourInfo(primaries, transfer, matrix, full_range)
        info = making.output_info([BARS], colour=colour)
        target = making.write_video(tmp_path / f"out{suffix}", [BARS], info)
        video = open_video(target)
        error = np.abs(next(iter(video)).rgb.astype(int) - BARS)
        # Away from the edges between bars, where 4:2:0 mixes two colours.
        inside = np.abs(np.arange(BARS.shape[1]) % 20 - 10) < 7
        assert error[:44, inside].max() <= 5
        assert error[52:].max() <= 6
        read = video.info.colour
        assert read.full_range == full_range
        if suffix == ".mp4":
            assert (read.primaries, read.transfer) == (primaries, transfer)
            assert read.matrix == (matrix or 6)

    def test_mkv_is_lossless(self, tmp_path: Path) -> None:
        noise = np.random.default_rng(1).integers(0, 256, (33, 47, 3), np.uint8)
        target = making.write_video(tmp_path / "out.mkv", [noise, 255 - noise])
        read = list(open_video(target))
        assert np.array_equal(read[0].rgb, noise)
        assert np.array_equal(read[1].rgb, 255 - noise)


class TestMkv:
    def test_rounded_times_are_warned_of(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        copy(making.VFR_ROTATED, tmp_path / "out.mkv")
        assert caplog.text.count("rounded to milliseconds") == 1
        assert open_video(tmp_path / "out.mkv").info.rotation == 90

    def test_millisecond_times_are_exact(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        source, written = copy(making.ODD, tmp_path / "out.mkv")
        assert [(f.pts, f.duration) for f in source] == [(f.pts, f.duration) for f in written]
        assert all(np.array_equal(a.rgb, b.rgb) for a, b in zip(source, written, strict=True))
        assert "rounded" not in caplog.text


class TestY4m:
    def test_standard_output(self, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
        with open_writer("-", making.output_info([BARS])) as writer:
            writer.write(BARS, 0, 1)
        output = capfdbinary.readouterr().out
        head, _, rest = output.partition(b"\n")
        assert head == b"YUV4MPEG2 W160 H96 F25:1 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED"
        assert len(rest) == len(b"FRAME\n") + 160 * 96 * 3 // 2

    def test_odd_size_is_444(self, tmp_path: Path) -> None:
        copy(making.ODD, tmp_path / "out.y4m")
        assert open_video(tmp_path / "out.y4m").info.pixel_format == "yuv444p"

    def test_variable_rate_is_warned_of(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        copy(making.VFR_ROTATED, tmp_path / "out.y4m")
        assert caplog.text.count("frame rate varies") == 1


class TestPng:
    def test_numbered_by_the_film(self, tmp_path: Path) -> None:
        info = replace(making.output_info([BARS] * 3), first_frame=9)
        making.write_video(tmp_path / "out_%04d.png", [BARS] * 3, info)
        names = sorted(path.name for path in tmp_path.iterdir())
        assert names == ["out_0009.png", "out_0010.png", "out_0011.png"]
        read = next(iter(open_video(tmp_path / names[0])))
        assert np.array_equal(read.rgb, BARS)

    def test_one_picture_needs_no_number(self, tmp_path: Path) -> None:
        making.write_video(tmp_path / "one.png", [BARS])
        assert [path.name for path in tmp_path.iterdir()] == ["one.png"]

    @pytest.mark.parametrize("name", ["out.png", "out_%d_%d.png", "out_%s.png", "out_%x_%d.png"])
    def test_name_without_one_number_fails(self, tmp_path: Path, name: str) -> None:
        with pytest.raises(UsageError, match=r"as in out_%04d\.png"):
            making.write_video(tmp_path / name, [BARS] * 2)

    def test_existing_picture_fails(self, tmp_path: Path) -> None:
        (tmp_path / "2.png").write_bytes(b"mine")
        with pytest.raises(OutputError, match=r"2\.png exists already"):
            making.write_video(tmp_path / "%d.png", [BARS] * 3)
        assert [path.name for path in tmp_path.iterdir()] == ["2.png"]


class TestMd5AndNull:
    def test_md5_of_the_pictures(self, capsys: pytest.CaptureFixture[str]) -> None:
        with open_writer(None, making.output_info([BARS]), muxer="md5") as writer:
            writer.write(BARS, 0, 1)
            writer.write(BARS[:, ::-1], 1, 1)
        expected = hashlib.md5(BARS.tobytes() + BARS[:, ::-1].tobytes()).hexdigest()
        assert capsys.readouterr().out == f"{expected}\n"

    def test_md5_to_a_file(self, tmp_path: Path) -> None:
        target = tmp_path / "sum.md5"
        making.write_video(target, [BARS])
        assert target.read_text() == f"{hashlib.md5(BARS.tobytes()).hexdigest()}\n"

    def test_null_writes_nothing(self, tmp_path: Path) -> None:
        with open_writer(tmp_path / "no.mp4", making.output_info([BARS]), muxer="null") as writer:
            writer.write(BARS, 0, 1)
        assert not list(tmp_path.iterdir())


class TestChoice:
    def test_by_suffix(self) -> None:
        assert [muxer_of(name) for name in ("a.MP4", "b.mkv", "-", None)] == [
            "mp4",
            "mkv",
            "y4m",
            "y4m",
        ]

    @pytest.mark.parametrize("name", ["a.avi", "a", "a.null", ".mp4"])
    def test_unknown_suffix_fails(self, name: str) -> None:
        with pytest.raises(UsageError, match="use a name in"):
            muxer_of(name)

    def test_unknown_muxer_fails(self) -> None:
        with pytest.raises(UsageError, match="choose from mp4, mkv, y4m, png, md5, null"):
            muxer_of("a.mp4", "avi")

    @pytest.mark.parametrize("muxer", ["mp4", "png"])
    def test_standard_output_needs_a_stream(self, muxer: str) -> None:
        with pytest.raises(UsageError, match="name a file"):
            muxer_of("-", muxer)


class TestWholeOrNothing:
    @pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".y4m", ".md5"])
    def test_failure_leaves_the_old_file(self, tmp_path: Path, suffix: str) -> None:
        target = tmp_path / f"out{suffix}"
        target.write_bytes(b"old")

        def fail() -> None:
            with open_writer(target, making.output_info([BARS]), overwrite=True) as writer:
                writer.write(BARS, 0, 1)
                raise RuntimeError("the decoder failed")

        with pytest.raises(RuntimeError, match="the decoder failed"):
            fail()
        assert target.read_bytes() == b"old"
        assert len(list(tmp_path.iterdir())) == 1

    def test_existing_fails(self, tmp_path: Path) -> None:
        target = tmp_path / "out.mp4"
        target.write_bytes(b"old")
        with pytest.raises(OutputError, match="use `overwrite=True`"):
            making.write_video(target, [BARS])
        assert target.read_bytes() == b"old"

    def test_overwriting_keeps_a_link(self, tmp_path: Path) -> None:
        target, link = tmp_path / "real.y4m", tmp_path / "link.y4m"
        target.write_bytes(b"old")
        link.symlink_to(target)
        with open_writer(link, making.output_info([BARS]), overwrite=True) as writer:
            writer.write(BARS, 0, 1)
        assert link.is_symlink()
        assert target.read_bytes().startswith(b"YUV4MPEG2")

    def test_source_through_links_fails(self, tmp_path: Path) -> None:
        source = tmp_path / "a.gsvr"
        source.write_bytes(b"source")
        for name, link in (("soft.mp4", os.symlink), ("hard.mp4", os.link)):
            link(source, tmp_path / name)
            opening = open_writer(
                tmp_path / name, making.output_info([BARS]), overwrite=True, source=source
            )
            with pytest.raises(OutputError, match="is the input itself"), opening:
                pass
        assert source.read_bytes() == b"source"

    def test_directory_fails(self, tmp_path: Path) -> None:
        (tmp_path / "out.mp4").mkdir()
        with pytest.raises(OutputError, match="is a directory"):
            making.write_video(tmp_path / "out.mp4", [BARS])

    def test_missing_directory_fails(self, tmp_path: Path) -> None:
        with pytest.raises(OutputError, match="is not a directory"):
            making.write_video(tmp_path / "none" / "out.mp4", [BARS])

    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
    @pytest.mark.parametrize("muxer", ["y4m", "mkv", "mp4", "md5"])
    def test_full_disk_fails(self, muxer: str) -> None:
        noise = np.random.default_rng(1).integers(0, 256, (96, 160, 3), np.uint8)

        def fill() -> None:
            with open_writer("/dev/full", making.output_info([noise]), muxer=muxer) as writer:
                for pts in range(20):
                    writer.write(noise, pts, 1)

        with pytest.raises(OutputError, match="no space left"):
            fill()

    def test_unwritable_directory_fails(self, tmp_path: Path) -> None:
        if os.geteuid() == 0:
            pytest.skip("root may write anywhere")
        tmp_path.chmod(0o500)
        with pytest.raises(OutputError, match="cannot be written"):
            making.write_video(tmp_path / "out.mp4", [BARS])


@making.needs_clips
def test_times_of_all_clips(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR)
    for path in sorted(making.CLIPS.iterdir()):
        video = open_video(path, frames=8)
        frames = list(video)
        info = replace(
            making.output_info([frames[0].rgb], time_base=video.info.time_base),
            colour=video.info.colour,
            rotation=video.info.rotation,
        )
        target = tmp_path / f"{path.name}.mp4"
        with open_writer(target, info) as writer:
            for frame in frames:
                writer.write(frame.rgb, frame.pts, frame.duration)
        assert seconds(target, list(open_video(target))) == [
            (frame.pts * video.info.time_base, frame.duration * video.info.time_base)
            for frame in frames
        ], path
