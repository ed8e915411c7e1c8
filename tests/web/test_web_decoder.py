"""The decoder in JavaScript: the conformance kit, and damaged films by the thousand."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gsvrcodec.bitstream.chunk import GOP_TYPE, HEAD_TYPE
from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.gop_payload import unpack_plate
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import CorruptError, UnsupportedError
from gsvrcodec.limits import Limits
from gsvrcodec.model import passage, reconstruction
from gsvrcodec.model.attributes import TRIPLANE_CHANNELS, attributes_of
from gsvrcodec.model.reconstruction import Blending
from tests import fuzz
from tests.tampering import TABLE_OFFSET, Piece, edited, joined, patched, pieces
from tests.vectors import make
from tests.web.films import RANDOM_SIZE, random_film, random_plate

pytestmark = pytest.mark.slow

FAULTY = json.loads((make.FAULTY / "expected.json").read_text())
ERRORS = {0: "ok", 3: "CorruptError", 4: "UnsupportedError"}


def verdicts(bench: Any, contents: list[bytes]) -> list[list[str]]:
    """Return the decoder's verdict on each file: "ok" or the error's name, and its sentence."""
    texts = [base64.b64encode(content).decode("ascii") for content in contents]
    found: list[list[str]] = bench.evaluate(
        """async (texts) => {
            const found = [];
            for (const text of texts) found.push(await harness.verdict(harness.fromText(text)));
            return found;
        }""",
        texts,
    )
    return found


def by_the_package(content: bytes) -> str:
    """Return the verdict of the package's own decoder on a file, without `--keep-going`."""
    try:
        with GsvrReader(io.BytesIO(content)) as reader:
            if reader.recovered:
                return "CorruptError"
            unpacker = GopUnpacker(reader, Limits())
            for position in range(len(reader.gops)):
                unpacker.unpack(position)
    except CorruptError:
        return "CorruptError"
    except UnsupportedError:
        return "UnsupportedError"
    return "ok"


class TestTables:
    def test_constants_are_those_of_the_package(self, bench: Any) -> None:
        found = bench.evaluate("async () => ({ ...await import('/reconstruction.js') })")
        assert found.pop("LEAST_SHARE") == passage._LEAST_SHARE
        assert set(found) == {name for name in vars(reconstruction) if name.isupper()} - {
            "LEVEL_SCALE"
        }
        for name, value in found.items():
            assert value == getattr(reconstruction, name), name

    @pytest.mark.parametrize("blending", ["mean", "sum"])
    def test_attributes_are_those_of_the_package(self, bench: Any, blending: Blending) -> None:
        found = bench.evaluate(
            """async (blending) => {
                const { ATTRIBUTES, storedComponents } = await import("/attributes.js");
                return ATTRIBUTES.map((each, id) => (
                    [id, each.name, storedComponents(each, blending), each.low, each.high]
                )).filter(([, , components]) => components);
            }""",
            blending,
        )
        wanted = [[a.id, a.name, a.components, a.low, a.high] for a in attributes_of(blending)]
        assert found == wanted


class TestHeader:
    """How a header may say that pictures are formed, or may not."""

    @pytest.mark.parametrize(
        ("edit", "verdict", "said"),
        [
            (lambda header: header, "ok", ""),
            (lambda header: header.__setitem__(70, 0), "CorruptError", "plane table"),
            (lambda header: header.__setitem__(70, 2), "UnsupportedError", "an unknown way"),
            (lambda header: header.__delitem__(70), "UnsupportedError", "anew"),
            (lambda header: header.append(0), "UnsupportedError", "anew"),
            (lambda header: header.__delitem__(slice(69, None)), "CorruptError", "69 bytes"),
        ],
    )
    def test_verdicts(
        self, bench: Any, edit: Callable[[bytearray], object], verdict: str, said: str
    ) -> None:
        content = edited(random_film("mean"), HEAD_TYPE, edit)
        assert by_the_package(content) == verdict
        [(found, sentence)] = verdicts(bench, [content])
        assert found == verdict
        assert said in sentence


def with_plate(plate: bytes) -> bytes:
    """A film whose first GOP stores some bytes as its plate."""
    return random_film("mean", plates=[plate, None])


def second_stores_one(content: bytes) -> bytes:
    """The film, whose second GOP, a predicted one, says that it stores a plate, too."""
    chunks = pieces(content)
    gops = [n for n, chunk in enumerate(chunks) if chunk.type == GOP_TYPE]
    payload = bytearray(chunks[gops[1]].payload)
    payload[54] = 1
    chunks[gops[1]] = Piece(GOP_TYPE, bytes(payload))
    return joined(chunks)


GOOD = random_plate(1)
FILM = with_plate(GOOD)


class TestPlates:
    @pytest.mark.parametrize(
        ("content", "verdict", "said"),
        [
            (FILM, "ok", ""),
            (patched(FILM, HEAD_TYPE, 4, "I", 0), "CorruptError", "where none may be"),
            (patched(FILM, HEAD_TYPE, 4, "I", 3), "UnsupportedError", "flags 3"),
            (
                patched(random_film("sum"), HEAD_TYPE, 4, "I", 1),
                "CorruptError",
                "plates in a film of sums",
            ),
            (patched(random_film("mean"), HEAD_TYPE, 4, "I", 1), "ok", ""),
            (patched(FILM, GOP_TYPE, 54, "H", 2), "CorruptError", "where none may be"),
            (second_stores_one(FILM), "CorruptError", "where none may be"),
            (patched(FILM, GOP_TYPE, TABLE_OFFSET, "I", 2**31), "CorruptError", "too early"),
            (with_plate(b""), "CorruptError", "no AVIF picture of 64x48 pixels"),
            (with_plate(GOOD[:200]), "CorruptError", "too early"),
            (with_plate(GOOD[:-500]), "CorruptError", "too early"),
            (with_plate(b"x" + GOOD), "CorruptError", "too early"),
            (with_plate(random_plate(1, (48, 64))), "CorruptError", "of 64x48 pixels"),
            (with_plate(random_plate(1, pixelformat="420")), "CorruptError", "4:4:4"),
        ],
    )
    def test_verdicts(self, bench: Any, content: bytes, verdict: str, said: str) -> None:
        assert by_the_package(content) == verdict
        [(found, sentence)] = verdicts(bench, [content])
        assert found == verdict
        assert said in sentence

    def test_samples_are_exact(self, bench: Any) -> None:
        found = decoded(bench, exact=True)
        assert found.pop("isYcc")
        wanted = unpack_plate(GOOD, RANDOM_SIZE).ycc
        assert np.array_equal(found["texels"], np.moveaxis(wanted, 0, -1))

    def test_a_browser_that_has_colours_alone(self, bench: Any) -> None:
        found = decoded(bench, exact=False)
        assert not found.pop("isYcc")
        wanted = 255 * unpack_plate(GOOD, RANDOM_SIZE).colours.clip(0, 1)
        assert np.abs(found["texels"] - wanted).max() < 1


def decoded(bench: Any, *, exact: bool) -> dict[str, Any]:
    """Decode the plate in the page, with or without the decoder that tells Y, Cb and Cr."""
    width, height = RANDOM_SIZE
    found: dict[str, Any] = bench.evaluate(
        """async ([text, width, height, exact]) => {
            const { decodePlate } = await import("/plate.js");
            const bytes = harness.fromText(text), { ImageDecoder } = window;
            if (!exact) delete window.ImageDecoder;
            const { isYcc, texels } = await decodePlate(bytes, { width, height });
            Object.assign(window, { ImageDecoder });
            return { isYcc, texels: await harness.toText(texels) };
        }""",
        [base64.b64encode(GOOD).decode("ascii"), width, height, exact],
    )
    raw = base64.b64decode(found["texels"].partition(",")[2])
    texels = np.frombuffer(raw, np.uint8).reshape(height, width, 4)
    return found | {"texels": texels[:, :, :3]}


class TestKit:
    @pytest.mark.parametrize(
        "name", ["refined", "predicted-refined", "variable-rate", "film-sound"]
    )
    def test_values_are_exact(self, bench: Any, name: str) -> None:
        """All values of key GOPs, and timing; the other values are compared by their pictures."""
        content = (make.VALID / f"{name}.gsvr").read_bytes()
        described = json.loads((make.VALID / f"{name}.json").read_text())["gops"]
        found = bench.evaluate(
            "text => harness.values(harness.fromText(text))",
            base64.b64encode(content).decode("ascii"),
        )
        assert len(found) == len(described)
        for gop, wanted in zip(found, described, strict=True):
            first = wanted["pts"][0]
            assert gop["pts"] == [pts - first for pts in wanted["pts"]]
            for attribute, coded in wanted["values"].items():
                if attribute in gop["values"] and wanted["reference"] == 0:
                    raw = base64.b64decode(gop["values"][attribute].partition(",")[2])
                    if attribute in ("xy", "xt", "yt"):  # channels that are not stored are 0
                        channels = np.frombuffer(raw, np.float32).reshape(-1, TRIPLANE_CHANNELS)
                        assert not channels[:, coded["shape"][-1] :].any()
                        raw = channels[:, : coded["shape"][-1]].tobytes()
                    assert hashlib.sha256(raw).hexdigest() == coded["sha256"], attribute

    def test_faults_are_found(self, bench: Any) -> None:
        contents = [(make.FAULTY / f"{name}.gsvr").read_bytes() for name in FAULTY]
        found = dict(zip(FAULTY, verdicts(bench, contents), strict=True))
        wrong = {
            name: (verdict, said)
            for name, (verdict, said) in found.items()
            if verdict != ERRORS[FAULTY[name]["gsvrdec"]] and "JPEG XL" not in said
        }
        assert wrong == {}

    def test_sentences_say_what_is_wrong(self, bench: Any) -> None:
        contents = [(make.FAULTY / f"{name}.gsvr").read_bytes() for name in FAULTY]
        for _, said in verdicts(bench, contents):
            assert said == "" or (said[0].isupper() and said.endswith(".") and "\n" not in said)


class TestDamage:
    def test_1000_damaged_films(self, bench: Any) -> None:
        """Flips, cuts, and fields forged under right checksums: the verdict of the package."""
        draw = random.Random(7)
        seeds = fuzz.seeds()
        change = (fuzz.flipped, fuzz.forged)
        contents = [change[n % 2](draw.choice(seeds), draw) for n in range(1000)]
        found = verdicts(bench, contents)
        assert {verdict for verdict, _ in found} <= set(ERRORS.values())
        wrong = [
            (verdict, said, wanted)
            for (verdict, said), content in zip(found, contents, strict=True)
            if "JPEG XL" not in said and verdict != (wanted := by_the_package(content))
        ]
        assert wrong == []
