"""Codec 4 against the words of the spec."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.native import _entropy
from gsvrcodec.planes import Codec, PlaneStack, PriorPlanes, context, decode_plane
from gsvrcodec.planes.samples import PlaneShape, Samples
from tests.planes.range_coder import Coder, Corrupt, unzigzag

NOTHING = (0,) * 6


def reference(
    data: bytes, shape: PlaneShape, prior: NDArray[np.uint16], guided_grid: bool
) -> Samples:
    """A plane as the spec's pseudo-code decodes it."""
    coder = Coder(data)
    flags = coder.u8()
    terms = []
    for _ in range(flags & 15):
        plane = coder.u8()
        terms.append((plane, unzigzag(coder.varint())))
    guided = bool(flags & 16)
    assert guided_grid or not guided
    bias = unzigzag(coder.varint())
    weights = [(coder.u8() ^ 128) - 128 for _ in range(6)] if flags & 32 else [0] * 6
    division = coder.u8()
    direct, top = division & 15, division >> 4
    if top > 2 or not top < direct <= 7:
        raise Corrupt
    thresholds: list[int] = []
    for _ in range(coder.u8()):
        thresholds.append(coder.varint() + (thresholds[-1] if thresholds else 0))
    coder.begin()

    def frequencies() -> list[int]:
        level = [0] * 256
        for t in range(coder.bits(8) + 1):
            high = 0
            while coder.bits(1):
                high += 1
            level[t] = (level[t - 2] if t >= 2 else 0) + unzigzag(2 * high + coder.bits(1))
            if not 0 <= level[t] <= 49:
                raise Corrupt
        used = sum(n > 0 for n in level)
        if used == 0:
            raise Corrupt
        weight = [(4 + (n - 2) % 4) << ((n - 2) // 4) if n >= 2 else 0 for n in level]
        total = max(sum(weight), 1)
        f = [1 + weight[t] * (4096 - used) // total if level[t] else 0 for t in range(256)]
        f[level.index(max(level))] += 4096 - sum(f)
        return f

    def number(f: list[int]) -> int:
        t = 0
        while sum(f[: t + 1]) <= coder.slot(12):
            t += 1
        coder.advance(12, sum(f[:t]), f[t])
        if t < 2**direct:
            return t
        octave, part = divmod(t - 2**direct, 2 ** (top + 1))
        n = octave + direct - top - 1
        if n > 16:
            raise Corrupt
        high: int = 2**top + part // 2
        found: int = (high << n | coder.bits(n)) << 1 | part & 1
        return found

    f = [frequencies() for _ in range(len(thresholds) + 1)]
    w, h, b = shape.width, shape.height, shape.bits
    sample = np.zeros((h, w), np.uint16)
    d: dict[tuple[int, int] | None, int] = {None: 0}
    e: dict[tuple[int, int] | None, int] = {None: 0}
    before = prior.astype(int).tolist()
    for y in range(h):
        m = 0
        for x in range(w):
            if guided and y > 0:
                while m + 1 < w and before[0][y - 1][m + 1] <= before[0][y][x]:
                    m += 1
            else:
                m = x
            left = (y, x - 1) if x > 0 else (y - 1, 0) if y > 0 else None
            left2 = (y, x - 2) if x > 1 else left
            above: list[tuple[int, int] | None] = [left] * 4
            if y > 0:
                above = [(y - 1, min(max(m + i, 0), w - 1)) for i in (0, 1, -1, 2)]
            near = [left, left2, *above]
            c = bias + sum(weight * before[k][y][x] for k, weight in terms)
            near_sum = sum(v * d[i] for v, i in zip(weights, near, strict=True))
            p = min(max((c + (near_sum >> 6) + 128) >> 8, 0), 2**b - 1)
            around = sum(r * abs(e[i]) for r, i in zip((2, 1, 2, 2, 1, 1), near, strict=True))
            error = unzigzag(number(f[sum(around >= threshold for threshold in thresholds)]))
            if not 0 <= p + error < 2**b:
                raise Corrupt
            sample[y, x] = p + error
            e[y, x] = error
            d[y, x] = 256 * (p + error) - c
    coder.finish()
    return sample


def decoded(data: bytes, shape: PlaneShape, prior: PriorPlanes) -> Samples:
    size = shape.width, shape.height, shape.bits
    return decode_plane(Codec.CONTEXT, data, *size, Limits(), prior)


def stack(planes: NDArray[np.uint16], *, guided: bool) -> PriorPlanes:
    """All of `planes`, shape (count, height, width), as the planes before one."""
    collected = PlaneStack(*planes.shape, guided=guided)
    for plane in planes:
        collected.append(plane)
    return collected.prior


@st.composite
def cases(draw: st.DrawFn) -> tuple[Samples, int, PriorPlanes, NDArray[np.uint16], bool]:
    """A plane, its bits, and planes before it."""
    bits = draw(st.integers(1, 16))
    height, width = draw(st.integers(1, 7)), draw(st.integers(1, 7))
    cell = st.integers(0, 2**bits - 1)
    samples = draw(arrays(np.uint16, (height, width), elements=cell))
    count = draw(st.integers(0, 3))
    planes = draw(arrays(np.uint16, (count, height, width), elements=st.integers(0, 65535)))
    guided = draw(st.booleans())
    return samples, bits, stack(planes, guided=guided), planes, guided


def strips(seed: int = 0, side: int = 24) -> tuple[PriorPlanes, Samples, PlaneShape]:
    """Positions in strips, and a third plane that is smooth in the picture."""
    draw = np.random.default_rng(seed)
    x = np.sort(draw.integers(0, 8192, (side, side)), axis=1).astype(np.uint16)
    y = draw.integers(0, 8192 // side, (side, side)) + 8192 // side * np.arange(side)[:, None]
    smooth = 512 + 300 * np.sin(x / 2000) * np.cos(y / 1500) + draw.normal(0, 4, x.shape)
    planes = np.stack([x, y]).astype(np.uint16)
    return stack(planes, guided=True), smooth.astype(np.uint16), PlaneShape(side, side, 10)


class TestAgainstTheSpec:
    @settings(max_examples=60, deadline=None)
    @given(case=cases())
    def test_what_the_encoder_writes(
        self, case: tuple[Samples, int, PriorPlanes, NDArray[np.uint16], bool]
    ) -> None:
        samples, bits, prior, planes, guided = case
        shape = PlaneShape(samples.shape[1], samples.shape[0], bits)
        data = context.encode(samples, shape, prior)
        np.testing.assert_array_equal(decoded(data, shape, prior), samples)
        np.testing.assert_array_equal(reference(data, shape, planes, guided), samples)

    @settings(max_examples=60, deadline=None)
    @given(case=cases(), data=st.data())
    def test_any_weights_and_contexts(
        self,
        case: tuple[Samples, int, PriorPlanes, NDArray[np.uint16], bool],
        data: st.DataObject,
    ) -> None:
        samples, bits, prior, planes, guided = case
        shape = PlaneShape(samples.shape[1], samples.shape[0], bits)
        weight = st.integers(-1365, 1365).filter(bool)
        terms = [(k, data.draw(weight)) for k in range(len(planes)) if data.draw(st.booleans())]
        bias = data.draw(st.integers(-(2**29) + 1, 2**29 - 1))
        weights = data.draw(st.tuples(*[st.integers(-128, 127)] * 6))
        follows = prior.columns is not None and data.draw(st.booleans())
        predictor = _entropy.Predictor(terms, bias, follows, weights)
        top = data.draw(st.integers(0, 2))
        direct = data.draw(st.integers(top + 1, 7))
        thresholds = data.draw(st.sets(st.integers(1, 2**20), max_size=7))
        coding = _entropy.Coding(direct, top, sorted(thresholds))
        stream = _entropy.encode_context(
            samples, bits, prior.planes, prior.columns, predictor, coding
        )
        np.testing.assert_array_equal(decoded(stream, shape, prior), samples)
        np.testing.assert_array_equal(reference(stream, shape, planes, guided), samples)

    @settings(max_examples=150, deadline=None)
    @given(at=st.integers(0), value=st.integers(0, 255))
    def test_both_take_or_refuse_a_changed_stream(self, at: int, value: int) -> None:
        stream = bytearray(_STREAM)
        stream[at % len(stream)] = value
        try:
            expected: Samples | None = reference(bytes(stream), _SHAPE, _PRIOR.planes, True)
        except (Corrupt, AssertionError, IndexError):
            expected = None
        try:
            found: Samples | None = decoded(bytes(stream), _SHAPE, _PRIOR)
        except CorruptError:
            found = None
        # The reference trusts heads, so it may take more; what both take must be one plane.
        if found is not None:
            assert expected is not None
            np.testing.assert_array_equal(found, expected)


class TestGolden:
    def test_bytes_of_a_small_plane(self) -> None:
        samples = np.array([[3, 4, 4], [3, 5, 9]], np.uint16)
        prior = PriorPlanes(np.array([[[1, 2, 3], [2, 2, 4]]], np.uint16))
        predictor = _entropy.Predictor([(0, 256)], -100, False, (32, 0, 16, 0, 0, 0))
        coding = _entropy.Coding(3, 1, [4])
        data = _entropy.encode_context(samples, 4, prior.planes, None, predictor, coding)
        assert data.hex(" ", 4) == (
            "21008004 c7012000 10000000 1301045d a8150300 1dfeffff ffffdf80 ffffffff ffff0004"
        )
        np.testing.assert_array_equal(decoded(data, PlaneShape(3, 2, 4), prior), samples)


class TestDecode:
    @pytest.mark.parametrize(
        ("head", "says"),
        [
            ("", "cut short in its head"),
            ("40", "unknown flags"),
            ("10", "no plane to be guided by"),
            ("01 00 02", "not before it"),
            ("00 82 80 80 80 80 00", "too long"),
            ("00 80 00", "too long"),
            ("00 80 80 80 80 10", "too long"),
            ("00 80 80 80 80 04", "bias is out of range"),
            ("00 00 00", "not divided"),
            ("00 00 22", "not divided"),
            ("00 00 34", "not divided"),
            ("00 00 08", "not divided"),
            ("00 00 24 08", "too many contexts"),
            ("00 00 24 01 00", "thresholds are out of range"),
            ("00 00 24 01 81 80 40", "thresholds are out of range"),
            ("00 00 24 02 01 80 80 40", "thresholds are out of range"),
            ("00 00 24 00 00 00", "cut short"),
            ("00 00 24 00 ff ff 00 00", "below its range"),
            ("00 00 24 00 00 00 01 00", "cut short"),
            ("00 00 24 00 00 00 01 00 00 00", "none of its tokens"),
            ("00 00 24 00 00 00 01 00" + 10 * " ff", "too long"),
            ("00 00 24 00 00 00 01 00 40 00", "out of range"),
        ],
    )
    def test_a_bad_head_fails(self, head: str, says: str) -> None:
        with pytest.raises(CorruptError, match=says):
            decoded(bytes.fromhex(head), PlaneShape(1, 1, 8), PriorPlanes.none(1, 1))

    @pytest.mark.parametrize(
        ("head", "says"),
        [
            ("01 02 02", "not before it"),
            ("02 00 02 00 02", "not before it"),
            ("01 00 00", "weights are out of range"),
            ("01 00 82 40", "weights are out of range"),
            ("01 00 81 40", "weights are out of range"),
            ("02 00 80 20 01 82 20", "weights are out of range"),
            ("01 00 ff ff ff ff 0f", "weights are out of range"),
            ("10", "no plane to be guided by"),
        ],
    )
    def test_a_bad_term_fails(self, head: str, says: str) -> None:
        prior = PriorPlanes(np.zeros((2, 1, 1), np.uint16))
        with pytest.raises(CorruptError, match=says):
            decoded(bytes.fromhex(head), PlaneShape(1, 1, 8), prior)

    def test_another_plane_before_it_is_noticed_or_harmless(self) -> None:
        other = stack(np.zeros((2, 24, 24), np.uint16), guided=True)
        try:
            found = decoded(_STREAM, _SHAPE, other)
        except CorruptError:
            return
        assert found.max() < 1 << _SHAPE.bits

    def test_a_plane_of_many_samples_in_few_bytes_stays_within_its_size(self) -> None:
        shape = PlaneShape(2000, 1000, 8)
        prior = PriorPlanes.none(1000, 2000)
        coding = _entropy.Coding(4, 2, [])
        zeros = np.zeros((1000, 2000), np.uint16)
        predictor = _entropy.Predictor([], 0, False, NOTHING)
        data = _entropy.encode_context(zeros, 8, prior.planes, None, predictor, coding)
        assert len(data) < 20
        np.testing.assert_array_equal(decoded(data, shape, prior), zeros)


class TestEncode:
    def test_uses_what_is_known(self) -> None:
        prior, smooth, shape = strips(side=64)
        guided = len(context.encode(smooth, shape, prior))
        alone = len(context.encode(smooth, shape, PriorPlanes.none(64, 64)))
        unguided = len(context.encode(smooth, shape, PriorPlanes(prior.planes)))
        assert guided < 0.97 * min(alone, unguided)

    def test_a_copy_of_a_prior_plane_costs_next_to_nothing(self) -> None:
        samples = np.random.default_rng(0).integers(0, 1024, (60, 60)).astype(np.uint16)
        prior = PriorPlanes(np.stack([samples // 3, samples]).astype(np.uint16))
        assert len(context.encode(samples, PlaneShape(60, 60, 10), prior)) < 100

    def test_a_memory_saves_the_search(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The same plane at another step is coded by the choices that were made for the first."""
        other, smooth, shape = strips(side=64)
        prior = stack(2 * other.planes, guided=True)
        memory = context.Memory()
        assert context.encode(smooth, shape, prior, memory) == context.encode(smooth, shape, prior)
        coarse = (smooth // 2 + 7).astype(np.uint16)
        best = context.encode(coarse, shape, other)

        def never(*_: object) -> NoReturn:
            raise AssertionError("nothing is to be searched")

        monkeypatch.setattr(context, "predictors", never)
        quick = context.encode(coarse, shape, other, memory)
        assert len(best) <= len(quick) < 1.03 * len(best)
        np.testing.assert_array_equal(decoded(quick, shape, other), coarse)
        with pytest.raises(AssertionError, match="searched"):
            context.encode(coarse, shape, other, context.Memory())

    @pytest.mark.parametrize("side", [1, 2, 30])
    def test_a_memory_of_another_plane_is_harmless(self, side: int) -> None:
        draw = np.random.default_rng(side)
        shape = PlaneShape(side, side, 16)
        memory = context.Memory()
        for low, high in ((0, 1), (0, 65536), (65535, 65536), (0, 65536), (300, 310)):
            planes = draw.integers(0, 65536, (2, side, side)).astype(np.uint16)
            planes[0] = np.sort(planes[0])
            prior = stack(planes, guided=True)
            samples = draw.integers(low, high, (side, side)).astype(np.uint16)
            data = context.encode(samples, shape, prior, memory)
            np.testing.assert_array_equal(decoded(data, shape, prior), samples)

    @pytest.mark.parametrize(
        ("predictor", "coding", "says"),
        [
            (((), 2**29, False, NOTHING), (4, 2, ()), "bias out of range"),
            (((), 0, True, NOTHING), (4, 2, ()), "no plane to be guided by"),
            (((), 0, False, (128, *NOTHING[1:])), (4, 2, ()), "weights of neighbours"),
            ((((1, 1),), 0, False, NOTHING), (4, 2, ()), "must be ascending prior planes"),
            ((((0, 1), (0, 1)), 0, False, NOTHING), (4, 2, ()), "must be ascending prior planes"),
            ((((0, 4097),), 0, False, NOTHING), (4, 2, ()), "weights out of range"),
            (((), 0, False, NOTHING), (2, 2, ()), "cannot be divided"),
            (((), 0, False, NOTHING), (8, 2, ()), "cannot be divided"),
            (((), 0, False, NOTHING), (4, 2, (0,)), "must be ascending"),
            (((), 0, False, NOTHING), (4, 2, (2, 2)), "must be ascending"),
            (((), 0, False, NOTHING), (4, 2, range(1, 9)), "too many contexts"),
        ],
    )
    def test_what_the_format_cannot_say_fails(
        self,
        predictor: tuple[tuple[tuple[int, int], ...], int, bool, tuple[int, ...]],
        coding: tuple[int, int, tuple[int, ...]],
        says: str,
    ) -> None:
        samples = np.zeros((1, 3, 4), np.uint16)
        with pytest.raises(ValueError, match=says):
            _entropy.encode_context(
                samples[0],
                8,
                samples,
                None,
                _entropy.Predictor(*predictor),
                _entropy.Coding(*coding),
            )

    @pytest.mark.parametrize("shape", [(1, 3, 5), (1, 4, 4), (300, 3, 4)])
    def test_planes_of_another_size_fail(self, shape: tuple[int, int, int]) -> None:
        with pytest.raises(ValueError, match="prior planes must"):
            _encode(PriorPlanes(np.zeros(shape, np.uint16)))

    def test_columns_out_of_range_fail(self) -> None:
        columns = np.full((3, 4), 4, np.uint16)
        with pytest.raises(ValueError, match="a column is out of range"):
            _encode(PriorPlanes(np.zeros((1, 3, 4), np.uint16), columns))


def _encode(prior: PriorPlanes) -> bytes:
    """Encode a plane of 4x3 zeros."""
    predictor, coding = _entropy.Predictor((), 0, False, NOTHING), _entropy.Coding(4, 2, ())
    samples = np.zeros((3, 4), np.uint16)
    return _entropy.encode_context(samples, 8, prior.planes, prior.columns, predictor, coding)


_PRIOR, _SMOOTH, _SHAPE = strips()
_STREAM = context.encode(_SMOOTH, _SHAPE, _PRIOR)
