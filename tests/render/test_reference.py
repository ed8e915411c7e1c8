"""The reference itself: a value worked out by hand, and its gradients by differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from gsvrcodec.model.gop import Gop
from gsvrcodec.model.reconstruction import GROUND, MOST_LOG_OPACITY, Blending
from gsvrcodec.render import reference, render_frames
from tests.render import examples

SIZE = (12, 9)


def tensors(gop: Gop) -> dict[str, torch.Tensor]:
    return {name: torch.tensor(getattr(gop, name), dtype=torch.float64) for name in Gop.__slots__}


@pytest.mark.parametrize("blending", ["mean", "sum"])
def test_one_gaussian_by_hand(blending: Blending) -> None:
    gop = examples.random_gop(1, grid=(0, 0, 0))
    gop.position[:] = 0.25, -0.5  # x = 1.25/2*12 = 7.5, y = 0.5/2*9 = 2.25
    gop.log_scale[:] = math.log(0.8), math.log(3.0)
    gop.rotation[:] = math.pi / 2  # the first axis lies along y
    gop.linear[:] = gop.quadratic[:] = 0
    gop.colour[:] = 0.5, 1.0, -1.0
    gop.log_opacity[:] = -3.5
    frame = reference.render(tensors(gop), 0.0, SIZE, blending=blending)
    share = math.exp(-(2.0**2 / (9 + 0.1) + 1.25**2 / (0.64 + 0.1)) / 2) - 1 / 64
    if blending == "mean":
        weight = math.exp(-3.5) * share
        share = weight / (GROUND + weight)
    np.testing.assert_allclose(frame[3, 9], [0.5 * share, share, -share], rtol=1e-6)
    codes = render_frames(
        gop, np.zeros(1, np.float32), SIZE, SIZE, backend="reference", blending=blending
    )
    assert codes[0, 3, 9].tolist() == [
        math.floor(255 * 0.5 * share + 0.5),
        math.floor(255 * share + 0.5),
        0,
    ]


def test_two_gaussians_by_hand() -> None:
    """At their common centre, where both have the weight 1 - 1/64 of their opacities."""
    gop = examples.random_gop(2, grid=(1, 1, 1))
    gop.position[:] = 1 / 12, 0  # the centre of a pixel: x = 6.5, y = 4.5
    gop.log_scale[:] = 0  # on level 0, where the amplitude is 1
    gop.linear[:] = gop.quadratic[:] = 0
    gop.colour[:] = [[0.5, 1.0, -1.0], [0.25, 0.0, 3.0]]
    gop.log_opacity[:] = 0, 1
    gop.indicator[:] = 0, 0.5
    gop.xy[:], gop.xt[:], gop.yt[:] = 0, 1, 1
    gop.xy[..., 5] = 0.5
    frame = reference.render(tensors(gop), 0.0, SIZE)
    first, second = ((1 - 1 / 64) * math.exp(log_opacity) for log_opacity in (0.5, 1.25))
    expected = (first * gop.colour[0] + second * gop.colour[1]) / (first + second + GROUND)
    np.testing.assert_allclose(frame[4, 6], expected, rtol=1e-6)


@pytest.mark.parametrize("bound", [-1, 1])
def test_opacity_has_bounds(bound: int) -> None:
    """Beyond them it changes nothing, and has no gradient; at them it has one."""
    gop = examples.random_gop(1, grid=(0, 0, 0))
    gop.position[:] = gop.linear[:] = gop.quadratic[:] = 0
    frames, gradients = [], []
    for beyond in (0.0, 1.0):
        gop.log_opacity[:] = bound * (MOST_LOG_OPACITY + beyond)
        parameters = tensors(gop)
        parameters["log_opacity"].requires_grad_()
        frame = reference.render(parameters, 0.0, SIZE)
        (gradient,) = torch.autograd.grad(frame.abs().sum(), parameters["log_opacity"])
        frames.append(frame.detach().numpy())
        gradients.append(float(gradient[0]))
    np.testing.assert_array_equal(frames[0], frames[1])
    assert gradients[0] > 0
    assert gradients[1] == 0


@pytest.mark.parametrize("blending", ["mean", "sum"])
def test_a_level_by_hand(blending: Blending) -> None:
    gop = examples.random_gop(1, grid=(0, 0, 0))
    gop.position[:] = 0.25, -0.5  # x = 7.5, y = 2.25 px: 3.75, 1.125 on level 1
    gop.log_scale[:] = math.log(2.0), math.log(3.0)
    gop.rotation[:] = gop.linear[:] = gop.quadratic[:] = 0
    gop.colour[:] = 1.0
    gop.log_opacity[:] = 0
    sums = reference.render_sums(tensors(gop), 0.0, SIZE, SIZE, blending)
    # Variances in pixels of the frame: bilinear magnification adds 3/16 of four of them.
    v0, v1 = 4 - 0.75, 9 - 0.75
    amplitude = math.sqrt((4 + 0.1) * (9 + 0.1) / (v0 * v1))

    def weight(x: int, y: int) -> float:
        dx, dy = 2 * (x + 0.5 - 3.75), 2 * (y + 0.5 - 1.125)
        return math.exp(-(dx * dx / v0 + dy * dy / v1) / 2) - 1 / 64

    # Column 6 of the frame lies in column 3 of the level, nearer to 2; row 3 in row 1, nearer to 2.
    rows = [0.75 * weight(x, 1) + 0.25 * weight(x, 2) for x in (2, 3)]
    expected = amplitude * (0.25 * rows[0] + 0.75 * rows[1])
    np.testing.assert_allclose(sums[3, 6], [expected] * 4, rtol=1e-6)
    # So a Gaussian looks as it would without levels.
    plain = math.exp(-(1.0**2 / 4.1 + 1.25**2 / 9.1) / 2)
    assert expected == pytest.approx(plain, abs=0.05)


def test_cut_off_is_continuous() -> None:
    gop = examples.random_gop(1, grid=(0, 0, 0))
    gop.position[:] = 0
    gop.log_scale[:] = math.log(1.4)
    gop.linear[:] = gop.quadratic[:] = 0
    gop.colour[:] = 1
    row = reference.render(tensors(gop), 0.0, (41, 41), blending="sum")[20, :, 0]
    reach = math.sqrt(2 * math.log(64) * (1.4**2 + 0.1))
    for column, value in enumerate(row.tolist()):
        assert (value > 0) == (abs(column - 20) < reach)
    assert row[row > 0].min() < 0.02


@pytest.mark.parametrize("blending", ["mean", "sum"])
@pytest.mark.parametrize("name", Gop.__slots__)
def test_gradient_by_differences(name: str, blending: Blending) -> None:
    gop = examples.random_gop(6, grid=(3, 2, 2), seed=3)
    gop.position[:] *= 0.8
    parameters = tensors(gop)
    weights = torch.from_numpy(np.random.default_rng(4).normal(size=(9, 12, 3)))
    direction = torch.from_numpy(np.random.default_rng(6).normal(size=parameters[name].shape))

    def value(step: float) -> float:
        moved = parameters | {name: parameters[name] + step * direction}
        return float((reference.render(moved, 0.3, SIZE, blending=blending) * weights).sum())

    leaves = {n: value.clone().requires_grad_() for n, value in parameters.items()}
    frame = reference.render(leaves, 0.3, SIZE, blending=blending)
    (gradient,) = torch.autograd.grad(
        (frame * weights).sum(), leaves[name], allow_unused=True, materialize_grads=True
    )
    step = 1e-6
    difference = (value(step) - value(-step)) / (2 * step)
    assert float((gradient * direction).sum()) == pytest.approx(difference, rel=1e-3, abs=1e-6)
    assert bool(gradient.any()) == ((name, blending) != ("log_opacity", "sum"))


def test_unknown_backend_fails() -> None:
    with pytest.raises(ValueError, match="'native' or 'reference'"):
        render_frames(
            examples.random_gop(1),
            np.zeros(1, np.float32),
            SIZE,
            SIZE,
            backend="cuda",  # type: ignore[arg-type]
        )
