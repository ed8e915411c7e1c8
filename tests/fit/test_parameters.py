"""The trainable form: what it exports, and gradients against the reference renderer."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import torch

from gsvrcodec.fit.footage import backdrop
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.fit.precision import still
from gsvrcodec.fit.recipe import Deform
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.render.native import NativeBackend
from tests import making
from tests.fit.synthetic import BACKEND, assert_gradients_of_the_reference

MODES = get_args(Deform)
SIZE = (37, 26)


def target(size: tuple[int, int] = SIZE) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return np.random.default_rng(2).integers(0, 256, (size[1], size[0], 3), np.uint8)


@pytest.fixture
def start() -> Gop:
    return making.random_gop(np.random.default_rng(5), gaussians=40)


class TestExport:
    def test_hybrid_keeps_the_start(self, start: Gop) -> None:
        gop = Parameters(start, "hybrid", BACKEND).gop()
        for name in set(Gop.__slots__) - {"xy"}:  # the grid is scaled by its channels' gains
            atol = 2e-3 if name == "indicator" else 1e-6  # indicator stays clear of 0 and 1
            np.testing.assert_allclose(getattr(gop, name), getattr(start, name), atol=atol)
        assert gop.xy.shape == start.xy.shape

    def test_triplane_has_no_polynomial(self, start: Gop) -> None:
        parameters = Parameters(start, "triplane", BACKEND)
        gop = parameters.gop()
        assert not gop.indicator.any()
        assert not gop.linear.any()
        assert not gop.quadratic.any()
        assert {"indicator", "linear", "quadratic"}.isdisjoint(parameters.raw)
        np.testing.assert_array_equal(gop.xt, start.xt)

    def test_polynomial_has_no_triplane(self, start: Gop) -> None:
        parameters = Parameters(start, "polynomial", BACKEND)
        gop = parameters.gop()
        assert not gop.xy.size + gop.xt.size + gop.yt.size
        assert (gop.indicator == 1).all()
        assert {"indicator", "xy", "xt", "yt"}.isdisjoint(parameters.raw)
        np.testing.assert_array_equal(gop.linear, start.linear)

    @pytest.mark.parametrize("mode", MODES)
    def test_training_leaves_start_and_exports_alone(self, start: Gop, mode: Deform) -> None:
        before = start.position.copy()
        parameters = Parameters(start, mode, BACKEND)
        exported = parameters.gop()
        for tensor in parameters.raw.values():
            tensor += 1
        np.testing.assert_array_equal(start.position, before)
        np.testing.assert_array_equal(exported.position, before)

    def test_what_is_fixed_is_not_trained(self, start: Gop) -> None:
        parameters = Parameters(start, "hybrid", BACKEND)
        position, indicator = np.round(start.position, 1), start.indicator.round()
        rounded = replace(start, position=position, indicator=indicator)
        parameters.fix(("position", "indicator"), rounded)
        assert {"position", "indicator"}.isdisjoint(parameters.raw)
        gop = parameters.gop()
        np.testing.assert_array_equal(gop.position, position.clip(-0.99 * 2, 0.99 * 2))
        np.testing.assert_array_equal(gop.indicator, indicator)

    def test_what_stands_behind_is_drawn_but_not_trained(self, start: Gop) -> None:
        bare = still(making.random_gop(np.random.default_rng(6), 9, (0, 0, 0)))
        parameters = Parameters(start, "hybrid", BACKEND, bare)
        assert len(parameters.gop()) == len(start)
        assert len(parameters.drawn()) == len(start) + 9
        alone, both = (
            BACKEND.sums(BACKEND.prepare(gop), 0.2, SIZE, SIZE)
            for gop in (parameters.gop(), parameters.drawn())
        )
        behind = BACKEND.sums(BACKEND.prepare(bare), 0.0, SIZE, SIZE)
        np.testing.assert_allclose(alone + behind, both, atol=1e-5 * both.max())
        assert np.abs(alone - both).max() > 0.1
        uploaded = backdrop(parameters.background, SIZE, SIZE, BACKEND)
        assert uploaded is not None
        whole = Parameters(parameters.drawn(), "hybrid", BACKEND)
        errors = [
            float(BACKEND.squared_error(each.tensors(), 0.2, target(), SIZE, one)[0])
            for each, one in ((parameters, uploaded), (whole, None), (parameters, None))
        ]
        assert errors[0] == pytest.approx(errors[1], rel=1e-3)
        assert errors[2] != pytest.approx(errors[1], rel=1e-2)

    def test_sums_have_no_opacities(self, start: Gop) -> None:
        parameters = Parameters(start, "hybrid", NativeBackend(blending="sum"))
        assert "log_opacity" not in parameters.raw
        assert not parameters.gop().log_opacity.any()
        assert (
            parameters.gradients(parameters.tensors(), 0.2, target(), SIZE).keys()
            == parameters.raw.keys()
        )

    def test_chosen_ones_are_taken(self, start: Gop) -> None:
        parameters = Parameters(start, "hybrid", BACKEND)
        before = parameters.gop()
        chosen = np.array([3, 3, 0, 39])
        parameters.rearrange(chosen)
        after = parameters.gop()
        assert len(after) == 4
        for name in set(Gop.__slots__) - {"xy", "xt", "yt"}:
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name)[chosen])
        np.testing.assert_array_equal(after.xt, before.xt)


def exactly(array: Float32Array) -> torch.Tensor:
    """The same numbers in float64."""
    return torch.from_numpy(array).double()


class TestGradients:
    @pytest.mark.parametrize("mode", MODES)
    @pytest.mark.parametrize("tau", [-1.0, 0.0, 0.37])
    @pytest.mark.parametrize("rendered", [SIZE, (18, 13)], ids=["full", "half"])
    def test_they_are_the_reference_s(
        self, start: Gop, mode: Deform, tau: float, rendered: tuple[int, int]
    ) -> None:
        parameters = Parameters(start, mode, BACKEND)
        picture = target(rendered)
        leaves = {name: exactly(array).requires_grad_() for name, array in parameters.raw.items()}
        exact = {name: exactly(array) for name, array in parameters.tensors().items()} | leaves
        if "indicator" in leaves:
            exact["indicator"] = torch.sigmoid(leaves["indicator"])
        assert_gradients_of_the_reference(parameters, exact, leaves, tau, picture, SIZE)

    def test_quantised_values_have_gradients_of_their_own(self, start: Gop) -> None:
        parameters = Parameters(start, "hybrid", BACKEND)
        tensors = parameters.tensors()
        rounded = tensors | {"colour": np.round(tensors["colour"])}
        found = parameters.gradients(rounded, 0.2, target(), SIZE)
        np.round(parameters.raw["colour"], out=parameters.raw["colour"])
        for name, gradient in parameters.gradients(
            parameters.tensors(), 0.2, target(), SIZE
        ).items():
            np.testing.assert_allclose(found[name], gradient, rtol=1e-6, atol=1e-7)

    @pytest.mark.parametrize("threads", [1, 2, 5])
    def test_threads_do_not_change_them(self, start: Gop, threads: int) -> None:
        tensors = Parameters(start, "hybrid", BACKEND).tensors()
        (error, one), (again, many) = (
            NativeBackend(count).squared_error(tensors, 0.2, target(), SIZE)
            for count in (1, threads)
        )
        assert again == error
        for a, b in zip(one, many, strict=True):
            np.testing.assert_array_equal(a, b)
