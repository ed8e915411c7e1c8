"""What every backend offers, against the reference: without a GPU Triton's is interpreted."""

from __future__ import annotations

import os
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

if not torch.cuda.is_available():
    os.environ["TRITON_INTERPRET"] = "1"  # before Triton is loaded

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.static import select_gaussians
from gsvrcodec.render.backend import AdamPart, AdamRule, Backend, Samples, Scalar, Tensor
from gsvrcodec.render.native import NativeBackend
from gsvrcodec.render.reference import ReferenceBackend
from tests.render import examples
from tests.render.examples import SMALL, TAU, Example, Gradients

each_example = pytest.mark.parametrize("example", SMALL.values(), ids=SMALL)
each_blending = pytest.mark.parametrize("blending", ["mean", "sum"])

#: A backend of each blending.
Backends = Callable[[Blending], Backend]


def _native(blending: Blending) -> Backend:
    return NativeBackend(2, blending)


def _triton(blending: Blending) -> Backend:
    from gsvrcodec.render.triton import TritonBackend

    return TritonBackend("cuda:0" if torch.cuda.is_available() else "cpu", blending)


@pytest.fixture(params=[_native, _triton], ids=["native", "triton"])
def backends(request: pytest.FixtureRequest) -> Backends:
    made: Backends = request.param
    return made


def arrays(gop: Gop) -> Gradients:
    return {name: getattr(gop, name) for name in Gop.__slots__}


def tensors(gop: Gop, backend: Backend) -> dict[str, Tensor]:
    """Parameters as a fit holds them: Gaussians in their own order."""
    return {name: backend.hold(array.copy()) for name, array in arrays(gop).items()}


def noise(example: Example, seed: int = 1) -> NDArray[np.float32]:
    width, height = example.size
    return np.random.default_rng(seed).normal(size=(height, width, 3)).astype(np.float32)


def two(backends: Backends, blending: Blending) -> tuple[Backend, Backend]:
    """The reference, and the backend that is compared with it."""
    return ReferenceBackend(blending), backends(blending)


def sums(backend: Backend, example: Example, gop: Gop | None = None) -> Float32Array:
    """Sums of the example, or of another GOP in its place."""
    prepared = backend.prepare(example.gop if gop is None else gop)
    return backend.sums(prepared, TAU, example.size, example.coded_size)


def a_target(example: Example) -> NDArray[np.uint8]:
    width, height = example.size
    return np.random.default_rng(2).integers(0, 256, (height, width, 3), np.uint8)


@each_example
def test_picture(backends: Backends, example: Example) -> None:
    expected, actual = (
        each.picture(each.prepare(example.gop), TAU, example.size, example.coded_size)
        for each in two(backends, example.blending)
    )
    assert actual.dtype == np.float32
    assert actual.shape == expected.shape == (*example.size[::-1], 3)
    assert np.abs(actual - expected).max() <= 1e-4 * max(1.0, np.abs(expected).max())


@each_example
def test_sums(backends: Backends, example: Example) -> None:
    reference, backend = two(backends, example.blending)
    expected, actual = sums(reference, example), sums(backend, example)
    assert actual.dtype == np.float32
    assert actual.shape == expected.shape == (*example.size[::-1], 4)
    channels = 4 if example.mean else 3  # the last has no meaning where pictures are sums
    actual, expected = actual[..., :channels], expected[..., :channels]
    assert np.abs(actual - expected).max() <= 1e-5 * np.abs(expected).max()
    picture = backend.picture(backend.prepare(example.gop), TAU, example.size, example.coded_size)
    np.testing.assert_allclose(picture, examples.frame_of(example, actual), rtol=1e-5, atol=1e-30)


@each_blending
@pytest.mark.parametrize("bit_depth", [8, 16])
def test_render(backends: Backends, blending: Blending, bit_depth: int) -> None:
    example, taus = SMALL["smaller"], np.array([-1, 0.25, 0.9], np.float32)
    expected, actual = (
        each.render(
            each.prepare(example.gop), taus, example.size, example.coded_size, bit_depth=bit_depth
        )
        for each in two(backends, blending)
    )
    assert actual.dtype == expected.dtype == (np.uint8 if bit_depth == 8 else np.uint16)
    assert actual.shape == expected.shape == (3, *example.size[::-1], 3)
    difference = np.abs(actual.astype(int) - expected)
    assert difference.max() <= max(1, 1e-4 * 2**bit_depth)
    if bit_depth == 8:
        assert (difference > 0).mean() <= 1e-3


def test_render_fills_what_it_gets(backends: Backends) -> None:
    backend = backends("mean")
    example, taus = SMALL["1x1"], np.array([0.5, -0.5], np.float32)
    prepared = backend.prepare(example.gop)
    expected = backend.render(prepared, taus, example.size, example.coded_size)
    out = np.full_like(expected, 77)
    assert backend.render(prepared, taus, example.size, example.coded_size, out=out) is out
    np.testing.assert_array_equal(out, expected)


@each_example
def test_gradient(backends: Backends, example: Example) -> None:
    weights = noise(example)
    expected, actual = (
        each.gradient(example.gop, TAU, weights, example.coded_size)
        for each in two(backends, example.blending)
    )
    examples.assert_gradients_close(arrays(actual), arrays(expected))


@pytest.mark.parametrize("name", ["smaller", "sum, smaller", "hidden", "faint", "none"])
def test_gradient_over_a_backdrop(backends: Backends, name: str) -> None:
    example = SMALL[name]
    weights, backdrop = noise(example), example.backdrop()
    expected, actual = (
        each.gradient(example.gop, TAU, weights, example.coded_size, each.upload(backdrop))
        for each in two(backends, example.blending)
    )
    examples.assert_gradients_close(arrays(actual), arrays(expected))


@each_blending
@pytest.mark.parametrize("behind", [False, True], ids=["ground", "backdrop"])
@pytest.mark.parametrize("name", ["smaller", "none"])
def test_squared_error(backends: Backends, blending: Blending, name: str, behind: bool) -> None:
    example = SMALL[name]
    target = a_target(example)
    backdrop = example.backdrop() if behind else None
    losses, gradients = [], []
    for each in two(backends, blending):
        error, found = each.squared_error(
            tensors(example.gop, each),
            TAU,
            each.upload(target),
            example.coded_size,
            None if backdrop is None else each.upload(backdrop),
        )
        losses.append(float(error))
        named = zip(Gop.__slots__, found, strict=True)
        gradients.append({name: each.fetch(gradient) for name, gradient in named})
    assert losses[1] == pytest.approx(losses[0], rel=1e-4)
    examples.assert_gradients_close(gradients[1], gradients[0])


@each_blending
def test_what_stands_still_as_a_backdrop(backends: Backends, blending: Blending) -> None:
    """All Gaussians in one picture, or those that move over the sums of the others."""
    gop = examples.static(examples.random_gop(20), slice(8))
    example = Example(gop, (17, 13), (17, 13), blending)
    still, moving = (select_gaussians(gop, (np.arange(20) < 8) == chosen) for chosen in (1, 0))
    backend, target = backends(blending), a_target(example)
    whole = sums(backend, example)
    backdrop = sums(backend, example, still)
    parts = backdrop + sums(backend, example, moving)
    np.testing.assert_allclose(parts, whole, rtol=1e-5, atol=1e-5 * np.abs(whole).max())
    found = []
    for drawn, behind in ((gop, None), (moving, backend.upload(backdrop))):
        error, gradients = backend.squared_error(
            tensors(drawn, backend), TAU, backend.upload(target), example.coded_size, behind
        )
        found.append((float(error), [backend.fetch(gradient) for gradient in gradients]))
    assert found[1][0] == pytest.approx(found[0][0], rel=1e-5)
    for name, expected, actual in zip(Gop.__slots__, found[0][1], found[1][1], strict=True):
        if name in ("xy", "xt", "yt"):
            np.testing.assert_allclose(actual, expected, atol=1e-3 * np.abs(expected).max())
        else:
            np.testing.assert_allclose(
                actual, expected[8:], atol=1e-3 * np.abs(expected[8:]).max(), err_msg=name
            )


def test_opacities_at_their_bounds(backends: Backends) -> None:
    """They have gradients; those beyond look the same, and have none."""
    backend, example = backends("mean"), SMALL["at bounds"]
    beyond = deepcopy(example)
    beyond.gop.log_opacity[:4] *= 1.5  # of the static ones, which the tri-plane has no part in
    weights = noise(example)
    pictures, gradients = [], []
    for one in (example, beyond):
        prepared = backend.prepare(one.gop)
        pictures.append(backend.picture(prepared, TAU, one.size, one.coded_size))
        gradients.append(backend.gradient(one.gop, TAU, weights, one.coded_size).log_opacity[:4])
    np.testing.assert_array_equal(pictures[0], pictures[1])
    assert gradients[0].all()
    assert not gradients[1].any()


def test_what_hides_all(backends: Backends) -> None:
    backend, example = backends("mean"), SMALL["hidden"]
    picture = backend.picture(backend.prepare(example.gop), TAU, example.size, example.coded_size)
    middle = picture[7:13, 13:20]
    np.testing.assert_allclose(middle, np.broadcast_to(example.gop.colour[0], middle.shape), 1e-3)


def test_no_weight_is_black(backends: Backends) -> None:
    """Beyond a Gaussian's edge nothing is drawn, and nothing has a gradient."""
    gop = examples.random_gop(1, grid=(0, 0, 0))
    gop.position[:] = gop.linear[:] = gop.quadratic[:] = gop.log_scale[:] = 0
    backend, size = backends("mean"), (16, 16)
    prepared = backend.prepare(gop)
    four = backend.sums(prepared, TAU, size, size)
    nothing = four[..., 3] == 0
    assert nothing[0].all()
    assert not nothing[6:10, 6:10].any()
    assert (four >= 0)[..., 3].all()
    assert not backend.picture(prepared, TAU, size, size)[nothing].any()
    for where, found in ((nothing, False), (~nothing, True)):
        weights = np.repeat(where[..., None], 3, -1).astype(np.float32)
        gradient = arrays(backend.gradient(gop, TAU, weights, size))
        assert bool(gradient["colour"].any()) == bool(gradient["log_opacity"].any()) == found


RULES = AdamRule((0.9, 0.98)), AdamRule((0.9, 0.98), agreeing=1.3, opposing=0.25)


@pytest.mark.parametrize("rule", RULES, ids=["plain", "cautious"])
@pytest.mark.parametrize("along_axes", [False, True])
@pytest.mark.parametrize("paced", [False, True])
def test_adam_step(backends: Backends, paced: bool, along_axes: bool, rule: AdamRule) -> None:
    """Attributes of one and of several components, a grid, an empty one; many in one step."""
    backend, reference = backends("mean"), ReferenceBackend()
    r = np.random.default_rng(0)

    def normal(*shape: int) -> Float32Array:
        return r.standard_normal(shape, np.float32)

    shapes: list[tuple[int, ...]] = [(0, 2), (1,), (30_001, 3), (5, 4, 8), (20_001, 2)]
    starts = [normal(*shape) for shape in shapes]
    rates = [abs(normal(shape[-1] if len(shape) > 1 else 1)) / 10 for shape in shapes]
    paces = [abs(normal(*shape)) if paced else None for shape in shapes]
    axes = [normal(len(t), 2, 2) if along_axes and t.shape[1:] == (2,) else None for t in starts]
    gradients = [[normal(*shape) for shape in shapes] for _ in range(3)]
    states = []
    for each, dtype in ((reference, np.float64), (backend, np.float32)):

        def held(array: NDArray[Any], each: Backend = each, dtype: type = dtype) -> Tensor:
            return each.hold(array.astype(dtype))

        parts = []
        for start, rate, pace, own in zip(starts, rates, paces, axes, strict=True):
            part = AdamPart(held(start), held(0 * start), held(0 * start), held(rate))
            part.pace = None if pace is None else held(pace)
            part.axes = None if own is None else held(own)
            parts.append(part)
        for step, slopes in enumerate(gradients, 1):
            each.adam_step(parts, [held(slope) for slope in slopes], rule, 0.5, step)
        moments = [(part.value, part.mean, part.square) for part in parts]
        states.append([each.fetch(tensor) for part in moments for tensor in part])
    for expected, actual in zip(*states, strict=True):
        np.testing.assert_allclose(actual, expected, rtol=1e-4, atol=3e-6)


@each_blending
def test_recorded_steps_are_the_same(backends: Backends, blending: Blending) -> None:
    """Descents of one frame or another, at rates that change; a GPU repeats what it records."""
    backend = backends(blending)
    example = SMALL["all levels"]
    runs, steps = [False, True, True], 6
    if not torch.cuda.is_available():  # nothing is recorded, and the interpreter takes seconds
        example = Example(examples.random_gop(9, grid=(0, 0, 0)), (13, 9), (13, 9))
        runs, steps = runs[:2], 4
    size = example.size
    r = np.random.default_rng(0)
    frames = r.integers(0, 256, (3, size[1], size[0], 3), np.uint8)
    rates, found = backend.hold(np.full(2, 0.01, np.float32)), []
    for recorded in runs:
        values = tensors(example.gop, backend)
        place = values["position"]
        nothing = backend.xp.zeros_like
        part = AdamPart(place, nothing(place), nothing(place), rates)

        def step(
            tau: Scalar,
            target: Samples,
            factor: Scalar,
            number: Scalar,
            values: dict[str, Tensor] = values,
            part: AdamPart = part,
        ) -> None:
            _, gradients = backend.squared_error(values, tau, target, size)
            gradient = gradients[list(values).index("position")]
            backend.adam_step([part], [gradient], AdamRule((0.9, 0.9)), factor, number)

        taken = backend.recorded(step) if recorded else step
        for number in range(1, steps + 1):
            index = number % 3
            taken(index - 1.0, backend.upload(frames[index]), 1 / number, number)
        found.append(backend.fetch(place))
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-6)
    assert np.abs(found[0] - example.gop.position).max() > 1e-3
