"""Hostile files by the hundred; `python -m tests.fuzz` tries as many as one likes."""

from __future__ import annotations

import random

from tests import fuzz


class TestHostileFiles:
    def test_flips_and_cuts(self) -> None:
        ends = fuzz.run(300, fuzz.flipped, seed=1)
        assert ends.total() == 300
        assert ends["decoded in part"] > 30
        assert ends["CorruptError"] > 10

    def test_forged_checksums(self) -> None:
        ends = fuzz.run(150, fuzz.forged, seed=1)
        assert ends.total() == 150
        assert ends["decoded"] > 15
        assert ends["CorruptError"] > 15

    def test_repaired_checksums_are_right(self) -> None:
        draw = random.Random(0)
        for data in fuzz.seeds():
            assert fuzz.repaired(data) == data
            damaged = bytearray(data)
            damaged[-60] ^= 1  # in the index
            assert fuzz.repaired(bytes(damaged)) != bytes(damaged)
            fuzz.outcome(fuzz.repaired(fuzz.flipped(data, draw)), None)
