"""The anchor: what a predicted fit stores, and the Gaussians that this stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from gsvrcodec.fit.parameters import LOOK, MOTION, Parameters
from gsvrcodec.fit.tuned import OPACITY
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import (
    CHANGED,
    MOVED,
    Carried,
    carry_over,
    start_of_motion,
)
from gsvrcodec.model.static import select_gaussians
from tests import making
from tests.fit.anchored import FRAMES, example
from tests.fit.synthetic import BACKEND, assert_gradients_of_the_reference
from tests.gops import make_gop

SIZE = (37, 26)


class TestGop:
    def test_gop_and_stored_undo_each_other(self) -> None:
        _, anchor, stored = example()
        drawn = anchor.gop(stored)
        again, once_more = anchor.stored(drawn), anchor.gop(anchor.stored(drawn))
        for name in Gop.__slots__:
            np.testing.assert_allclose(getattr(again, name), getattr(stored, name), atol=2e-6)
            np.testing.assert_allclose(getattr(once_more, name), getattr(drawn, name), atol=2e-6)
        for name in LOOK:
            assert not np.allclose(getattr(drawn, name)[:20], getattr(stored, name)[:20], atol=0.1)

    def test_new_gaussians_are_stored_as_they_are(self) -> None:
        _, anchor, stored = example()
        drawn = anchor.gop(stored)
        for name in LOOK:
            np.testing.assert_array_equal(getattr(drawn, name)[20:], getattr(stored, name)[20:])

    @pytest.mark.parametrize("frames", [1, 2, 9])
    def test_it_is_what_a_decoder_carries_over(self, frames: int) -> None:
        reference, anchor, stored = example(new=0)
        anchor.start = start_of_motion(frames)
        mode = np.full(30, 4, np.uint8)
        mode[anchor.source] = MOVED | CHANGED
        carried = Carried(mode, **{name: getattr(stored, name) for name in Carried.__slots__[1:]})
        decoded = carry_over(reference, (FRAMES, frames), carried, make_gop(0))
        drawn = anchor.gop(stored)
        for name in {*Gop.__slots__} - {"xy", "xt", "yt"}:
            np.testing.assert_allclose(getattr(decoded, name), getattr(drawn, name), atol=2e-6)

    def test_at_the_start_there_is_the_change_alone(self) -> None:
        _, anchor, stored = example(new=0)
        drawn = anchor.gop(stored)
        place = drawn.position + anchor.start * drawn.linear + anchor.start**2 * drawn.quadratic
        change = anchor.units.position * stored.position
        np.testing.assert_allclose(place, anchor.look.position + change, atol=2e-6)


class TestCosts:
    @pytest.mark.parametrize("name", LOOK)
    def test_what_a_change_costs_is_the_same_stored_and_drawn(self, name: str) -> None:
        _, anchor, stored = example()
        drawn = anchor.gop(stored)
        sensitivities = making.random_gop(np.random.default_rng(0), 28)
        value = getattr(stored, name)
        other = anchor.gop(replace(stored, **{name: value + np.float32(0.01)}))
        shift = getattr(other, name) - getattr(drawn, name)
        wanted = getattr(sensitivities, name) * np.square(shift)
        found = getattr(anchor.costs(sensitivities), name) * np.float32(0.01) ** 2
        np.testing.assert_allclose(found, wanted, rtol=1e-2, atol=1e-9)
        assert np.ptp(shift[:20]) > 1e-3 or name == "log_opacity"
        np.testing.assert_allclose(shift[20:], 0.01, rtol=1e-4)

    def test_what_has_no_units_costs_as_before(self) -> None:
        _, anchor, _ = example()
        sensitivities = making.random_gop(np.random.default_rng(0), 28)
        found = anchor.costs(sensitivities)
        for name in {*Gop.__slots__} - {*LOOK}:
            assert getattr(found, name) is getattr(sensitivities, name)


class TestGaussians:
    def test_released_ones_are_new(self) -> None:
        _, anchor, stored = example()
        anchor.release(np.array([0, 7]))
        assert (~anchor.carried).sum() == 8 + 2
        drawn = anchor.gop(stored)
        for name in LOOK:
            for n in (0, 7):
                np.testing.assert_array_equal(getattr(drawn, name)[n], getattr(stored, name)[n])

    def test_another_order(self) -> None:
        _, anchor, stored = example()
        order = np.random.default_rng(1).permutation(28)
        before = anchor.gop(stored)
        sources = anchor.source.copy()
        anchor.rearrange(order)
        after = anchor.gop(select_gaussians(stored, order))
        np.testing.assert_array_equal(anchor.source, sources[order])
        for name in LOOK:
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name)[order])

    def test_a_copy_is_one(self) -> None:
        _, anchor, _ = example()
        copy = anchor.copy()
        copy.release(np.arange(5))
        assert anchor.carried[:5].all()
        assert anchor.look.colour[:5].any()


class TestField:
    def test_it_begins_with_what_is_stored(self) -> None:
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        drawn = anchor.gop(stored)
        for name in {*Gop.__slots__} - {"indicator"}:
            np.testing.assert_allclose(
                getattr(parameters.gop(), name), getattr(drawn, name), atol=2e-6
            )
            np.testing.assert_allclose(
                getattr(parameters.stored(), name), getattr(stored, name), atol=4e-6
            )
        assert parameters.carried is not None
        np.testing.assert_array_equal(parameters.carried[:, 0], [1] * 20 + [0] * 8)

    @pytest.mark.parametrize("tau", [-1.0, 0.4])
    def test_gradients_are_those_of_the_reference_renderer(self, tau: float) -> None:
        """Of the error in the Gaussians as they are drawn."""
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        picture = np.random.default_rng(2).integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8)
        raw = {name: torch.from_numpy(array).double() for name, array in parameters.raw.items()}
        leaves = {name: tensor.requires_grad_() for name, tensor in raw.items()}
        exact = leaves | {"indicator": torch.sigmoid(leaves["indicator"])}
        exact = {name: exact[name] for name in Gop.__slots__}
        assert_gradients_of_the_reference(parameters, exact, leaves, tau, picture, SIZE)

    def test_changes_are_what_is_stored(self) -> None:
        _, anchor, stored = example()
        changes = Parameters(stored, "hybrid", BACKEND, anchor=anchor).changes()
        assert set(changes) == set(LOOK)
        for name, change in changes.items():
            np.testing.assert_allclose(change, getattr(stored, name), atol=2e-6)

    def test_a_slope_of_place_is_one_of_motion_too(self) -> None:
        """The derivative of what is stored of a place, by finite differences of motion."""
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        slope = np.random.default_rng(0).random((28, 2), np.float32)
        slopes = {name: np.ones((28, 2), np.float32) for name in ("linear", "quadratic")}
        parameters.pass_back(slopes | {"position": slope.copy()})
        before = parameters.changes()["position"]
        for name, found in slopes.items():
            parameters.raw[name] += 1
            after = parameters.changes()["position"]
            np.testing.assert_allclose(found, 1 + slope * (after - before), atol=1e-5)
            before = after

    @pytest.mark.parametrize("name", LOOK)
    def test_a_slope_of_what_is_stored_passes_through_its_unit(self, name: str) -> None:
        """By differences of what is stored."""
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        before = parameters.changes()[name]
        slope = np.random.default_rng(0).random(before.shape, np.float32)
        slopes = {name: np.zeros((28, 2), np.float32) for name in ("position", *MOTION)}
        slopes[name] = slope.copy()
        parameters.pass_back(slopes)
        parameters.raw[name] += 1
        added = parameters.changes()[name] - before
        np.testing.assert_allclose(slopes[name], slope * added, rtol=1e-4, atol=1e-5)

    def test_fixed_motion_leaves_the_stored_places_where_they_are(self) -> None:
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        rounded = replace(stored, linear=np.round(stored.linear), quadratic=0 * stored.quadratic)
        parameters.fix(("linear", "quadratic"), rounded)
        assert {"linear", "quadratic"}.isdisjoint(parameters.raw)
        for name in ("position", "linear", "quadratic", "colour"):
            np.testing.assert_allclose(
                getattr(parameters.stored(), name), getattr(rounded, name), atol=2e-6
            )

    def test_renewed_gaussians_are_new_and_as_others_are(self) -> None:
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        before = parameters.gop()
        chosen, like = np.array([1, 2]), np.array([5, 9])
        parameters.renew(chosen, like, colour=np.zeros((2, 3), np.float32))
        after = parameters.gop()
        assert parameters.carried is not None
        assert not parameters.carried[chosen].any()
        assert not after.colour[chosen].any()
        assert parameters.anchor is not None
        assert (parameters.anchor.source[chosen] == -1).all()
        for name in ("log_scale", "rotation", "linear", "quadratic", "position"):
            np.testing.assert_allclose(
                getattr(after, name)[chosen], getattr(before, name)[like], atol=2e-6
            )
        rest = np.setdiff1d(np.arange(28), chosen)
        np.testing.assert_array_equal(after.position[rest], before.position[rest])
        assert anchor.carried[chosen].all()  # the anchor given is left alone

    def test_frozen_looks_are_held(self) -> None:
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        frozen = np.arange(28) % 3 == 0
        parameters.freeze(frozen)
        gradients = {name: np.ones_like(tensor) for name, tensor in parameters.raw.items()}
        parameters.hold(gradients)
        for name, gradient in gradients.items():
            held = gradient == 0
            if name in LOOK:
                np.testing.assert_array_equal(held.reshape(28, -1).any(axis=1), frozen)
            else:
                assert not held.any()

    def test_another_order_is_the_same_picture(self) -> None:
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        before = parameters.gop()
        order = np.random.default_rng(0).permutation(28)
        parameters.rearrange(order)
        for name in LOOK:
            np.testing.assert_array_equal(
                getattr(parameters.gop(), name), getattr(before, name)[order]
            )

    def test_motion_turns_about_the_canonical_position(self) -> None:
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        before = parameters.gop()
        parameters.raw["linear"] += 0.3
        parameters.raw["quadratic"] -= 0.1
        after = parameters.gop()
        np.testing.assert_array_equal(after.position, before.position)
        np.testing.assert_allclose(after.linear, before.linear + 0.3, atol=1e-6)

    def test_opacities_are_bounded_as_they_are_drawn(self) -> None:
        _, anchor, stored = example()
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        parameters.raw["log_opacity"][::2] += 50
        parameters.raw["log_opacity"][1::2] -= 50
        parameters.limit()
        drawn = parameters.gop().log_opacity
        np.testing.assert_allclose(drawn[::2], OPACITY.most, atol=1e-5)
        np.testing.assert_allclose(drawn[1::2], -OPACITY.most, atol=1e-5)

    def test_opacities_of_the_reference_are_bounded_too(self) -> None:
        _, anchor, stored = example()
        anchor.look.log_opacity[:2] = [8, -8]
        stored.log_opacity[:] = 0
        parameters = Parameters(stored, "hybrid", BACKEND, anchor=anchor)
        parameters.limit()
        bound = OPACITY.most
        np.testing.assert_allclose(parameters.gop().log_opacity[:2], [bound, -bound], atol=1e-5)
        # What lies within stays exactly unchanged.
        assert not parameters.stored().log_opacity[2:].any()
