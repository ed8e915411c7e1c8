"""GOPs to bytes and back."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import defaultdict
from dataclasses import fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gsvrcodec.bitstream.attribute_planes import Memories
from gsvrcodec.bitstream.gop_head import parse_gop_head
from gsvrcodec.bitstream.gop_payload import pack_gop, plane_table, unpack_gop
from gsvrcodec.bitstream.header import IMAGE_CODECS_FLAG, Header
from gsvrcodec.bitstream.refinement_bits import TABLE_BYTES
from gsvrcodec.errors import CorruptError, GsvrError, LimitError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES, CARRIED_ATTRIBUTES
from gsvrcodec.model.gop import Gop, grid_size
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.prediction import CHANGED, DROPPED, MOVED, carry_over
from gsvrcodec.model.quantise import Quantiser, dequantised, values_of
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.time import Ticks
from gsvrcodec.planes import PACKS, Memory
from tests.gops import (
    BITS,
    SIXTEEN_BITS,
    assert_gops_equal,
    make_carried,
    make_chain,
    make_gop,
    make_modes,
    make_payload,
)

HEADER = Header(
    width=64,
    height=48,
    time_base=Fraction(1, 1000),
    max_gaussians=100,
    max_gop_frames=50,
    max_grid=(9, 9, 9),
    flags_optional=IMAGE_CODECS_FLAG,
)
HEADERS = {blending: replace(HEADER, blending=blending) for blending in get_args(Blending)}
ROOT = Path(__file__).parents[2]
PTS = 40 * np.arange(3)
DURATIONS = np.full(3, 40)


def reordered(gop: Gop, order: NDArray[np.intp]) -> Gop:
    """The same GOP with its Gaussians in another order."""
    names = [field.name for field in fields(Gop) if field.name not in ("xy", "xt", "yt")]
    return replace(gop, **{name: getattr(gop, name)[order] for name in names})


class TestRoundTrip:
    @settings(max_examples=40)
    @given(
        gaussians=st.integers(0, 40),
        grid=st.one_of(
            st.just((0, 0, 0)),
            st.tuples(st.integers(1, 5), st.integers(1, 5), st.integers(1, 5)),
        ),
        pack=st.sampled_from(sorted(PACKS)),
        bits=st.fixed_dictionaries({name: st.integers(1, 16) for name in BITS}),
        blending=st.sampled_from(get_args(Blending)),
    )
    def test_a_decoder_gets_what_dequantised_says(
        self,
        gaussians: int,
        grid: tuple[int, int, int],
        pack: str,
        bits: dict[str, int],
        blending: Blending,
    ) -> None:
        gop = make_gop(gaussians, grid, 0, blending)
        payload = pack_gop(gop, PTS, DURATIONS, 5, bits, PACKS[pack], blending=blending)
        content = unpack_gop(payload, HEADERS[blending], Limits())
        assert_gops_equal(content.new, reordered(dequantised(gop, bits), strip_order(gop.position)))
        assert grid_size(content.new) == grid
        assert content.first_frame == 5
        np.testing.assert_array_equal(content.pts, PTS)
        np.testing.assert_array_equal(content.durations, DURATIONS)
        for field in fields(Gop):
            array = getattr(content.new, field.name)
            assert array.dtype == np.float32
            assert array.flags.c_contiguous

    def test_sixteen_bits_are_close_to_the_original(self) -> None:
        gop = make_gop(50, (4, 4, 4))
        near = dequantised(gop, SIXTEEN_BITS)
        for field in fields(Gop):
            original = getattr(gop, field.name)
            np.testing.assert_allclose(getattr(near, field.name), original, atol=2e-4)

    def test_rotation_is_stored_modulo_pi(self) -> None:
        gop = make_gop(3)
        gop.rotation[:] = [-0.5, 4.0, 100.0]
        near = dequantised(gop, SIXTEEN_BITS).rotation
        np.testing.assert_allclose(near, np.mod(gop.rotation, np.pi), atol=1e-4)

    def test_is_repeatable(self) -> None:
        call = "make_payload(30, (3, 2, 4), pack='auto')"
        code = f"from tests.gops import make_payload; print({call}.hex())"
        environment = {**os.environ, "PYTHONHASHSEED": "7", "GSVR_THREADS": "3"}
        other = subprocess.run(
            [sys.executable, "-c", code],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert other.stdout.strip() == make_payload(30, (3, 2, 4), pack="auto").hex()


class TestPredicted:
    @settings(max_examples=60)
    @given(
        modes=st.lists(st.integers(0, 4), max_size=40),
        new=st.integers(0, 20),
        grid=st.sampled_from([(0, 0, 0), (3, 2, 4)]),
        pack=st.sampled_from(sorted(PACKS)),
        bits=st.fixed_dictionaries({name: st.integers(1, 16) for name in BITS}),
        frames=st.integers(1, 4),
        blending=st.sampled_from(get_args(Blending)),
    )
    def test_a_decoder_gets_what_was_quantised(
        self,
        modes: list[int],
        new: int,
        grid: tuple[int, int, int],
        pack: str,
        bits: dict[str, int],
        frames: int,
        blending: Blending,
    ) -> None:
        carried = make_carried(np.array(modes, np.uint8), new, blending)
        gop = make_gop(new, grid, 0, blending)
        payload = pack_gop(
            gop,
            PTS,
            DURATIONS,
            9,
            bits,
            PACKS[pack],
            reference=frames,
            carried=carried,
            blending=blending,
        )
        content = unpack_gop(payload, HEADERS[blending], Limits())
        assert (content.reference, content.first_frame) == (frames, 9)
        assert_gops_equal(content.new, reordered(dequantised(gop, bits), strip_order(gop.position)))
        found = content.carried
        assert found is not None
        assert found.mode.tolist() == modes
        assert found.kept == sum(mode != DROPPED for mode in modes)
        for attribute in CARRIED_ATTRIBUTES[1:]:
            name = attribute.change_of or attribute.name
            values, original = getattr(found, name), getattr(carried, name)
            assert values.shape == original.shape
            assert values.dtype == np.float32
            for part in range(attribute.components):
                one = original if attribute.components == 1 else original[:, part]
                other = values if attribute.components == 1 else values[:, part]
                if len(one):
                    quantiser = Quantiser.fit(one, bits[name], (attribute.low, attribute.high))
                    codes = quantiser.quantise(one)[None]
                    expected = values_of(codes, [quantiser], replace(attribute, components=1))
                    np.testing.assert_array_equal(other, expected)
        reference = make_gop(len(modes), (2, 2, 2), 4, blending)
        lengths = frames, len(PTS)
        expected_gop = carry_over(reference, lengths, found, content.new, blending)
        assert_gops_equal(content.gop(reference, frames, blending), expected_gop)
        with pytest.raises(ValueError, match="frame 9 needs its reference"):
            content.gop(None, 0)
        with pytest.raises(CorruptError, match="the GOP expects"):
            content.gop(make_gop(len(modes) + 1), frames)

    def test_a_step_of_an_attribute_is_that_of_its_change(self) -> None:
        steps = {a.name: (0.25,) * a.components for a in ATTRIBUTES}
        carried = make_carried(np.full(9, CHANGED, np.uint8))
        payload = pack_gop(make_gop(0), PTS, DURATIONS, 9, steps, reference=9, carried=carried)
        content = unpack_gop(payload, HEADER, Limits())
        assert content.carried is not None
        for name in ("position", "log_scale", "rotation", "colour", "log_opacity"):
            values = getattr(content.carried, name)
            np.testing.assert_array_equal(values % 0.25, 0)
            np.testing.assert_allclose(values, getattr(carried, name), atol=0.125)
        head = parse_gop_head(payload)
        assert (head.gaussians, head.new, head.changed, head.moved) == (9, 0, 9, 0)

    def test_a_reference_without_carried_gaussians_fails(self) -> None:
        carried = make_carried(np.zeros(3, np.uint8))
        for reference, given_ in ((3, None), (0, carried)):
            with pytest.raises(ValueError, match="a predicted GOP has a reference"):
                pack_gop(make_gop(3), PTS, DURATIONS, 9, BITS, reference=reference, carried=given_)

    def test_modes_without_their_values_fail(self) -> None:
        carried = replace(make_carried(np.zeros(3, np.uint8)), mode=np.full(3, MOVED, np.uint8))
        with pytest.raises(ValueError, match="0 changed and 3 moved Gaussians with 0 changes and"):
            pack_gop(make_gop(3), PTS, DURATIONS, 9, BITS, reference=1, carried=carried)

    def test_every_cut_fails(self) -> None:
        payload = make_chain((3, 2), 8, 2)[1]
        for size in range(len(payload)):
            with pytest.raises(CorruptError):
                unpack_gop(payload[:size], HEADER, Limits())


class TestPack:
    def test_a_value_out_of_bounds_fails(self) -> None:
        gop = make_gop(3)
        gop.log_scale[1, 0] = 14
        with pytest.raises(ValueError, match=r"log_scale spans .* to 14, allowed is -32 to 13"):
            pack_gop(gop, PTS, DURATIONS, 0, BITS)

    def test_a_value_that_is_not_finite_fails(self) -> None:
        gop = make_gop(3)
        gop.colour[1, 0] = np.nan
        with pytest.raises(ValueError, match="not finite"):
            pack_gop(gop, PTS, DURATIONS, 0, BITS)

    @pytest.mark.parametrize("durations", [DURATIONS[:2], DURATIONS[:0]])
    def test_uneven_timing_fails(self, durations: Ticks) -> None:
        with pytest.raises(ValueError, match="timestamps and"):
            pack_gop(make_gop(3), PTS, durations, 0, BITS)


class TestPlaneTable:
    @pytest.mark.parametrize(("blending", "planes"), [("mean", 14 + 3 * 6), ("sum", 13 + 3 * 8)])
    def test_says_what_is_in_a_gop(self, blending: Blending, planes: int) -> None:
        payload = make_payload(50, (4, 3, 2), pack="auto", blending=blending)
        entries, offset, _ = plane_table(payload, HEADERS[blending], Limits())
        assert len(entries) == planes
        assert ("log_opacity" in {entry.name for entry in entries}) == (blending == "mean")
        assert [entry.name for entry in entries[:5]] == [
            "position.0",
            "position.1",
            "log_scale.0",
            "log_scale.1",
            "rotation",
        ]
        assert (entries[0].width, entries[0].height) == (8, 7)
        assert (entries[-1].width, entries[-1].height) == (3, 2)
        assert entries[0].quantiser.bits == 13
        assert offset + sum(entry.size for entry in entries) + TABLE_BYTES == len(payload)

    @pytest.mark.parametrize("blending", get_args(Blending))
    def test_is_not_that_of_the_other_blending(self, blending: Blending) -> None:
        """A header that says means over sums, or the other way round, fits no GOP."""
        (other,) = set(get_args(Blending)) - {blending}
        for payload in make_chain((3, 2), blending=blending):
            with pytest.raises(CorruptError, match="planes, expected"):
                plane_table(payload, HEADERS[other], Limits())

    def test_is_empty_without_gaussians(self) -> None:
        payload = make_payload(0)
        assert plane_table(payload, HEADER, Limits()) == ((), len(payload) - TABLE_BYTES, 0)


class TestUnpack:
    @pytest.mark.parametrize(
        ("field", "value"),
        [("max_gaussians", 19), ("max_gop_frames", 2), ("max_grid", (4, 4, 3))],
    )
    def test_over_a_maximum_of_the_header_fails(self, field: str, value: Any) -> None:
        header = replace(HEADER, **{field: value})
        with pytest.raises(CorruptError, match="the header's maximum is"):
            unpack_gop(make_payload(20, (4, 4, 4)), header, Limits())

    @pytest.mark.parametrize(
        "limits",
        [
            Limits(gaussians=19),
            Limits(gop_frames=2),
            Limits(plane_samples=19),
            Limits(expansion_base=1, expansion_ratio=1),
        ],
    )
    def test_over_a_limit_fails(self, limits: Limits) -> None:
        with pytest.raises(LimitError, match="over the limit"):
            unpack_gop(make_payload(20), HEADER, limits)

    def test_every_cut_fails(self) -> None:
        payload = make_payload(5)
        for size in range(len(payload)):
            with pytest.raises(CorruptError):
                unpack_gop(payload[:size], HEADER, Limits())

    @settings(max_examples=300)
    @given(at=st.integers(0, 400), size=st.integers(0, 4), data=st.binary(max_size=4))
    def test_changed_bytes_raise_our_errors_or_stay_finite(
        self, at: int, size: int, data: bytes
    ) -> None:
        payload = _PAYLOAD[:at] + data + _PAYLOAD[at + size :]
        try:
            gop = unpack_gop(payload, HEADER, Limits()).new
        except GsvrError:
            return
        for field in fields(Gop):
            assert np.isfinite(getattr(gop, field.name)).all()


_PAYLOAD = make_payload(9, (2, 2, 2))


def test_model_imports_numpy_and_image_codecs_alone() -> None:
    code = (
        "import sys, gsvrcodec.bitstream.gop_payload;"
        "print([m for m in ('torch', 'av', 'cv2') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


class TestMemories:
    """Payloads of one GOP at many steps, of which all but the first are packed quickly."""

    @pytest.mark.parametrize("pack", ["entropy", "auto"])
    def test_they_decode_and_are_nearly_as_small(self, pack: str) -> None:
        gop, carried = make_gop(400, (5, 4, 6)), make_carried(make_modes(500))
        memories: Memories = defaultdict(Memory)
        wide = replace(HEADER, max_gaussians=900)
        for step in (0.004, 0.006, 0.003, 0.012):
            steps = {a.name: (step,) * a.components for a in ATTRIBUTES}
            best, quick = (
                pack_gop(
                    gop,
                    PTS,
                    DURATIONS,
                    9,
                    steps,
                    PACKS[pack],
                    reference=9,
                    carried=carried,
                    memories=kept,
                )
                for kept in (None, memories)
            )
            assert abs(len(quick) / len(best) - 1) < 0.03
            one, other = (unpack_gop(payload, wide, Limits()) for payload in (best, quick))
            assert_gops_equal(one.new, other.new)
            assert one.carried is not None
            assert other.carried is not None
            np.testing.assert_array_equal(one.carried.colour, other.carried.colour)
        assert memories["position", 0].choice is not None
        assert ("mode", 0) in memories
