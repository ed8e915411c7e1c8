"""The native kernels against the reference, in value and gradient, for every instruction set."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch

from gsvrcodec.model.gop import Gop, parameters_of
from gsvrcodec.model.reconstruction import GROUND, Blending
from gsvrcodec.native import _core
from gsvrcodec.render import render_frames
from gsvrcodec.render.backend import TILE
from gsvrcodec.render.reference import ReferenceBackend
from tests.render import examples
from tests.render.examples import EXAMPLES, TAU, Example


def assert_agreement(example: Example, tau: float = TAU) -> None:
    """Value and gradients, over a backdrop, are those of the reference."""
    width, height = example.size
    weights = np.random.default_rng(1).normal(size=(height, width, 3)).astype(np.float32)
    backdrop = example.backdrop()
    expected, gradients = examples.reference_render(example, weights, tau, backdrop)
    actual = examples.frame_of(example, examples.native_sums(example, tau) + backdrop)
    assert np.abs(actual - expected).max() <= 1e-4 * max(1.0, np.abs(expected).max())
    found = examples.native_gradients(example, weights, tau, backdrop=backdrop)
    examples.assert_gradients_close(found, gradients)


@pytest.mark.parametrize("name", EXAMPLES)
def test_value_and_gradients(name: str, isa: str) -> None:
    assert_agreement(EXAMPLES[name])


@pytest.mark.parametrize("name", EXAMPLES)
def test_frame_is_made_of_sums(name: str, isa: str) -> None:
    example = EXAMPLES[name]
    expected = examples.frame_of(example, examples.native_sums(example).astype(float))
    actual = examples.native_float(example, np.array([TAU], np.float32))[0]
    np.testing.assert_allclose(actual, expected, rtol=1e-6, atol=1e-30)


@pytest.mark.parametrize("name", ["mixed", "sum, mixed"])
@pytest.mark.parametrize("tau", [-1.0, -0.999, 0.0, 1 / 3, 1.0])
def test_times(tau: float, name: str, isa: str) -> None:
    assert_agreement(EXAMPLES[name], float(np.float32(tau)))


@pytest.mark.parametrize("blending", ["mean", "sum"])
@pytest.mark.parametrize("name", ["mixed", "larger", "1x1", "none", "thin", "wide"])
def test_codes(name: str, blending: Blending, isa: str) -> None:
    example = deepcopy(EXAMPLES[name])
    if name in ("thin", "wide"):
        examples.covered(example.gop)  # as a picture is; see `Example.backdrop`
    taus = np.array([-0.7, 0.4], np.float32)
    example.gop.colour[:] = np.abs(example.gop.colour) * 0.5
    frames = example.gop, taus, example.size, example.coded_size
    expected = render_frames(*frames, blending=blending, backend="reference")
    actual = render_frames(*frames, blending=blending)
    difference = np.abs(actual.astype(int) - expected)
    assert difference.max() <= 1
    assert (difference > 0).mean() <= 1e-3


@pytest.mark.parametrize("backdrop", [False, True])
@pytest.mark.parametrize("blending", ["mean", "sum"])
@pytest.mark.parametrize("name", ["mixed", "smaller", "larger", "1x1", "low", "no tri-plane"])
def test_squared_error(name: str, blending: Blending, isa: str, backdrop: bool) -> None:
    example = replace(EXAMPLES[name], blending=blending)
    width, height = example.size
    rng = np.random.default_rng(2)
    target = rng.integers(0, 256, (height, width, 3), np.uint8)
    behind = rng.uniform(0, 0.5, (height, width, 4)).astype(np.float32) if backdrop else None
    frame, _ = examples.reference_render(example, backdrop=behind)
    residual = frame.clip(0, 1) - target / 255.0
    # The gradient passes through the clamp: a sample out of range is drawn back.
    _, gradients = examples.reference_render(
        example, (2 / residual.size * residual).astype(np.float32), backdrop=behind
    )
    gradient = examples.empty_gradient(example.gop)
    loss = _core.squared_error(
        parameters_of(example.gop),
        TAU,
        target,
        *example.coded_size,
        example.mean,
        parameters_of(gradient),
        2,
        None if behind is None else _core.Backdrop(behind),
    )
    assert loss == pytest.approx(float((residual**2).mean()), rel=1e-4)
    examples.assert_gradients_close({n: getattr(gradient, n) for n in gradients}, gradients)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("size", [(600, 150), (530, 131), (256, 64), (20, 70)])
def test_weighted_tiles(size: tuple[int, int], seed: int, isa: str) -> None:
    """Of a tile with the weight 0 nothing is drawn, and its neighbours are as ever."""
    gop = examples.all_levels(40, 2.2)
    rng = np.random.default_rng(seed)
    target = rng.integers(0, 256, (size[1], size[0], 3), np.uint8)
    shape = -(-size[1] // TILE[1]), -(-size[0] // TILE[0])
    weights = (rng.integers(0, 2, shape) * rng.uniform(0.5, 3, shape)).astype(np.float32)
    backend = ReferenceBackend("mean")
    values = {name: torch.from_numpy(getattr(gop, name)) for name in Gop.__slots__}
    error, found = backend.squared_error(values, TAU, target, size, None, weights)
    gradient = examples.empty_gradient(gop)
    how = size[0], size[1], True, parameters_of(gradient), 2, None, weights
    loss = _core.squared_error(parameters_of(gop), TAU, target, *how)
    assert loss == pytest.approx(float(error), rel=1e-4)
    expected = {n: g.numpy() for n, g in zip(Gop.__slots__, found, strict=True)}
    examples.assert_gradients_close({n: getattr(gradient, n) for n in expected}, expected)


def test_weights_of_other_tiles_fail() -> None:
    gop, target = examples.random_gop(3), np.zeros((65, 257, 3), np.uint8)
    for shape in ((1, 2), (2, 1), (2, 3)):
        how = 257, 65, True, parameters_of(examples.empty_gradient(gop)), 1, None
        with pytest.raises(ValueError, match="each tile"):
            _core.squared_error(parameters_of(gop), 0.0, target, *how, np.ones(shape, np.float32))


def test_pixel_errors() -> None:
    rng = np.random.default_rng(0)
    sums = rng.uniform(-0.2, 1.2, (37, 21, 4)).astype(np.float32)
    sums[..., 3] = rng.uniform(0, 1, (37, 21))
    target = rng.integers(0, 256, (37, 21, 3), np.uint8)
    codes = 255 * sums[..., :3].astype(float) / (sums[..., 3:] + GROUND)
    expected = np.square(codes.clip(0, 255) - target).sum(2)
    out = np.empty((37, 21), np.float32)
    _core.pixel_errors(sums, target, out)
    np.testing.assert_allclose(out, expected, rtol=1e-4, atol=1e-2)
    with pytest.raises(ValueError, match="one size"):
        _core.pixel_errors(sums, target[1:], out)


def test_long_recurrence(isa: str) -> None:
    """Many rows of one flat Gaussian: the recurrence's rounding stays small."""
    gop = examples.random_gop(3, grid=(0, 0, 0))
    gop.position[:] = 0
    gop.log_scale[:] = np.log(2000.0)
    gop.colour[:] = 0.3
    gop.log_opacity[:] = 0
    example = Example(gop, (9, 1500), (9, 1500))
    expected = examples.reference_sums(example)
    assert np.abs(examples.native_sums(example) - expected).max() <= 1e-4
