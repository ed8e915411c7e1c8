"""What a fit itself does with torch tensors, as on a GPU, beside the same with NumPy arrays."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gsvrcodec.fit.adam import Adam, axes_of, paces, turns_of
from gsvrcodec.fit.parameters import GRIDS, Anchor, Parameters
from gsvrcodec.fit.price import Price
from gsvrcodec.fit.recipe import MAIN, PREDICTED, Deform
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Gop
from gsvrcodec.render import backend_on
from gsvrcodec.render.backend import Backend
from gsvrcodec.render.reference import ReferenceBackend
from tests import making
from tests.fit.anchored import example
from tests.fit.synthetic import BACKEND

SIZE = (200, 100)
KEY = making.random_gop(np.random.default_rng(1), 28)
STEPS = {a.name: (0.01,) * a.components for a in ATTRIBUTES}


def descended(start: Gop, deform: Deform, anchor: Anchor | None, backend: Backend) -> Gop:
    """Return Gaussians after steps along given gradients: some frozen, some static, some new."""
    rng = np.random.default_rng(0)
    recipe = MAIN if anchor is None else PREDICTED
    parameters = Parameters(start, deform, backend, anchor=anchor)
    parameters.freeze(np.arange(28) % 5 == 0)
    parameters.make_static(np.arange(28), np.arange(28) % 3 == 0)
    adam, price = Adam(parameters.raw, recipe, SIZE, backend), Price(STEPS, 0.01, backend)
    for number in range(1, 7):
        gradients = {
            name: backend.hold(rng.standard_normal(tuple(values.shape), np.float32))
            for name, values in parameters.raw.items()
        }
        price.look(parameters)
        price.add(gradients)
        parameters.hold(gradients)
        adam.look(parameters.tensors(), paces(parameters, recipe, SIZE))
        adam.step(gradients, 0.1, number)
        parameters.limit()
        if number == 3:
            order, chosen = rng.permutation(28), np.array([4, 9])
            parameters.rearrange(order)
            colour = rng.random((2, 3), np.float32)
            parameters.renew(chosen, np.array([11, 12]), colour=colour)
            adam.rearrange(order, np.isin(np.arange(28), chosen))
            price.forget()
    parameters.fix(("linear", "quadratic"), parameters.stored())
    return parameters.stored()


@pytest.mark.parametrize("deform", ["hybrid", "polynomial", "triplane"])
@pytest.mark.parametrize("kind", ["key", "predicted"])
def test_they_agree(kind: str, deform: Deform) -> None:
    _, anchor, start = example() if kind == "predicted" else (None, None, KEY)
    other = backend_on("cuda:0") if torch.cuda.is_available() else ReferenceBackend()
    expected, found = (descended(start, deform, anchor, each) for each in (BACKEND, other))
    moved = 0.0
    for name in Gop.__slots__:
        one, two = getattr(expected, name), getattr(found, name)
        np.testing.assert_allclose(two, one, rtol=1e-4, atol=2e-5, err_msg=name)
        if name not in GRIDS:
            moved = max(moved, float(np.abs(one - getattr(start, name)).max()))
    assert moved > 0.1


@pytest.mark.parametrize("backend", [BACKEND, ReferenceBackend()], ids=["numpy", "torch"])
def test_numbers_without_bounds_overflow_nowhere(backend: Backend) -> None:
    """Logits and scales that have drifted far away: NumPy would warn of what is infinite."""
    far = backend.hold(np.array([-1e9, -100, 0, 100, 1e9], np.float32))
    with np.errstate(all="raise", under="ignore"):
        shares = backend.fetch(backend.sigmoid(far))
        tensors = {"log_scale": backend.xp.stack([far, -far], 1), "rotation": 0 * far}
        axes, turns = axes_of(tensors, SIZE, backend.xp), turns_of(tensors, backend.xp)
    np.testing.assert_allclose(shares, [0, 0, 0.5, 1, 1], atol=1e-6)
    np.testing.assert_array_equal(backend.fetch(turns), [0, 0, 1, 0, 0])
    assert np.isfinite(backend.fetch(axes)).all()
