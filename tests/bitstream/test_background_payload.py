"""Backgrounds as bytes and back, and what GOPs show of them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.bitstream.background_payload import (
    background_table,
    pack_background,
    unpack_background,
)
from gsvrcodec.bitstream.gop_payload import unpack_gop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.errors import CorruptError, LimitError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import STATIC_ATTRIBUTES
from gsvrcodec.model.background import (
    append_background,
    append_gaussians,
    select_gaussians,
    static_gop,
)
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.quantise import dequantised
from gsvrcodec.planes import PACKS
from gsvrcodec.render import render_frames
from tests.gops import BITS, HEADER, make_background, make_file, make_gop, make_payload

STATIC = [attribute.name for attribute in STATIC_ATTRIBUTES]


@given(
    gaussians=st.integers(1, 70),
    number=st.integers(1, 2**32 - 1),
    pack=st.sampled_from(sorted(PACKS)),
    seed=st.integers(0, 9),
)
def test_round_trip(gaussians: int, number: int, pack: str, seed: int) -> None:
    gop = make_gop(gaussians, (0, 0, 0), seed)
    background = unpack_background(pack_background(number, gop, BITS, PACKS[pack]), Limits())
    assert background.number == number
    expected = dequantised(gop, BITS)
    order = strip_order(gop.position)
    for name in STATIC:
        np.testing.assert_array_equal(getattr(background.gop, name), getattr(expected, name)[order])
    assert (background.gop.indicator == 1).all()
    assert not background.gop.linear.any()
    assert not background.gop.quadratic.any()


def test_every_cut_fails() -> None:
    payload = make_background(1, 20)
    for size in range(len(payload)):
        with pytest.raises(CorruptError):
            unpack_background(payload[:size], Limits())
    with pytest.raises(CorruptError, match="planes end at byte"):
        unpack_background(payload + b"\0", Limits())


def test_over_a_limit() -> None:
    with pytest.raises(LimitError, match="Gaussians in a background"):
        unpack_background(make_background(1, 20), Limits(gaussians=19))


def test_table_names_what_is_stored() -> None:
    entries = background_table(make_background(1, 20), Limits())
    assert [entry.attribute.name for entry in entries] == [
        attribute.name for attribute in STATIC_ATTRIBUTES for _ in range(attribute.components)
    ]


def test_a_frame_is_the_sum_of_both() -> None:
    size = 64, 48
    own, static = make_gop(9), make_gop(12, seed=3)
    for gop in (own, static):
        gop.colour[:] = np.abs(gop.colour) * 0.1  # never over white
    static = static_gop(*(getattr(static, name) for name in STATIC))
    shown = np.arange(12) % 3 != 1
    taus = np.array([-0.4, 0.7], np.float32)
    parts = [
        own,
        select_gaussians(static, shown),
        append_gaussians(own, select_gaussians(static, shown)),
    ]
    assert [len(part) for part in parts] == [9, 8, 17]
    front, behind, both = (
        render_frames(part, taus, size, size, bit_depth=16).astype(float) for part in parts
    )
    assert behind.max() > 2000
    np.testing.assert_array_equal(behind[0], behind[1])
    assert np.abs(both - front - behind).max() <= 2


def test_files_keep_backgrounds() -> None:
    shown = np.arange(30) % 4 == 0
    data = make_file(
        [make_payload(5), make_payload(5, first_frame=3, start_pts=120, background=2, shown=shown)],
        backgrounds={1: make_background(2, 30)},
    )
    with GsvrReader(io.BytesIO(data)) as reader:
        assert reader.gaussians == 5 + 5 + 30
        assert reader.header.max_gaussians == 35
        assert [(background.number, background.gaussians) for background in reader.backgrounds] == [
            (2, 30)
        ]
        first, second = (unpack_gop(reader.read_gop(n), reader.header, Limits()) for n in range(2))
        assert first.background == 0
        assert first.shown is None
        assert second.background == 2
        assert second.shown is not None
        np.testing.assert_array_equal(second.shown, shown)
        background = unpack_background(
            reader.read_chunk(reader.find_background(2, 1).chunk), Limits()
        )
        assert len(append_background(second.gop, background, second.shown)) == 5 + 8
        with pytest.raises(CorruptError, match="expects 29"):
            append_background(second.gop, background, second.shown[1:])
        with pytest.raises(CorruptError, match="background 3 is lost"):
            reader.find_background(3, 1)
        with pytest.raises(CorruptError, match="background 2 is lost"):
            reader.find_background(2, 0)  # it stands behind that GOP


class TestWriter:
    def test_backgrounds_ascend(self) -> None:
        writer = GsvrWriter(io.BytesIO(), HEADER)
        writer.add_background(make_background(2, 3))
        with pytest.raises(ValueError, match="background 2 after background 2"):
            writer.add_background(make_background(2, 3))

    @pytest.mark.parametrize(("number", "gaussians"), [(1, 3), (2, 4)])
    def test_a_gop_needs_its_background(self, number: int, gaussians: int) -> None:
        writer = GsvrWriter(io.BytesIO(), HEADER)
        writer.add_background(make_background(2, 3))
        with pytest.raises(ValueError, match="was not added"):
            writer.add_gop(make_payload(5, background=number, shown=np.ones(gaussians, np.bool_)))
