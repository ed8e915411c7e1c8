"""The native Adam step against torch's."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gsvrcodec.native import _core


@pytest.mark.parametrize("shape", [(0, 2), (1,), (7, 3), (5000, 2), (33, 17, 8), (16, 1)])
@pytest.mark.parametrize("threads", [1, 2])
def test_against_torch(shape: tuple[int, ...], threads: int, isa: str) -> None:
    r = np.random.default_rng(0)
    rates = r.uniform(0.001, 0.1, shape[-1]).astype(np.float32)
    param = r.normal(size=shape).astype(np.float32)
    columns = [torch.tensor(param[..., k], dtype=torch.float64) for k in range(shape[-1])]
    optimiser = torch.optim.Adam(
        [
            {"params": [column.requires_grad_()], "lr": float(rate)}
            for column, rate in zip(columns, rates, strict=True)
        ],
        betas=(0.9, 0.99),
        eps=1e-8,
    )
    mean, square = np.zeros_like(param), np.zeros_like(param)
    for step in range(1, 6):
        grad = r.normal(size=shape).astype(np.float32)
        for k, column in enumerate(columns):
            column.grad = torch.tensor(grad[..., k], dtype=torch.float64)
        optimiser.step()
        part = _core.AdamPart(param, mean, square, rates)
        _core.adam_step([part], [grad], 1.0, 0.9, 0.99, 1e-8, 1.0, 1.0, step, threads)
    expected = torch.stack([c.detach() for c in columns], -1).numpy().reshape(shape)
    np.testing.assert_allclose(param, expected, rtol=1e-4, atol=1e-5)


def test_what_the_gradient_opposes_stays(isa: str) -> None:
    param, mean, square = (np.zeros((2, 20), np.float32) for _ in range(3))
    part = _core.AdamPart(param, mean, square, np.full(1, 0.1, np.float32))
    first, second = np.ones_like(param), np.ones_like(param)
    second[:, ::2] = -0.1  # too little to turn the momentum
    for number, slopes in enumerate((first, second), 1):
        before = param.copy()
        _core.adam_step([part], [slopes], 1.0, 0.9, 0.99, 1e-8, 2.0, 0.0, number)
        moved = param - before
        np.testing.assert_allclose(moved[slopes > 0], -0.2, rtol=1e-4)
        assert not moved[slopes < 0].any()


def test_wrong_sizes_fail() -> None:
    a, b = np.zeros((4, 3), np.float32), np.zeros((4, 2), np.float32)
    rate, how = np.ones(1, np.float32), (1.0, 0.9, 0.99, 1e-8, 1.0, 1.0)
    for others in ((b, a), (a, b)):
        with pytest.raises(ValueError, match="one size"):
            _core.AdamPart(a, *others, rate)
    with pytest.raises(ValueError, match="one size"):
        _core.AdamPart(a, a, a, rate, b)
    with pytest.raises(ValueError, match="rates"):
        _core.AdamPart(b, b, b, np.ones(3, np.float32))
    with pytest.raises(ValueError, match="axes"):
        _core.AdamPart(b, b, b, rate, None, a)
    part = _core.AdamPart(a, a, a, rate)
    with pytest.raises(ValueError, match="size of its value"):
        _core.adam_step([part], [b], *how, 1)
    with pytest.raises(ValueError, match="have a gradient"):
        _core.adam_step([part], [], *how, 1)
    with pytest.raises(ValueError, match="step"):
        _core.adam_step([part], [a], *how, 0)
