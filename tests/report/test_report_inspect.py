"""What a file says of itself, and that every damage is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gsvrcodec.bitstream.chunk import BACKGROUND_TYPE
from gsvrcodec.bitstream.gop_payload import plane_table
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import CorruptError, NotGsvrError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.report.inspect import inspect, inspect_bytes, verify
from tests import making
from tests.gops import make_background, make_file, make_payload
from tests.tampering import patched
from tests.vectors.make import VALID


class TestInspect:
    def test_numbers(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", settings={"seed": 3})
        info = inspect(path)
        stored = making.random_gop(np.random.default_rng(7)).parameters
        assert [gop.frames for gop in info.gops] == [5, 3, 4]
        assert [gop.first_frame for gop in info.gops] == [0, 5, 8]
        assert [gop.parameters for gop in info.gops] == [stored] * 3
        assert info.parameters == 3 * stored
        assert not info.recovered
        data = info.to_dict()
        assert data["gops"] == 3
        assert data["gaussians"] == 180
        assert data["parameters"] == 3 * stored
        assert data["bytes"] == path.stat().st_size
        assert data["bpp"] == 8 * data["bytes"] / (12 * 48 * 32)
        assert (data["width"], data["height"], data["frames"]) == (48, 32, 12)
        assert data["settings"] == {"seed": 3}

    def test_without_a_tri_plane(self, tmp_path: Path) -> None:
        info = inspect(making.gsvr_file(tmp_path / "a.gsvr", grid=(0, 0, 0)))
        assert {gop.parameters for gop in info.gops} == {13 * 60}

    def test_what_a_lost_background_takes_along(self, tmp_path: Path) -> None:
        data = bytearray((VALID / "backgrounds.gsvr").read_bytes())
        path = tmp_path / "a.gsvr"
        path.write_bytes(data)
        assert list(verify(path)) == []
        with GsvrReader(path) as reader:
            background, offsets = reader.backgrounds[0].chunk, [gop.offset for gop in reader.gops]
        data[background.payload_offset + 60] ^= 1
        path.write_bytes(data)
        faults = list(verify(path))
        assert f"chunk SCNE at byte {background.offset}" in faults[0]
        for fault, offset in zip(faults[1:], offsets[:2], strict=True):
            assert f"chunk GOPD at byte {offset}: background 1 is lost" in fault

    def test_a_background_of_another_size(self, tmp_path: Path) -> None:
        shown = np.arange(40) % 2 == 0
        sound = make_file(
            [make_payload(6, background=3, shown=shown)], backgrounds={0: make_background(3, 40)}
        )
        path = tmp_path / "a.gsvr"
        path.write_bytes(patched(sound, BACKGROUND_TYPE, 4, "I", 39))
        (fault,) = verify(path)
        assert fault == "chunk SCNE at byte 98: background 3 has 39 Gaussians, the GOP expects 40"

    def test_unfinished_file(self, tmp_path: Path) -> None:
        info = inspect(making.gsvr_file(tmp_path / "a.gsvr", close=False))
        assert info.recovered
        assert info.warnings
        assert info.metadata.frames == 12

    def test_video_fails(self) -> None:
        with pytest.raises(NotGsvrError):
            inspect(making.NOISE)


class TestBytes:
    def test_all_of_the_file_by_attribute(self, tmp_path: Path) -> None:
        extra = {b"strm": bytes(5000), b"abcd": bytes(30)}
        path = making.gsvr_file(tmp_path / "a.gsvr", settings={"seed": 3}, auxiliary=extra)
        items = {item.name: item for item in inspect_bytes(path)}
        planes: dict[str, int] = {}
        with GsvrReader(path) as reader:
            payloads = [reader.read_gop(position) for position in range(3)]
            header = reader.header
            framing = 8 + 20 * len(reader.chunks)
            framing += sum(c.size for c in reader.chunks if c.type in (b"HEAD", b"indx", b"fend"))
        for payload in payloads:
            for entry in plane_table(payload, header, Limits()):
                name = entry.attribute.name
                planes[name] = planes.get(name, 0) + entry.size
        assert {name: items[name].bytes for name in planes} == planes
        assert {attribute.name for attribute in ATTRIBUTES} == set(planes)
        assert items["heads"].bytes == sum(map(len, payloads)) - sum(planes.values())
        assert items["container"].bytes == framing
        assert (items["streams"].bytes, items["other"].bytes) == (5000, 30)
        assert items["settings"].bytes == len('{"seed": 3}')
        assert "unread" not in items
        assert sum(item.bytes for item in items.values()) == path.stat().st_size
        assert items["colour"].bits_per_gaussian == 8 * planes["colour"] / 180
        assert "ranges" in items["rotation"].codecs

    def test_damaged_gop_is_unread(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr")
        sound = {item.name: item.bytes for item in inspect_bytes(path)}
        with GsvrReader(path) as reader:
            gop = reader.gops[1].chunk
        data = bytearray(path.read_bytes())
        data[gop.payload_offset + 100] ^= 1
        path.write_bytes(data)
        found = {item.name: item.bytes for item in inspect_bytes(path)}
        assert found["unread"] == gop.size
        assert found["position"] < sound["position"]
        assert sum(found.values()) == len(data)


class TestVerify:
    def test_sound(self, tmp_path: Path) -> None:
        assert list(verify(making.gsvr_file(tmp_path / "a.gsvr", settings={}))) == []

    def test_every_chunk_is_checked(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", settings={"seed": 1})
        sound = path.read_bytes()
        with GsvrReader(path) as reader:
            chunks = [chunk for chunk in reader.chunks if chunk.type in (b"GOPD", b"sett")]
        assert len(chunks) == 4
        for chunk in chunks:
            data = bytearray(sound)
            data[chunk.payload_offset + chunk.size // 2] ^= 16
            path.write_bytes(data)
            (fault,) = verify(path)
            assert f"chunk {chunk.name} at byte {chunk.offset}" in fault

    def test_unfinished_file(self, tmp_path: Path) -> None:
        faults = list(verify(making.gsvr_file(tmp_path / "a.gsvr", close=False)))
        assert "no valid index" in faults[0]

    def test_nothing_left_fails(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr")
        path.write_bytes(path.read_bytes()[:200])
        with pytest.raises(CorruptError):
            list(verify(path))
