"""Cutting into chains of GOPs: lengths that keep what was asked."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal

from hypothesis import example, given
from hypothesis import strategies as st

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.film import Chain, slice_gops
from gsvrcodec.encoder.gop_lengths import GopLimits

STATS = st.lists(
    st.builds(
        FrameStats, st.floats(0, 60) | st.just(0.0), st.integers(0, 30).map(lambda n: n == 0)
    ),
    min_size=1,
    max_size=150,
)


def shots(stats: list[FrameStats]) -> list[int]:
    """Return the length of each shot."""
    starts = [n for n, frame in enumerate(stats) if frame.cut or n == 0]
    return [stop - start for start, stop in pairwise([*starts, len(stats)])]


def by_shot(chains: list[Chain], stats: list[FrameStats]) -> Iterator[list[int]]:
    """Yield the lengths of each shot's GOPs, which cover it exactly."""
    rest = iter([gop for chain in chains for gop in chain])
    start = 0
    for length in shots(stats):
        lengths: list[int] = []
        while sum(lengths) < length:
            gop = next(rest)
            assert gop.start == start + sum(lengths)
            assert gop.step == 1
            assert len(gop) > 0
            lengths.append(len(gop))
        assert sum(lengths) == length, "a GOP spans a cut"
        yield lengths
        start += length
    assert not list(rest)


class TestSliceGops:
    @given(stats=STATS, gop=st.integers(1, 40))
    def test_fixed_length(self, stats: list[FrameStats], gop: int) -> None:
        for lengths in by_shot(slice_gops(stats, gop, GopLimits(1, 1)), stats):
            assert set(lengths[:-1]) <= {gop}
            assert lengths[-1] <= gop

    # Motion at the start must not leave the end with fewer than the minimum.
    @example(stats=[FrameStats(60.0 * (n < 4), False) for n in range(11)], minimum=3, extra=1)
    @given(stats=STATS, minimum=st.integers(1, 20), extra=st.integers(0, 30))
    def test_adaptive_length(self, stats: list[FrameStats], minimum: int, extra: int) -> None:
        maximum = minimum + extra
        gops = slice_gops(stats, "adaptive", GopLimits(minimum, maximum))
        for lengths, frames in zip(by_shot(gops, stats), shots(stats), strict=True):
            assert max(lengths) <= maximum
            fewest = -(-frames // maximum)
            if fewest * minimum <= frames:
                assert min(lengths) >= minimum

    def test_no_frames(self) -> None:
        assert slice_gops([], "adaptive", GopLimits(12, 32)) == []
        assert slice_gops([], 5, GopLimits(1, 1), 9) == []


class TestChains:
    @given(stats=STATS, gop=st.integers(1, 40) | st.just("adaptive"))
    def test_without_prediction_every_gop_is_one(
        self, stats: list[FrameStats], gop: int | Literal["adaptive"]
    ) -> None:
        chains = slice_gops(stats, gop, GopLimits(4, 20))
        assert {len(chain) for chain in chains} == {1}

    @given(
        stats=STATS,
        gop=st.integers(1, 40) | st.just("adaptive"),
        minimum=st.integers(1, 9),
        longest=st.integers(1, 60),
    )
    def test_they_are_within_their_shot_and_bound(
        self,
        stats: list[FrameStats],
        gop: int | Literal["adaptive"],
        minimum: int,
        longest: int,
    ) -> None:
        limits = GopLimits(minimum, 16)
        chains = slice_gops(stats, gop, limits, longest)
        assert [frame for chain in chains for gop in chain for frame in gop] == [*range(len(stats))]
        starts = [chain[0].start for chain in chains]
        for chain in chains:
            frames = range(chain[0].start, chain[-1].stop)
            assert len(frames) <= longest
            assert not any(stats[frame].cut for frame in frames[1:])
            assert all(gop for gop in chain)
        # A shot has no more chains than it needs, all of about the same length.
        begin = 0
        for length in shots(stats):
            own = [start for start in starts if begin <= start < begin + length]
            assert len(own) == -(-length // longest)
            lengths = [stop - start for start, stop in pairwise([*own, begin + length])]
            assert max(lengths) - min(lengths) <= 1
            begin += length

    def test_a_film_of_two_shots(self) -> None:
        stats = [FrameStats(0.0, number in (0, 10)) for number in range(25)]
        limits = GopLimits(1, 1)
        chains = slice_gops(stats, 4, limits, 10)
        assert chains == [
            [range(4), range(4, 8), range(8, 10)],
            [range(10, 14), range(14, 18)],
            [range(18, 22), range(22, 25)],
        ]

    def test_gops_of_a_chain_may_take_fewer_bits(self) -> None:
        stats = [
            FrameStats(1.0, not number, 20.0, 400.0, left=(30.0, 60.0, 90.0)[: number // 8])
            for number in range(48)
        ]
        chains = [
            slice_gops(stats, "adaptive", GopLimits(4, 99), chained, new=lambda span: 0.1)
            for chained in (48, None)
        ]
        assert [len(chain) for chain in chains[0]] == [10]
        assert len(chains[1]) < 6

    def test_key_gops_take_the_place_of_chains_that_do_not_pay(self) -> None:
        stats = [FrameStats(0.0, number in (0, 40)) for number in range(80)]
        seen: list[tuple[Chain, Chain]] = []

        def pays(chain: Chain, apart: Chain) -> bool:
            seen.append((chain, apart))
            return chain[0].start in (0, 60)

        bounds = GopLimits(10, 10)
        chains = slice_gops(stats, "adaptive", bounds, 20, pays)
        assert [chain[0].start for chain, _ in seen] == [0, 20, 40, 60]
        assert all(chain == apart and len(apart) == 2 for chain, apart in seen)
        assert chains == [
            [range(10), range(10, 20)],
            [range(20, 30)],
            [range(30, 40)],
            [range(40, 50)],
            [range(50, 60)],
            [range(60, 70), range(70, 80)],
        ]
        # Key GOPs that follow each other are cut as one span.
        bounds = GopLimits(12, 14)
        apart = slice_gops(stats, "adaptive", bounds, 20, lambda chain, apart: False)
        assert sorted(len(gop) for chain in apart for gop in chain) == [12, 12, 14, 14, 14, 14]
        # They keep the longest time between key GOPs, and lengths that are asked for are kept.
        bounds = GopLimits(1, 16)
        short = slice_gops(stats, "adaptive", bounds, 9, lambda chain, apart: False)
        assert max(len(gop) for chain in short for gop in chain) <= 9
        fixed = slice_gops(stats, 10, bounds, 20, lambda chain, apart: False)
        assert [len(chain) for chain in fixed] == [2] * 4

    @given(gop=st.integers(1, 9) | st.just("adaptive"), last=st.lists(st.booleans(), min_size=60))
    def test_a_gop_begins_one_where_too_little_lasts(
        self, gop: int | Literal["adaptive"], last: list[bool]
    ) -> None:
        stats, limits = [FrameStats(1.0, not number) for number in range(60)], GopLimits(4, 8)
        whole = slice_gops(stats, gop, limits, 30)
        found = slice_gops(stats, gop, limits, 30, lasts=lambda gop: last[gop.start])
        assert [gop for chain in found for gop in chain] == [
            gop for chain in whole for gop in chain
        ]
        heads = {chain[0] for chain in found}
        assert heads >= {chain[0] for chain in whole}
        for chain in whole:
            assert all((own in heads) != last[own.start] for own in chain[1:])
