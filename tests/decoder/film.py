"""The film that decoding is tried with."""

from __future__ import annotations

#: A film of 20 frames in 7 GOPs, more than the decoder keeps, starting late and of varying rate.
GOPS = (5, 1, 4, 3, 2, 4, 1)
STEPS = [3040, 3040, 2920, 9000, 20920] * 4
TIMES = [(1000 + sum(STEPS[:n]), STEPS[n]) for n in range(20)]
