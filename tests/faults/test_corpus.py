"""Inputs that reach much code of the parsers, as `tests.fuzz_guided` found them."""

from __future__ import annotations

from contextlib import suppress

import pytest

from gsvrcodec.errors import GsvrError
from tests import fuzz, fuzz_targets, memory
from tests.fuzz_guided import kept_inputs

#: Most memory that an input may take, bytes: what a plane of the limit takes, several times.
MOST = 2**27


@pytest.mark.parametrize("target", fuzz_targets.TARGETS)
def test_every_input_is_refused_or_taken_in_little_time_and_memory(target: str) -> None:
    run = fuzz_targets.TARGETS[target]
    inputs = list(kept_inputs(target))
    assert len(inputs) > 3
    with memory.at_most(MOST):
        for data in inputs:
            with fuzz.patience(), suppress(GsvrError):
                run(data)


@pytest.mark.parametrize("target", fuzz_targets.TARGETS)
def test_sound_inputs_are_taken(target: str) -> None:
    """Those that have not lost what stands around them."""
    taken = 0
    for data in fuzz_targets.seeds(target):
        with suppress(GsvrError):
            fuzz_targets.TARGETS[target](data)
            taken += 1
    assert taken
