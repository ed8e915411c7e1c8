"""The test vectors, and the worked example of the spec."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

from gsvrcodec.bitstream.chunk import OVERHEAD_BYTES
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES
from gsvrcodec.bitstream.header import HEADER_BYTES
from gsvrcodec.bitstream.index import END_BYTES, ENTRY_BYTES
from gsvrcodec.bitstream.plane_table import PLANE_ENTRY_BYTES
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import GsvrError
from gsvrcodec.limits import ENVIRONMENT_PREFIX, Limits
from tests.gops import decode_all
from tests.vectors import make

SPEC = Path(__file__).parent.parent / "spec" / "gsvr.md"
VALID = sorted(make.VALID.glob("*.gsvr"))
FAULTY = json.loads((make.FAULTY / "expected.json").read_text())


class TestValid:
    def test_every_vector_is_there(self) -> None:
        assert {path.stem for path in VALID} == {name for name, _ in make.valid_vectors()}

    @pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
    def test_decodes_to_its_description(self, path: Path) -> None:
        found = json.loads(json.dumps(make.description(path.read_bytes())))
        expected = json.loads(path.with_suffix(".json").read_text())
        for gop, wanted_gop in zip(found["gops"], expected["gops"], strict=True):
            carried, wanted = (one.pop("carried_over", {}) for one in (gop, wanted_gop))
            assert carried.keys() == wanted.keys()
            for name, numbers in wanted.items():
                one = np.array(carried[name].split(), float)
                np.testing.assert_allclose(one, np.array(numbers.split(), float), atol=3e-6)
        assert found == expected

    @pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
    def test_has_no_warnings(self, path: Path) -> None:
        with GsvrReader(path) as reader:
            assert reader.warnings == ()
            assert not reader.recovered

    @pytest.mark.parametrize("name", ["minimal", "black", "newer-minor"])
    def test_writer_gives_the_same_bytes(self, name: str) -> None:
        assert dict(make.valid_vectors())[name] == (make.VALID / f"{name}.gsvr").read_bytes()


class TestFaulty:
    def test_every_vector_is_there(self) -> None:
        assert {path.stem for path in make.FAULTY.glob("*.gsvr")} == set(FAULTY)
        assert {fault.name for fault in make.faulty_vectors()} == set(FAULTY)

    @pytest.mark.parametrize("name", FAULTY)
    def test_is_taken_as_expected(self, name: str) -> None:
        data = (make.FAULTY / f"{name}.gsvr").read_bytes()
        expected = FAULTY[name]
        if expected["exit_code"] == 0:
            assert decode_all(data)
            with GsvrReader(io.BytesIO(data)) as reader:
                assert expected["says"] in " ".join(reader.warnings)
            return
        with pytest.raises(GsvrError) as caught:
            decode_all(data)
        assert caught.value.exit_code == expected["exit_code"]
        assert expected["says"] in str(caught.value)


class TestSpec:
    def test_worked_example_is_the_minimal_vector(self) -> None:
        lines = re.findall(r"^    ([0-9a-f]{4})  ((?:[0-9a-f]{2} ?)+)", SPEC.read_text(), re.M)
        data = b""
        for offset, dump in lines:
            assert int(offset, 16) == len(data)
            data += bytes.fromhex(dump)
        assert data == (make.VALID / "minimal.gsvr").read_bytes()
        assert data == make.minimal()
        (content,) = decode_all(data)
        assert content.gop.position.tolist() == [[0, 0]]
        assert content.gop.log_scale.tolist() == [[0.5, 0]]
        assert content.gop.colour.tolist() == [[0.5, 0.5, 0.5]]
        assert content.pts.tolist() == [0]

    def test_byte_tables_have_no_holes(self) -> None:
        sizes = {"u8": 1, "u16": 2, "u32": 4, "u64": 8, "i64": 8, "f32": 4}
        sizes |= {"[4]": 4, "[44]": 44, "[length]": 0}
        ends = []
        tables = re.findall(r"^\| offset.*\n\|[-|]+\n((?:\|.*\n)+)", SPEC.read_text(), re.M)
        for table in tables:
            end = 0
            for offset, kind in re.findall(r"^\| (\d+)(?: \+ length)? \| (\S+) \|", table, re.M):
                assert int(offset) == end
                end += sizes[kind]
            ends.append(end)
        heads = [OVERHEAD_BYTES, HEADER_BYTES, GOP_HEAD_BYTES]
        assert ends == [*heads, PLANE_ENTRY_BYTES, ENTRY_BYTES, END_BYTES]

    def test_names_every_limit_with_its_default(self) -> None:
        table = re.findall(r"\| ([^|]+?) \| (GSVR_LIMIT_\w+) \|$", SPEC.read_text(), re.M)

        def number(text: str) -> int:
            power = re.fullmatch(r"2\^(\d+)( - 1)?", text)
            return 2 ** int(power[1]) - bool(power[2]) if power else int(text)

        found = {name: number(text) for text, name in table}
        defaults = Limits()
        assert found == {
            ENVIRONMENT_PREFIX + field.upper(): getattr(defaults, field)
            for field in Limits.__slots__
        }


def test_every_attack_of_the_spec_has_its_test() -> None:
    tests = Path(__file__).parent
    named = re.findall(
        r"\| ([\w/]+\.py)::(\w+)::(\w+) \|$", (SPEC.parent / "attacks.md").read_text(), re.M
    )
    assert len(named) > 30
    for file, group, name in named:
        body = (tests / file).read_text().split(f"class {group}:", 1)[1].split("\nclass ", 1)[0]
        assert f"def {name}(" in body
