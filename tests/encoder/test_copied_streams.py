"""Sound and subtitles from a film through a .gsvr file into another film."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

import gsvrcodec
from gsvrcodec.bitstream.chunk import OVERHEAD_BYTES
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.encoder.encode import EncodeResult
from tests.video.films import film, packets


def coded(source: Path, **settings: Any) -> tuple[Path, EncodeResult]:
    """Encode a film with the least effort."""
    target = source.with_suffix(".gsvr")
    result = gsvrcodec.encode(
        source,
        target,
        preset="fastest",
        gaussians=20,
        pack="deflate",
        overwrite=True,
        **settings,
    )
    return target, result


def test_every_packet_comes_back(tmp_path: Path) -> None:
    source = film(tmp_path / "a.mkv", subtitles=True)
    file, result = coded(source)
    gsvrcodec.decode(file, tmp_path / "b.mkv")
    assert [codec for codec, _ in packets(source)] == ["flac", "srt"]
    assert packets(tmp_path / "b.mkv") == packets(source)
    with gsvrcodec.open(file) as decoder:
        assert decoder.metadata.tags.film["title"] == "A film: \N{SNOWMAN}"
        assert [part.stop for part in decoder.metadata.tags.chapters] == [
            Fraction(1, 5),
            Fraction(2, 5),
        ]
        kept = [len(payload) for _, payload in decoder.streams()]
        assert decoder.metadata.streams_bytes == sum(kept) + len(kept) * OVERHEAD_BYTES
        assert result.bpp == decoder.metadata.bpp
        assert result.bpp == 8 * (result.bytes - decoder.metadata.streams_bytes) / 10 / 32 / 16


def test_same_film_same_bytes(tmp_path: Path) -> None:
    source = film(tmp_path / "a.mkv", subtitles=True)
    first = coded(source)[0].read_bytes()
    assert coded(source)[0].read_bytes() == first


def test_streams_can_be_left_out(tmp_path: Path) -> None:
    source = film(tmp_path / "a.mkv", subtitles=True)
    file, _ = coded(source, audio=False)
    gsvrcodec.decode(file, tmp_path / "b.mkv")
    assert packets(tmp_path / "b.mkv") == packets(source)[1:]
    file, _ = coded(source, audio=False, subtitles=False)
    with gsvrcodec.open(file) as decoder:
        assert decoder.metadata.streams_bytes == 0


def test_trimmed_twice(tmp_path: Path) -> None:
    source = film(tmp_path / "a.mov", "pcm_s16le", frames=20)
    file, _ = coded(source, start_frame=5, frames=10)
    gsvrcodec.decode(file, tmp_path / "b.mp4", start_frame=2)
    ((_, before),) = packets(source)
    ((_, after),) = packets(tmp_path / "b.mp4")
    assert after == [
        packet
        for packet in before
        if packet.start < Fraction(15, 25) and packet.start + packet.duration > Fraction(7, 25)
    ]
    assert 10 < len(after) < len(before)


def test_another_speed_has_no_sound(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file, _ = coded(film(tmp_path / "a.mkv", frames=2))
    gsvrcodec.decode(file, tmp_path / "b.mkv", speed=0.5)
    assert packets(tmp_path / "b.mkv") == []
    assert "sound and subtitles are left out" in caplog.text


def test_damaged_sound_leaves_the_picture(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file, _ = coded(film(tmp_path / "a.mkv", frames=2, subtitles=True))
    with GsvrReader(file) as reader:
        offset = reader.streams[0].payload_offset
    content = bytearray(file.read_bytes())
    content[offset + 50] ^= 1
    file.write_bytes(content)
    assert gsvrcodec.decode(file, tmp_path / "b.mkv").frames == 2
    assert [codec for codec, _ in packets(tmp_path / "b.mkv")] == ["srt"]
    assert "a copied stream is left out: chunk strm" in caplog.text
