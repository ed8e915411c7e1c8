"""One truth for tables: those of the specification and of JavaScript are those of the package.

`tests/render/test_constants.py` compares C++, and `tests/web/test_web_decoder.py` what a browser
can tell. Triton takes its constants from the package.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import pytest

from gsvrcodec.bitstream import chunk, gop_head, header, index, plane_entries, recovery
from gsvrcodec.limits import ENVIRONMENT_PREFIX, Limits
from gsvrcodec.model import attributes, layers, prediction, refinement
from gsvrcodec.model.gop import Gop

ROOT = Path(__file__).parent.parent
SPEC = (ROOT / "spec" / "gsvr.md").read_text("utf-8")
WEB = ROOT / "gsvrcodec" / "web"

#: Formats of `struct` by the types of the specification.
FORMATS = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i64": "q", "f32": "f", "[4]": "4s"}


def table(section: str) -> list[list[str]]:
    """Return the rows of the first table below a heading."""
    below = SPEC[SPEC.index(f"\n{section}") :]
    rows = re.search(r"\n\|.*\n\|[-|]+\n((?:\|.*\n)+)", below)
    assert rows is not None
    return [[cell.strip() for cell in row[1:-2].split("|")] for row in rows[1].splitlines(True)]


def number(text: str) -> float:
    """Return the value of an expression, as the specification or JavaScript writes it."""
    plain = re.sub(r"(?<=\d)n\b", "", text).replace("^", "**")
    assert re.fullmatch(r"[\d\s.*/+-]+", plain), text
    value: float = eval(plain)
    return value


def script(name: str, constant: str) -> float:
    """Return a constant of a module of the player."""
    found = re.findall(
        rf"\b{constant}(?: =|:) ([^,;\n]+)[,;]", (WEB / f"{name}.js").read_text("utf-8")
    )
    assert len(found) == 1, f"{constant} stands {len(found)} times in {name}.js"
    return number(found[0])


class TestSpecification:
    @pytest.mark.parametrize(
        ("section", "layout"),
        [
            ("## 3. ", [chunk._FIELDS, chunk._CRC]),
            ("## 4. ", [header._LAYOUT]),
            ("### 5.1 ", [gop_head._SUMMARY, gop_head._SHAPE]),
            ("### 5.3 ", [plane_entries.ENTRY_START]),
            ("## 9. ", [index._ENTRY]),
        ],
    )
    def test_layouts(self, section: str, layout: list[struct.Struct]) -> None:
        """Types, and offsets without gaps."""
        rows = [row for row in table(section) if row[0].isdigit() and row[1] in FORMATS]
        offset = 0
        for at, kind, *_ in rows:
            assert int(at) == offset
            offset += struct.calcsize("<" + FORMATS[kind])
        wanted = "".join(part.format.removeprefix("<").replace(" ", "") for part in layout)
        assert "".join(FORMATS[kind] for _, kind, *_ in rows) == wanted

    def test_attributes(self) -> None:
        names = {"gaussians": "new", "xy": "XY", "xt": "XT", "yt": "YT"}
        found = [row[:5] for row in table("### 5.4 ")]
        for row, attribute in zip(found, attributes.ALL_ATTRIBUTES, strict=True):
            components = [
                own.components
                for blending in ("mean", "sum")
                for own in attributes.attributes_of(blending)
                if own.id == attribute.id
            ]
            assert [row[0], row[1]] == [str(attribute.id), attribute.name]
            assert row[2].split(":")[0] == " or ".join(map(str, sorted(set(components))))
            assert row[3] == names.get(attribute.grid, attribute.grid)
            assert row[4] == f"{attribute.low:g}, {attribute.high:g}"

    def test_limits(self) -> None:
        found = {name: number(limit) for _, limit, name in table("## 12. ")}
        limits = Limits()
        assert found == {
            ENVIRONMENT_PREFIX + name.upper(): getattr(limits, name) for name in Limits.__slots__
        }


class TestPlayer:
    @pytest.mark.parametrize("name", Limits.__slots__)
    def test_limits(self, name: str) -> None:
        first, *rest = name.split("_")
        own = name.upper() if first == "expansion" else first + "".join(map(str.title, rest))
        assert script("limits", own) == getattr(Limits(), name)

    @pytest.mark.parametrize(
        ("module", "constant", "value"),
        [
            ("attributes", "CHANNELS", attributes.TRIPLANE_CHANNELS),
            ("attributes", "MEAN_CHANNELS", attributes.MEAN_CHANNELS),
            ("attributes", "MOVED", prediction.MOVED),
            ("attributes", "CHANGED", prediction.CHANGED),
            ("attributes", "DROPPED", prediction.DROPPED),
            ("chunks", "SIGNATURE_BYTES", len(chunk.SIGNATURE)),
            ("chunks", "HEAD_BYTES", chunk.HEAD_BYTES),
            ("gop_head", "SUMMARY_BYTES", gop_head.SUMMARY_BYTES),
            ("gop_head", "GOP_HEAD_BYTES", gop_head.GOP_HEAD_BYTES),
            ("header", "HEADER_BYTES", header.HEADER_BYTES),
            ("index", "ENTRY_BYTES", index.ENTRY_BYTES),
            ("refinement", "MOST_BITS", refinement.MOST_BITS),
            ("layers", "LEAST_WAY", layers.DYNAMIC_DISPLACEMENT),
            ("walk", "WINDOW_BYTES", recovery._WINDOW_BYTES),
        ],
    )
    def test_constants(self, module: str, constant: str, value: Any) -> None:
        assert script(module, constant) == value

    def test_slots(self) -> None:
        """Where the components of each attribute of a Gaussian stand."""
        slot = 0
        for attribute in attributes.ATTRIBUTES[: Gop.__slots__.index("xy")]:
            if attribute.name != "position":
                assert script("attributes", attribute.name.upper()) == slot
            slot += attribute.components
            if attribute.name == "log_opacity":
                assert script("attributes", "LOOK_SLOTS") == slot
        assert script("attributes", "SLOTS") == slot

    def test_signature(self) -> None:
        listed = re.search(r"SIGNATURE = \[(.*?)\]", (WEB / "chunks.js").read_text("utf-8"))
        assert listed is not None
        assert bytes(int(each, 16) for each in listed[1].split(",")) == chunk.SIGNATURE

    def test_refined_attributes(self) -> None:
        """The table of the player begins with the slots of what the package refines."""
        source = (WEB / "refinement.js").read_text("utf-8")
        found = re.findall(r"\{ slot: (\w+), components: (\d)", source)
        sizes = {own.name: own.components for own in attributes.ATTRIBUTES}
        wanted = [
            ("0" if name == "position" else name.upper(), str(sizes[name]))
            for name in refinement.REFINED
        ]
        assert found == wanted
