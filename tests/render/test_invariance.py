"""A frame is the same bits however it is asked for."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render import render_frames
from gsvrcodec.render.native import NativeBackend
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


@each_blending
@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("size", [(310, 200), (77, 131)])
def test_parts_that_stand_still(
    size: tuple[int, int], threads: int, blending: Blending, isa: str
) -> None:
    """Frames together, which share the parts where nothing moves, and each alone, in any form.

    A few Gaussians of all levels run about in the upper left, and stop; one leaves the frame.
    """
    gop = examples.static(examples.random_gop(2500), slice(None))
    r = np.random.default_rng(5)
    some = np.arange(0, 2500, 80)
    gop.position[some] = r.uniform(-1, -0.4, (len(some), 2))
    gop.log_scale[some] = np.log(r.uniform(0.5, 9, (len(some), 1)))
    gop.linear[some] = r.uniform(-0.3, 0.3, (len(some), 2))
    gop.linear[some[0]] = (-3, 0)
    backend = NativeBackend(threads, blending)
    prepared = backend.prepare(gop)
    planes = np.empty((len(TAUS), 3, *size[::-1]), np.uint8).transpose(0, 2, 3, 1)
    together = [backend.render(prepared, TAUS, size, size)]
    together.append(backend.render(prepared, TAUS, size, size, out=planes))
    for number in range(len(TAUS)):
        alone = backend.render(prepared, TAUS[number : number + 1], size, size)[0]
        for pictures in together:
            np.testing.assert_array_equal(pictures[number], alone)
    example = replace(EXAMPLES, gop=gop, size=size, coded_size=size, blending=blending)
    batch = examples.native_float(example, TAUS, threads)
    for tau, frame in zip(TAUS, batch, strict=True):
        picture = backend.picture(prepared, float(tau), size, size)
        np.testing.assert_array_equal(frame, picture)
    assert (together[0][0] != together[0][3])[: size[1] // 3, : size[0] // 3].any()
    assert not (together[0][0] != together[0][3])[-5:, -5:].any()


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
