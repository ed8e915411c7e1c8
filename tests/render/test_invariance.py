"""A frame is the same bits however it is asked for."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render import render_frames
from tests.render import examples
from tests.render.examples import Example

TAUS = np.linspace(-1, 1, 7, dtype=np.float32)
each_blending = pytest.mark.parametrize("blending", ["mean", "sum"])
EXAMPLES = Example(examples.random_gop(2500), (310, 90), (310, 90))


def _weights() -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.random.default_rng(1).normal(size=(90, 310, 3)).astype(np.float32)


@each_blending
@pytest.mark.parametrize("threads", [2, 3, 16])
def test_threads(threads: int, blending: Blending, isa: str) -> None:
    example = replace(EXAMPLES, blending=blending)
    one = examples.native_float(example, TAUS, threads=1)
    np.testing.assert_array_equal(examples.native_float(example, TAUS, threads), one)
    weights = _weights()
    gradients = examples.native_gradients(example, weights, threads=threads)
    for name, wanted in examples.native_gradients(example, weights, threads=1).items():
        np.testing.assert_array_equal(gradients[name], wanted)


@each_blending
@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("share", [0, 0.1, 0.5, 0.98, 1])
def test_batch(share: float, threads: int, blending: Blending, isa: str) -> None:
    """Frames together, whose static Gaussians are drawn once, and each alone."""
    gop = examples.static(examples.random_gop(2500), slice(round(2500 * share)))
    example = replace(EXAMPLES, gop=gop, blending=blending)
    batch = examples.native_float(example, TAUS, threads)
    for tau, frame in zip(TAUS, batch, strict=True):
        alone = examples.native_float(example, np.array([tau]), threads)
        np.testing.assert_array_equal(alone[0], frame)


def test_python_threads() -> None:
    expected = render_frames(EXAMPLES.gop, TAUS, EXAMPLES.size, EXAMPLES.size, threads=1)
    weights = _weights()
    gradient = examples.native_gradients(EXAMPLES, weights)["position"]

    def work(index: int) -> bool:
        if index % 3 == 0:
            actual = examples.native_gradients(EXAMPLES, weights, threads=2)["position"]
            return np.array_equal(actual, gradient)
        frames = render_frames(EXAMPLES.gop, TAUS, EXAMPLES.size, EXAMPLES.size, threads=index % 4)
        return np.array_equal(frames, expected)

    with ThreadPoolExecutor(6) as pool:
        assert all(pool.map(work, range(24)))


def test_out_is_filled_and_returned() -> None:
    out = np.full((len(TAUS), 90, 310, 3), 77, np.uint8)
    assert render_frames(EXAMPLES.gop, TAUS, EXAMPLES.size, EXAMPLES.size, out=out) is out
    expected = render_frames(EXAMPLES.gop, TAUS, EXAMPLES.size, EXAMPLES.size)
    np.testing.assert_array_equal(out, expected)


def test_scratch_of_another_size_leaves_no_trace(isa: str) -> None:
    """A smaller frame after a larger one, in the memory that the larger one left."""
    small = examples.EXAMPLES["1x1"]
    before = examples.native_float(small, TAUS)
    examples.native_float(EXAMPLES, TAUS)
    examples.native_gradients(EXAMPLES, _weights())
    np.testing.assert_array_equal(examples.native_float(small, TAUS), before)
