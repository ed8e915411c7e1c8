"""Sound, subtitles, chapters and titles: through a .gsvr file's chunks and into mp4 and mkv."""

from __future__ import annotations

import logging
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from gsvrcodec.bitstream.tags import StreamTags, Tags, parse_tags
from gsvrcodec.video import open_video, open_writer
from gsvrcodec.video.probe import opened
from gsvrcodec.video.streams import copy_streams
from gsvrcodec.video.tags import source_tags
from gsvrcodec.video.timing import Span
from tests import making
from tests.video.films import Packet, film, mp4_with_subtitles, packets, samples

KINDS = ("audio", "subtitle")
WHOLE = Span()


def carry(
    source: Path,
    target: Path,
    *,
    kept: Span = WHOLE,
    written: Span = WHOLE,
    kinds: tuple[str, ...] = KINDS,
) -> list[str]:
    """Copy a film as gsvrenc and gsvrdec do between them; return the codecs that were kept.

    `kept` is what the first keeps of streams and chapters, `written` what the second does.
    """
    with opened(source) as (container, stream):
        tags = source_tags(container, stream, kept)
    streams = list(copy_streams(source, kinds, kept))
    tags = replace(tags, streams=tuple(stream.tags for stream in streams))
    video = open_video(source)
    info = replace(
        making.output_info([next(iter(video)).rgb], time_base=video.info.time_base),
        tags=parse_tags(tags.to_bytes()),
        streams=tuple((stream.tags, bytes(stream.payload)) for stream in streams),
        span=written,
    )
    with open_writer(target, info) as writer:
        for frame in video:
            writer.write(frame.rgb, frame.pts, frame.duration)
    return [stream.codec for stream in streams]


def worst(a: list[Packet], b: list[Packet]) -> Fraction:
    """Return by how many seconds two lists of the same packets differ; fail if they are others."""
    assert [packet.data for packet in a] == [packet.data for packet in b]
    return max(abs(x.start - y.start) for x, y in zip(a, b, strict=True))


class TestPackets:
    def test_aac_with_priming_comes_back_to_the_sample(self, tmp_path: Path) -> None:
        target = tmp_path / "out.mp4"
        assert carry(making.BUNNY_SMALL, target) == ["aac"]
        assert packets(target) == packets(making.BUNNY_SMALL)
        start, sound = samples(making.BUNNY_SMALL)
        start_written, sound_written = samples(target)
        assert start == start_written
        assert np.array_equal(sound, sound_written)

    @pytest.mark.parametrize(
        ("name", "codec", "suffix"),
        [
            ("a.mkv", "flac", ".mkv"),
            ("a.mkv", "pcm_s16le", ".mkv"),
            ("a.mkv", "libopus", ".mkv"),
            ("a.mov", "pcm_s16le", ".mp4"),
            ("a.mov", "aac", ".mp4"),
            ("a.avi", "libmp3lame", ".mp4"),
            ("a.mp4", "ac3", ".mp4"),
        ],
    )
    def test_many_codecs(self, tmp_path: Path, name: str, codec: str, suffix: str) -> None:
        source = film(tmp_path / name, codec, sound_seconds=Fraction(2))
        target = tmp_path / f"out{suffix}"
        carry(source, target)
        ((_, before),) = packets(source)
        ((_, after),) = packets(target)
        assert len(before) > 10
        assert worst(before, after) == 0

    def test_matroska_rounds_to_milliseconds(self, tmp_path: Path) -> None:
        target = tmp_path / "out.mkv"
        carry(making.BUNNY_SMALL, target)
        ((_, before),) = packets(making.BUNNY_SMALL)
        ((_, after),) = packets(target)
        assert 0 < worst(before, after) <= Fraction(1, 2000)
        assert next(iter(open_video(target))).pts == 0  # not pushed by the sound before it

    def test_late_picture_and_early_long_sound(self, tmp_path: Path) -> None:
        source = film(
            tmp_path / "a.mp4",
            "aac",
            start=Fraction(2),
            sound_start=Fraction(1901, 1000),
            sound_seconds=Fraction(4),
        )
        target = tmp_path / "out.mp4"
        carry(source, target)
        assert packets(source) == packets(target)
        assert [frame.pts for frame in open_video(source)] == [
            frame.pts for frame in open_video(target)
        ]
        assert packets(target)[0][1][-1].start > 5

    def test_transport_stream(self, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
        # MP4 holds AAC without the head that each packet has in a transport stream.
        source, target = film(tmp_path / "a.ts", "aac", sound_start=Fraction(1)), tmp_path / "b.mp4"
        carry(source, target)
        ((_, before),) = packets(source)
        ((_, after),) = packets(target)
        assert [packet.data[7:] for packet in before] == [packet.data for packet in after]
        assert max(abs(x.start - y.start) for x, y in zip(before, after, strict=True)) < Fraction(
            1, 44100
        )
        assert "another form" not in caplog.text

    def test_subtitles(self, tmp_path: Path) -> None:
        source = film(tmp_path / "a.mkv", subtitles=True)
        assert carry(source, tmp_path / "out.mkv") == ["flac", "srt"]
        assert packets(tmp_path / "out.mkv") == packets(source)
        with av.open(str(tmp_path / "out.mkv")) as container:
            lines = container.streams.subtitles[0]
            assert lines.language == "deu"
            assert lines.disposition & av.stream.Disposition.forced

    @pytest.mark.parametrize(
        ("span", "expected"),
        [
            (Span(), [(100, 300), (520, 380)]),
            (Span(Fraction(1, 5), Fraction(7, 10)), [(200, 200), (520, 180)]),
            (Span(Fraction(1, 2), None), [(520, 380)]),
        ],
        ids=["all", "part", "end"],
    )
    def test_subtitles_of_mp4(
        self, tmp_path: Path, span: Span, expected: list[tuple[int, int]]
    ) -> None:
        source, target = mp4_with_subtitles(tmp_path / "a.mp4"), tmp_path / "out.mp4"
        assert carry(source, target, kept=span) == ["mov_text"]
        ((_, after),) = packets(target)
        lines = [packet for packet in after if packet.data != bytes(2)]
        times = [(int(1000 * line.start), int(1000 * line.duration)) for line in lines]
        assert times == expected
        assert lines[-1].data == b"\0\x0aGood night"

    def test_what_a_container_cannot_hold(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        source = film(tmp_path / "a.mkv", "pcm_s16le", subtitles=True)
        target = tmp_path / "out.mp4"
        carry(source, target)
        assert packets(target) == []
        assert len(list(open_video(target))) == 10
        (record,) = caplog.records
        assert record.getMessage() == (
            "mp4 cannot hold these streams: audio (pcm_s16le), subtitle (srt); left out"
        )

    def test_kinds_are_chosen(self, tmp_path: Path) -> None:
        source = film(tmp_path / "a.mkv", subtitles=True)
        assert carry(source, tmp_path / "1.mkv", kinds=("subtitle",)) == ["srt"]
        assert carry(source, tmp_path / "2.mkv", kinds=()) == []

    def test_garbage_is_left_out(self, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
        info = making.output_info([making.colour_bars()])
        video = making.NOISE.read_bytes()  # a picture beside the picture is no copied stream
        garbage = (b"\0\0\0\x18ftypisom", b"\x1aE\xdf\xa3" + bytes(99))
        for payload in (b"", b"no container", *garbage, video):
            caplog.clear()
            with open_writer(
                tmp_path / "out.mp4",
                replace(info, streams=((StreamTags(), payload),)),
                overwrite=True,
            ) as writer:
                writer.write(making.colour_bars(), 0, 1)
            assert "cannot be read and is left out" in caplog.text
            assert len(list(open_video(tmp_path / "out.mp4"))) == 1


class TestTrimming:
    @pytest.mark.parametrize("where", ["kept", "written"])
    def test_packets_of_the_span_at_their_times(self, tmp_path: Path, where: str) -> None:
        source = film(tmp_path / "a.mov", "pcm_s16le", frames=25)
        span = Span(Fraction(1, 5), Fraction(3, 5))
        target = tmp_path / "out.mp4"
        spans: dict[str, Any] = {where: span}
        carry(source, target, **spans)
        ((_, before),) = packets(source)
        ((_, after),) = packets(target)
        expected = [
            packet
            for packet in before
            if packet.start < Fraction(3, 5) and packet.start + packet.duration > Fraction(1, 5)
        ]
        assert after == expected
        assert 0 < len(after) < len(before)

    def test_subtitles_are_cut(self, tmp_path: Path) -> None:
        source = film(tmp_path / "a.mkv", subtitles=True)
        target = tmp_path / "out.mkv"
        carry(source, target, kept=Span(Fraction(1, 5), Fraction(7, 10)))
        assert [(line.start, line.duration) for line in packets(target)[1][1]] == [
            (Fraction(200, 1000), Fraction(200, 1000)),
            (Fraction(520, 1000), Fraction(180, 1000)),
        ]

    def test_nothing_left_of_a_stream(self, tmp_path: Path) -> None:
        source = film(tmp_path / "a.mkv", subtitles=True)
        assert carry(source, tmp_path / "1.mkv", kept=Span(Fraction(8), None)) == []
        carry(source, tmp_path / "2.mkv", written=Span(Fraction(8), None))
        assert packets(tmp_path / "2.mkv") == []


class TestTags:
    @pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
    def test_titles_languages_and_chapters(self, tmp_path: Path, suffix: str) -> None:
        source = film(tmp_path / f"a{suffix}", "aac")
        target = tmp_path / f"out{suffix}"
        carry(source, target)
        with opened(target) as (container, stream):
            tags = source_tags(container, stream, Span())
            sound = container.streams.audio[0]
            assert sound.language == "fra"
            assert "Commentary" in sound.metadata.values()
        with opened(source) as (container, stream):
            assert tags == source_tags(container, stream, Span())
        assert tags.film["title"] == "A film: \N{SNOWMAN}"
        assert tags.video.tags["language"] == "isl"
        assert [part.tags for part in tags.chapters] == [{"title": "Part 0"}, {"title": "Part 1"}]

    def test_chapters_are_cut(self, tmp_path: Path) -> None:
        source = film(tmp_path / "a.mkv")
        target = tmp_path / "out.mkv"
        carry(source, target, kept=Span(Fraction(1, 10), None), written=Span(None, Fraction(3, 10)))
        with opened(target) as (container, stream):
            chapters = source_tags(container, stream, Span()).chapters
        assert [(part.start, part.stop) for part in chapters] == [
            (Fraction(1, 10), Fraction(1, 5)),
            (Fraction(1, 5), Fraction(3, 10)),
        ]

    def test_nothing_is_needed(self) -> None:
        assert parse_tags(b"{}") == Tags()


def test_warnings_are_only_for_users(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        carry(film(tmp_path / "a.mkv", subtitles=True), tmp_path / "out.mkv")
    assert not caplog.records
