"""What every backend offers, against the reference: without a GPU Triton's is interpreted."""

from __future__ import annotations

import os

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

if not torch.cuda.is_available():
    os.environ["TRITON_INTERPRET"] = "1"  # before Triton is loaded

from gsvrcodec.model.gop import Gop
from gsvrcodec.render.backend import Backend
from gsvrcodec.render.native import NativeBackend
from gsvrcodec.render.reference import ReferenceBackend
from tests.render import examples
from tests.render.examples import SMALL, TAU, Example, Gradients

REFERENCE = ReferenceBackend()
each_example = pytest.mark.parametrize("example", SMALL.values(), ids=SMALL)


def _triton() -> Backend:
    from gsvrcodec.render.triton import TritonBackend

    return TritonBackend("cuda:0" if torch.cuda.is_available() else "cpu")


@pytest.fixture(params=["native", "triton"], scope="module")
def backend(request: pytest.FixtureRequest) -> Backend:
    if request.param == "native":
        return NativeBackend(2)
    return _triton()


def arrays(gop: Gop) -> Gradients:
    return {name: getattr(gop, name) for name in Gop.__slots__}


def tensors(gop: Gop, backend: Backend) -> dict[str, torch.Tensor]:
    """Parameters as a fit holds them: Gaussians in their own order."""
    return {name: torch.from_numpy(a.copy()).to(backend.device) for name, a in arrays(gop).items()}


def noise(example: Example, seed: int = 1) -> NDArray[np.float32]:
    width, height = example.size
    return np.random.default_rng(seed).normal(size=(height, width, 3)).astype(np.float32)


@each_example
def test_picture(backend: Backend, example: Example) -> None:
    expected, actual = (
        each.picture(each.prepare(example.gop), TAU, example.size, example.coded_size)
        for each in (REFERENCE, backend)
    )
    assert actual.dtype == np.float32
    assert actual.shape == expected.shape == (*example.size[::-1], 3)
    assert np.abs(actual - expected).max() <= 1e-4 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("bit_depth", [8, 16])
def test_render(backend: Backend, bit_depth: int) -> None:
    example, taus = SMALL["smaller"], np.array([-1, 0.25, 0.9], np.float32)
    expected, actual = (
        each.render(
            each.prepare(example.gop), taus, example.size, example.coded_size, bit_depth=bit_depth
        )
        for each in (REFERENCE, backend)
    )
    assert actual.dtype == expected.dtype == (np.uint8 if bit_depth == 8 else np.uint16)
    assert actual.shape == expected.shape == (3, *example.size[::-1], 3)
    difference = np.abs(actual.astype(int) - expected)
    assert difference.max() <= max(1, 1e-4 * 2**bit_depth)
    if bit_depth == 8:
        assert (difference > 0).mean() <= 1e-3


def test_render_fills_what_it_gets(backend: Backend) -> None:
    example, taus = SMALL["1x1"], np.array([0.5, -0.5], np.float32)
    prepared = backend.prepare(example.gop)
    expected = backend.render(prepared, taus, example.size, example.coded_size)
    out = np.full_like(expected, 77)
    assert backend.render(prepared, taus, example.size, example.coded_size, out=out) is out
    np.testing.assert_array_equal(out, expected)


@each_example
def test_gradient(backend: Backend, example: Example) -> None:
    weights = noise(example)
    expected, actual = (
        each.gradient(example.gop, TAU, weights, example.coded_size)
        for each in (REFERENCE, backend)
    )
    examples.assert_gradients_close(arrays(actual), arrays(expected))


@pytest.mark.parametrize("behind", [False, True], ids=["black", "backdrop"])
@pytest.mark.parametrize("name", ["smaller", "none"])
def test_squared_error(backend: Backend, name: str, behind: bool) -> None:
    example = SMALL[name]
    width, height = example.size
    target = np.random.default_rng(2).integers(0, 256, (height, width, 3), np.uint8)
    backdrop = 0.3 * noise(example, 3) if behind else None
    losses, gradients = [], []
    for each in (REFERENCE, backend):
        error, found = each.squared_error(
            tensors(example.gop, each),
            TAU,
            each.upload(target),
            example.coded_size,
            None if backdrop is None else each.upload(backdrop),
        )
        losses.append(float(error))
        named = zip(Gop.__slots__, found, strict=True)
        gradients.append({name: gradient.numpy(force=True) for name, gradient in named})
    assert losses[1] == pytest.approx(losses[0], rel=1e-4)
    examples.assert_gradients_close(gradients[1], gradients[0])


@pytest.mark.parametrize("shape", [(0, 2), (1,), (700, 3), (5, 4, 8)], ids=str)
def test_adam_step(backend: Backend, shape: tuple[int, ...]) -> None:
    r = np.random.default_rng(0)
    components = shape[-1] if len(shape) > 1 else 1
    rates = torch.from_numpy(r.uniform(0.001, 0.1, components).astype(np.float32))
    start = torch.from_numpy(r.normal(size=shape).astype(np.float32))
    gradients = [torch.from_numpy(r.normal(size=shape).astype(np.float32)) for _ in range(3)]
    states = []
    for each, dtype in ((REFERENCE, torch.float64), (backend, torch.float32)):
        value = start.to(each.device, dtype, copy=True)
        state = value, torch.zeros_like(value), torch.zeros_like(value)
        for step, gradient in enumerate(gradients, 1):
            each.adam_step(
                value,
                gradient.to(value),
                *state[1:],
                rates.to(value),
                0.5,
                (0.9, 0.98),
                1e-15,
                step,
            )
        states.append([part.numpy(force=True) for part in state])
    for expected, actual in zip(*states, strict=True):
        np.testing.assert_allclose(actual, expected, rtol=1e-5, atol=1e-6)
