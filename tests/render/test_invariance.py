"""A frame is the same bits however it is asked for."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from gsvrcodec.render import render_frames
from tests.render import scenes
from tests.render.scenes import Scene

TAUS = np.linspace(-1, 1, 7, dtype=np.float32)
SCENE = Scene(scenes.random_gop(2500), (150, 200), (150, 200))


def _weights() -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.random.default_rng(1).normal(size=(200, 150, 3)).astype(np.float32)


@pytest.mark.parametrize("threads", [2, 3, 16])
def test_threads(threads: int, isa: str) -> None:
    one = scenes.native_float(SCENE, TAUS, threads=1)
    np.testing.assert_array_equal(scenes.native_float(SCENE, TAUS, threads), one)
    weights = _weights()
    gradients = scenes.native_gradients(SCENE, weights, threads=threads)
    for name, wanted in scenes.native_gradients(SCENE, weights, threads=1).items():
        np.testing.assert_array_equal(gradients[name], wanted)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_batch(threads: int, isa: str) -> None:
    batch = render_frames(SCENE.gop, TAUS, SCENE.size, SCENE.size, threads=threads)
    for tau, frame in zip(TAUS, batch, strict=True):
        alone = render_frames(SCENE.gop, np.array([tau]), SCENE.size, SCENE.size, threads=threads)
        np.testing.assert_array_equal(alone[0], frame)


def test_python_threads() -> None:
    expected = render_frames(SCENE.gop, TAUS, SCENE.size, SCENE.size, threads=1)
    weights = _weights()
    gradient = scenes.native_gradients(SCENE, weights)["position"]

    def work(index: int) -> bool:
        if index % 3 == 0:
            actual = scenes.native_gradients(SCENE, weights, threads=2)["position"]
            return np.array_equal(actual, gradient)
        frames = render_frames(SCENE.gop, TAUS, SCENE.size, SCENE.size, threads=index % 4)
        return np.array_equal(frames, expected)

    with ThreadPoolExecutor(6) as pool:
        assert all(pool.map(work, range(24)))


def test_out_is_filled_and_returned() -> None:
    out = np.full((len(TAUS), 200, 150, 3), 77, np.uint8)
    assert render_frames(SCENE.gop, TAUS, SCENE.size, SCENE.size, out=out) is out
    expected = render_frames(SCENE.gop, TAUS, SCENE.size, SCENE.size)
    np.testing.assert_array_equal(out, expected)


def test_scratch_of_another_size_leaves_no_trace(isa: str) -> None:
    """A smaller frame after a larger one, in the memory that the larger one left."""
    small = scenes.SCENES["1x1"]
    before = scenes.native_float(small, TAUS)
    scenes.native_float(SCENE, TAUS)
    scenes.native_gradients(SCENE, _weights())
    np.testing.assert_array_equal(scenes.native_float(small, TAUS), before)
