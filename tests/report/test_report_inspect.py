"""What a file says of itself, and that every damage is found."""

from __future__ import annotations

from pathlib import Path

import pytest

from gsvrcodec.bitstream.gop_payload import plane_table
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import NotGsvrError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ALL_ATTRIBUTES, ATTRIBUTES
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.report.inspect import inspect, inspect_bytes, verify
from tests import making
from tests.vectors.make import VALID


class TestInspect:
    def test_numbers(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", settings={"seed": 3})
        info = inspect(path)
        stored = 14 * 60 + 6 * (4 * 3 + 4 * 5 + 3 * 5)
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

    @pytest.mark.parametrize(("blending", "each"), [("mean", 14), ("sum", 13)])
    def test_without_a_tri_plane(self, tmp_path: Path, blending: Blending, each: int) -> None:
        info = inspect(making.gsvr_file(tmp_path / "a.gsvr", grid=(0, 0, 0), blending=blending))
        assert {gop.parameters for gop in info.gops} == {each * 60}
        assert info.to_dict()["blending"] == info.blending == blending

    def test_predicted_gops(self, tmp_path: Path) -> None:
        info = inspect(making.gsvr_file(tmp_path / "a.gsvr", predicted=True))
        assert [gop.reference_frame for gop in info.gops] == [None, 0, 5]
        assert [gop.carried for gop in info.gops] == [0, 48, 48]
        assert [(gop.dropped, gop.changed, gop.moved, gop.new) for gop in info.gops] == [
            (0, 0, 0, 60),
            (12, 24, 24, 12),
            (12, 24, 24, 12),
        ]
        grid = 6 * (4 * 3 + 4 * 5 + 3 * 5)
        predicted = 60 + 9 * 24 + 5 * 24 + 14 * 12 + grid
        assert [gop.parameters for gop in info.gops] == [14 * 60 + grid, predicted, predicted]
        data = info.to_dict()
        assert (data["key_gops"], data["gaussians"], data["carried_gaussians"]) == (1, 180, 96)
        assert not data["image_codecs"]
        assert not data["stream"]

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
        heads = 0
        with GsvrReader(path) as reader:
            payloads = [reader.read_gop(position) for position in range(3)]
            header = reader.header
            framing = 8 + 20 * len(reader.chunks)
            framing += sum(c.size for c in reader.chunks if c.type in (b"HEAD", b"indx", b"fend"))
        for payload in payloads:
            entries, offset, _ = plane_table(payload, header, Limits())
            heads += offset
            for entry in entries:
                name = entry.attribute.name
                planes[name] = planes.get(name, 0) + entry.size
        assert {name: items[name].bytes for name in planes} == planes
        assert {attribute.name for attribute in ATTRIBUTES} == set(planes)
        assert items["heads"].bytes == heads
        left = sum(map(len, payloads)) - heads - sum(planes.values())
        assert items["refinement"].bytes == left
        assert items["container"].bytes == framing
        assert (items["streams"].bytes, items["other"].bytes) == (5000, 30)
        assert items["settings"].bytes == len('{"seed": 3}')
        assert "unread" not in items
        assert sum(item.bytes for item in items.values()) == path.stat().st_size
        assert items["colour"].bits_per_gaussian == 8 * planes["colour"] / 180
        assert "ranges" in items["rotation"].codecs

    def test_what_predicted_gops_spend(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", predicted=True)
        items = {item.name: item.bytes for item in inspect_bytes(path)}
        assert [name for name in items if name in {a.name for a in ALL_ATTRIBUTES}] == [
            attribute.name for attribute in ALL_ATTRIBUTES
        ]
        assert items["mode"] > 30  # two planes of 60 modes of log2(5) bits
        assert sum(items.values()) == path.stat().st_size

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


def test_stream() -> None:
    info = inspect(VALID / "stream-growing.gsvr")
    assert info.stream
    assert not info.recovered
    assert info.warnings == ()


class TestVerify:
    def test_sound(self, tmp_path: Path) -> None:
        assert list(verify(making.gsvr_file(tmp_path / "a.gsvr", settings={}))) == []

    def test_what_a_damaged_gop_takes_along(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", frames=(5, 3, 4, 2), predicted=True)
        assert list(verify(path)) == []
        data = bytearray(path.read_bytes())
        with GsvrReader(path) as reader:
            first, second, third, _ = reader.gops
        for entry in (second, third):
            data[entry.chunk.payload_offset + 100] ^= 1
        path.write_bytes(data)
        damage = "damaged payload (CRC mismatch)"
        also = "the GOP at frame {} is predicted from this one"
        assert list(verify(path)) == [
            f"chunk GOPD at byte {second.offset}: {damage} (spec section 3)",
            f"chunk GOPD at byte {second.offset}: {damage}; {also.format(8)} (spec section 3)",
            f"chunk GOPD at byte {third.offset}: {damage} (spec section 3)",
            f"chunk GOPD at byte {second.offset}: {damage}; {also.format(12)} (spec section 3)",
        ]
        path.write_bytes(data[: first.offset] + data[first.chunk.end :])
        assert any("frame 8 is lost" in fault for fault in verify(path))

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
        (fault,) = verify(path)
        assert fault.startswith("the file has no whole GOP; ")
        assert fault.endswith("(spec section 3)")

    def test_a_gop_without_a_head_is_left_out(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr")
        sound = inspect(path)
        with GsvrReader(path) as reader:
            offset = reader.gops[1].chunk.payload_offset
        data = bytearray(path.read_bytes())
        data[offset + 70] ^= 1
        path.write_bytes(data)
        info = inspect(path)
        assert info.gops == (sound.gops[0], sound.gops[2])
        assert len(info.warnings) == 1
        assert info.metadata.gops == 3
