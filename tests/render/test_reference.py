"""The reference itself: a value worked out by hand, and its gradients by differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from gsvrcodec.model.gop import Gop
from gsvrcodec.render import reference, render_frames
from tests.render import examples

SIZE = (12, 9)


def test_one_gaussian_by_hand() -> None:
    gop = examples.random_gop(1, grid=(0, 0, 0))
    gop.position[:] = 0.25, -0.5  # x = 1.25/2*12 = 7.5, y = 0.5/2*9 = 2.25
    gop.log_scale[:] = math.log(0.8), math.log(3.0)
    gop.rotation[:] = math.pi / 2  # the first axis lies along y
    gop.linear[:] = gop.quadratic[:] = 0
    gop.colour[:] = 0.5, 1.0, -1.0
    parameters = {n: torch.tensor(getattr(gop, n), dtype=torch.float64) for n in Gop.__slots__}
    frame = reference.render(parameters, 0.0, SIZE)
    weight = math.exp(-(2.0**2 / (9 + 0.1) + 1.25**2 / (0.64 + 0.1)) / 2) - 1 / 64
    np.testing.assert_allclose(frame[3, 9], [0.5 * weight, weight, -weight], rtol=1e-6)
    codes = render_frames(gop, np.zeros(1, np.float32), SIZE, SIZE, backend="reference")
    assert codes[0, 3, 9].tolist() == [
        math.floor(255 * 0.5 * weight + 0.5),
        math.floor(255 * weight + 0.5),
        0,
    ]


def test_a_level_by_hand() -> None:
    gop = examples.random_gop(1, grid=(0, 0, 0))
    gop.position[:] = 0.25, -0.5  # x = 7.5, y = 2.25 px: 3.75, 1.125 on level 1
    gop.log_scale[:] = math.log(2.0), math.log(3.0)
    gop.rotation[:] = gop.linear[:] = gop.quadratic[:] = 0
    gop.colour[:] = 1.0
    parameters = {n: torch.tensor(getattr(gop, n), dtype=torch.float64) for n in Gop.__slots__}
    frame = reference.render(parameters, 0.0, SIZE)
    # Variances in pixels of the frame: bilinear magnification adds 3/16 of four of them.
    v0, v1 = 4 - 0.75, 9 - 0.75
    amplitude = math.sqrt((4 + 0.1) * (9 + 0.1) / (v0 * v1))

    def weight(x: int, y: int) -> float:
        dx, dy = 2 * (x + 0.5 - 3.75), 2 * (y + 0.5 - 1.125)
        return math.exp(-(dx * dx / v0 + dy * dy / v1) / 2) - 1 / 64

    # Column 6 of the frame lies in column 3 of the level, nearer to 2; row 3 in row 1, nearer to 2.
    rows = [0.75 * weight(x, 1) + 0.25 * weight(x, 2) for x in (2, 3)]
    expected = amplitude * (0.25 * rows[0] + 0.75 * rows[1])
    np.testing.assert_allclose(frame[3, 6], [expected] * 3, rtol=1e-6)
    # So a Gaussian looks as it would without levels.
    plain = math.exp(-(1.0**2 / 4.1 + 1.25**2 / 9.1) / 2)
    assert expected == pytest.approx(plain, abs=0.05)


def test_cut_off_is_continuous() -> None:
    gop = examples.random_gop(1, grid=(0, 0, 0))
    gop.position[:] = 0
    gop.log_scale[:] = math.log(1.4)
    gop.linear[:] = gop.quadratic[:] = 0
    gop.colour[:] = 1
    parameters = {n: torch.tensor(getattr(gop, n), dtype=torch.float64) for n in Gop.__slots__}
    row = reference.render(parameters, 0.0, (41, 41))[20, :, 0]
    reach = math.sqrt(2 * math.log(255) * (1.4**2 + 0.1))
    for column, value in enumerate(row.tolist()):
        assert (value > 0) == (abs(column - 20) < reach)
    assert row[row > 0].min() < 0.02


@pytest.mark.parametrize("name", Gop.__slots__)
def test_gradient_by_differences(name: str) -> None:
    gop = examples.random_gop(6, grid=(3, 2, 2), seed=3)
    gop.position[:] *= 0.8
    tensors = {n: torch.tensor(getattr(gop, n), dtype=torch.float64) for n in Gop.__slots__}
    weights = torch.from_numpy(np.random.default_rng(4).normal(size=(9, 12, 3)))
    direction = torch.from_numpy(np.random.default_rng(6).normal(size=tensors[name].shape))

    def value(step: float) -> float:
        moved = tensors | {name: tensors[name] + step * direction}
        return float((reference.render(moved, 0.3, SIZE) * weights).sum())

    tensors[name].requires_grad_()
    frame = reference.render(tensors, 0.3, SIZE)
    (gradient,) = torch.autograd.grad((frame * weights).sum(), tensors[name])
    tensors[name] = tensors[name].detach()
    step = 1e-6
    difference = (value(step) - value(-step)) / (2 * step)
    assert float((gradient * direction).sum()) == pytest.approx(difference, rel=1e-3, abs=1e-6)


def test_unknown_backend_fails() -> None:
    with pytest.raises(ValueError, match="'native' or 'reference'"):
        render_frames(
            examples.random_gop(1),
            np.zeros(1, np.float32),
            SIZE,
            SIZE,
            backend="cuda",  # type: ignore[arg-type]
        )
