"""The conformance kit: streams, faulty files, and the worked example of the spec."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.bitstream.chunk import OVERHEAD_BYTES
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES
from gsvrcodec.bitstream.gop_payload import plane_table
from gsvrcodec.bitstream.header import HEADER_BYTES
from gsvrcodec.bitstream.index import END_BYTES, ENTRY_BYTES
from gsvrcodec.bitstream.plane_entries import ENTRY_START
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.limits import ENVIRONMENT_PREFIX, Limits
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.pyramid import level_of
from gsvrcodec.model.reconstruction import CUTOFF, DILATION, GROUND
from gsvrcodec.native import _core
from gsvrcodec.render.native import NativeBackend
from gsvrcodec.render.reference import ReferenceBackend
from tests.gops import decode_all, make_gop
from tests.vectors import check, decode, make, numpy_decoder
from tests.vectors.description import Picture, description, render
from tests.vectors.faults import faulty_vectors
from tests.vectors.regular import irregular, regular_samples, sensitivity
from tests.vectors.streams import RANDOM, STREAMS
from tests.vectors.worked_example import hex_dump

SPEC = Path(__file__).parent.parent / "spec" / "gsvr.md"
VALID = sorted(make.VALID.glob("*.gsvr"))
FAULTY = json.loads((make.FAULTY / "expected.json").read_text())
#: Small enough for the reference, which evaluates each Gaussian at each pixel.
SMALL = [path for path in VALID if path.stem in RANDOM]


def pictures(path: Path) -> list[Picture]:
    """The pictures of a stream that decoders are compared by."""
    described = json.loads(path.with_suffix(".json").read_text())
    return [Picture(**picture) for picture in described["pictures"]]


def context_heads() -> Iterator[bytes]:
    """The first bytes of all planes of codec 4 in all streams."""
    for path in VALID:
        with GsvrReader(path) as reader:
            for position in range(len(reader.gops)):
                payload = reader.read_gop(position)
                entries, offset, _ = plane_table(payload, reader.header, Limits())
                for entry in entries:
                    if entry.codec == 4:
                        yield payload[offset : offset + entry.size]
                    offset += entry.size


class TestStreams:
    def test_every_one_is_there(self) -> None:
        assert {path.stem for path in VALID} == set(STREAMS)
        named = {picture.file for path in VALID for picture in pictures(path)}
        assert {path.name for path in make.PICTURES.glob("*")} == named

    @pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
    def test_holds_what_is_described(self, path: Path) -> None:
        found = json.loads(json.dumps(description(path.stem, path.read_bytes())))
        assert found == json.loads(path.with_suffix(".json").read_text())

    @pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
    def test_is_sound(self, path: Path) -> None:
        with GsvrReader(path) as reader:
            assert reader.warnings == ()
            assert not reader.recovered
        assert make.taken(path)[0] == [0, 0, 0]

    @pytest.mark.parametrize("name", ["minimal", "black", "newer-minor", "stream-growing"])
    def test_writer_gives_the_same_bytes(self, name: str) -> None:
        assert STREAMS[name]() == (make.VALID / f"{name}.gsvr").read_bytes()

    @pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
    def test_pictures_are_of_the_regular_class(self, path: Path) -> None:
        with GsvrReader(path) as reader:
            for picture in pictures(path):
                assert not list(irregular(reader, picture)), picture

    def test_every_level_occurs(self) -> None:
        (content,) = decode_all((make.VALID / "levels.gsvr").read_bytes())
        assert set(level_of(content.gop.log_scale, 1.0).tolist()) == {0, 1, 2, 3, 4}

    def test_every_parameter_of_the_context_codec_occurs(self) -> None:
        """In as many ways as the encoder uses it: films and random Gaussians."""
        firsts, priors, divisions, thresholds = set(), set(), set(), set()
        for head in context_heads():
            firsts.add(head[0] >> 4)
            priors.add(count := head[0] & 15)
            offset = 1
            for _ in range(count):
                offset += 1
                while head[offset] & 0x80:
                    offset += 1
                offset += 1
            while head[offset] & 0x80:
                offset += 1
            offset += 1 + 6 * bool(head[0] & 0x20)
            divisions.add((head[offset] & 15, head[offset] >> 4))
            thresholds.add(head[offset + 1])
        assert firsts == {0, 2, 3}  # guided by a plane only with neighbours
        assert {0, 1, 2} <= priors  # none, the last one or two, and all of early and late planes
        assert {3, 4, 6, 7, 10} <= priors
        assert divisions == {(4, 2), (7, 2), (3, 1), (2, 0)}
        assert {0, 1, 7} <= thresholds


class TestDecoders:
    @pytest.mark.parametrize("isa", _core.isas())
    def test_native(self, isa: str, tmp_path: Path) -> None:
        before = _core.isa()
        _core.use_isa(isa)
        try:
            for path in VALID:
                decode.decode(path, tmp_path)
        finally:
            _core.use_isa(before)
        self.assert_passes(VALID, tmp_path)

    def test_from_the_text_of_the_spec(self, tmp_path: Path) -> None:
        for path in VALID:
            numpy_decoder.decode_vector(path, tmp_path)
        self.assert_passes(VALID, tmp_path)

    @pytest.mark.parametrize("name", ["predicted", "predicted-sum", "opacities"])
    def test_passages_from_the_text_of_the_spec(self, name: str) -> None:
        """Between a GOP and the next that is predicted from it, which no vector shows."""
        path = make.VALID / f"{name}.gsvr"
        film = numpy_decoder.Film(path.read_bytes())
        with gsvrcodec.open(path) as decoder:
            about = decoder.metadata
            for before, after in pairwise(film.chunks):
                moment = Fraction(2 * before.last_pts + after.first_pts, 3)
                wanted = film.picture(moment, about.width, about.height).clip(0, 1)
                found = decoder.render(moment * about.time_base)
                codes = np.floor(255 * wanted + 0.5).astype(np.uint8)
                assert not list(check.picture_differences(name, found, codes))

    @pytest.mark.parametrize("path", SMALL, ids=lambda path: path.stem)
    def test_reference(self, path: Path) -> None:
        with GsvrReader(path) as reader:
            for picture in pictures(path):
                found = render(reader, picture, ReferenceBackend(reader.header.blending))
                wanted = check.read_picture(picture.file)
                assert np.count_nonzero(found != wanted) <= 1  # a sum in another order

    @staticmethod
    def assert_passes(paths: list[Path], folder: Path) -> None:
        for path in paths:
            assert not list(check.differences(path.with_suffix(".json"), folder))


class TestRegularClass:
    """Random pictures, some with Gaussians so opaque that decoders disagree at their ends."""

    @staticmethod
    def random(seed: int) -> tuple[Gop, tuple[int, int]]:
        draw = np.random.default_rng(seed)
        gop = make_gop(int(draw.integers(1, 80)), (3, 2, 4), seed)
        gop.log_opacity[:] = draw.normal(0, draw.choice([1, 3, 6]), len(gop)).clip(-12, 12)
        gop.log_scale[:] += draw.uniform(-1, 1)
        width, height = draw.permutation([draw.integers(8, 60), draw.choice([20, 60, 1500])])
        return gop, (int(width), int(height))

    def test_regular_samples_are_within_one_code(self) -> None:
        found, wanted = NativeBackend(1), ReferenceBackend()
        taus = np.array([0.3], np.float32)
        of_regular, of_others = [], []
        for seed in range(30):
            gop, size = self.random(seed)
            (native,) = found.render(found.prepare(gop), taus, size, size)
            (reference,) = wanted.render(wanted.prepare(gop), taus, size, size)
            difference = np.abs(native.astype(int) - reference)
            regular = regular_samples(gop, 0.3, size, size)
            assert difference[regular].max(initial=0) <= 1
            assert np.count_nonzero(difference[regular]) <= 0.002 * regular.size + 16
            of_regular.append(difference[regular])
            of_others.append(difference[~regular])
        plain, others = np.concatenate(of_regular), np.concatenate(of_others)
        assert 0 < len(others) < 0.05 * len(plain)
        assert others.mean() > 10 * plain.mean()

    def test_sensitivity_of_one_gaussian_by_hand(self) -> None:
        gop = make_gop(1)
        gop.position[:], gop.log_scale[:], gop.log_opacity[:] = 0.5, 0, 3
        gop.linear[:] = gop.quadratic[:] = 0
        size = (8, 8)
        found = sensitivity(gop, 0.0, size, size)
        # The centre is at (6, 6), and the pixel (7, 5) is 1.5 and 0.5 pixels from it.
        e = math.exp(-(1.5**2 + 0.5**2) / (1 + DILATION) / 2)
        weight = math.exp(3) * (e - CUTOFF)
        left = 1 - weight / (GROUND + weight)  # of the ground
        expected = math.exp(3) * e * np.abs(gop.colour[0]) * left / (GROUND + weight)
        np.testing.assert_allclose(found[5, 7], expected, rtol=1e-6)
        assert not found[0, 0].any()


class TestCheck:
    """The comparison finds what differs."""

    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        decode.decode(make.VALID / "predicted.gsvr", tmp_path)
        return tmp_path

    def differences(self, folder: Path) -> str:
        return "; ".join(check.differences(make.VALID / "predicted.json", folder))

    def test_nothing(self, folder: Path) -> None:
        assert self.differences(folder) == ""

    def test_missing_files(self, tmp_path: Path) -> None:
        assert self.differences(tmp_path).startswith("no predicted.json; no predicted-0.png; no")

    def test_other_values(self, folder: Path) -> None:
        path = folder / "predicted.json"
        found = json.loads(path.read_text())
        found["gops"][0]["pts"][1] += 1
        found["gops"][1]["values"]["mode"]["sha256"] = ""
        del found["gops"][2]["values"]["mode"]
        path.write_text(json.dumps(found))
        said = self.differences(folder)
        assert "GOP 0: pts [0, 41, 80], expected [0, 40, 80]" in said
        assert "GOP 1: other values of mode" in said
        assert "GOP 2: attributes " in said

    @pytest.mark.parametrize(
        ("count", "by", "says"),
        [
            (34, 1, ""),
            (35, 1, "predicted-0.png differs in 35 of 9216 samples, 34 are allowed"),
            (1, 2, "predicted-0.png differs by up to 2 codes"),
        ],
    )
    def test_other_pictures(self, folder: Path, count: int, by: int, says: str) -> None:
        codes = check.read_picture("predicted-0.png").astype(np.uint8)
        flat = codes.reshape(-1)
        middle = np.flatnonzero((flat > 5) & (flat < 250))[:count]
        flat[middle] += by
        decode.write_picture(folder / "predicted-0.png", codes)
        assert self.differences(folder) == says

    def test_another_size(self, folder: Path) -> None:
        codes = check.read_picture("predicted-0.png").astype(np.uint8)
        decode.write_picture(folder / "predicted-0.png", codes[1:])
        assert "predicted-0.png has shape (47, 64, 3) of uint8" in self.differences(folder)


class TestFaulty:
    def test_every_vector_is_there(self) -> None:
        assert {path.stem for path in make.FAULTY.glob("*.gsvr")} == set(FAULTY)
        assert {fault.name for fault in faulty_vectors()} == set(FAULTY)

    @pytest.mark.parametrize("name", FAULTY)
    def test_is_taken_as_expected(self, name: str) -> None:
        codes, said = make.taken(make.FAULTY / f"{name}.gsvr")
        assert (
            dict(zip(make.TOOLS, codes, strict=True)) | {"says": FAULTY[name]["says"]}
            == (FAULTY[name])
        )
        assert any(FAULTY[name]["says"] in line for line in said)
        # A broken rule is named by its section; what is not supported breaks none.
        faults = [line for line in said[2].splitlines() if " error: " in line]
        assert all("(spec section " in line for line in faults) == (codes[2] != 4)

    @pytest.mark.parametrize("name", FAULTY)
    def test_the_second_decoder_says_the_same(self, name: str) -> None:
        path = make.FAULTY / f"{name}.gsvr"
        assert numpy_decoder.main([str(path)]) == FAULTY[name]["gsvrdec"]


class TestSpec:
    def test_worked_example_is_the_minimal_vector(self) -> None:
        lines = re.findall(r"^    ([0-9a-f]{4})  ((?:[0-9a-f]{2} ?)+)", SPEC.read_text(), re.M)
        data = b""
        for offset, dump in lines:
            assert int(offset, 16) == len(data)
            data += bytes.fromhex(dump)
        assert data == (make.VALID / "minimal.gsvr").read_bytes()
        assert hex_dump(data) in SPEC.read_text()
        (content,) = decode_all(data)
        assert content.gop.position.tolist() == [[0, 0]]
        assert content.gop.log_scale.tolist() == [[0.5, 0]]
        assert content.gop.colour.tolist() == [[0.5, 0.5, 0.5]]
        assert content.pts.tolist() == [0]

    def test_byte_tables_have_no_holes(self) -> None:
        sizes = {"u8": 1, "u16": 2, "u32": 4, "u64": 8, "i64": 8, "f32": 4}
        sizes |= {"[4]": 4, "[44]": 44, "[length]": 0, "varint": 0}
        ends = []
        tables = re.findall(r"^\| offset.*\n\|[-|]+\n((?:\|.*\n)+)", SPEC.read_text(), re.M)
        for table in tables:
            end = 0
            for offset, kind in re.findall(r"^\| (\d+)(?: \+ length)? \| (\S+) \|", table, re.M):
                assert int(offset) == end
                end += sizes[kind]
            ends.append(end)
        heads = [OVERHEAD_BYTES, HEADER_BYTES, GOP_HEAD_BYTES]
        assert ends == [*heads, ENTRY_START.size, ENTRY_BYTES, END_BYTES]

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
