"""Rounding attribute by attribute: what is rounded stays, what is left makes up for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.optimise import Effort, optimise
from gsvrcodec.fit.parameters import LOOK, MOTION, Anchor, Parameters
from gsvrcodec.fit.quantise import quantise_in_stages, unchanged, with_places_for
from gsvrcodec.fit.recipe import MAIN, Deform
from gsvrcodec.fit.start import content_aware
from gsvrcodec.metrics import psnr
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.quantise import Steps, dequantised, short_step
from gsvrcodec.render import render_frames
from tests.fit.anchored import example
from tests.fit.synthetic import BACKEND, footage, moving_texture, times

SIZE = (96, 64)
COARSE = {
    name: short_step(step)
    for name, step in {
        "position": 0.004,
        "log_scale": 0.1,
        "rotation": np.pi / 40,
        "colour": 0.02,
    }.items()
}
STEPS: Steps = {a.name: (COARSE.get(a.name, 0.03125),) * a.components for a in ATTRIBUTES}


def fitted(frames: Frames, deform: Deform) -> Gop:
    grid = (0, 0, 0) if deform == "polynomial" else (6, 4, len(frames))
    rng = np.random.default_rng(0)
    start = content_aware(footage(frames), 300, grid, None, rng, BACKEND)
    parameters = Parameters(start, deform, BACKEND)
    optimise(parameters, footage(frames), MAIN, Effort(150), rng)
    return parameters.gop()


def staged(gop: Gop, frames: Frames, deform: Deform, steps: int = 60) -> Gop:
    rng = np.random.default_rng(1)
    return quantise_in_stages(
        gop, STEPS, footage(frames), MAIN, steps, None, rng, BACKEND, deform=deform
    )


def quality(gop: Gop, frames: Frames) -> float:
    return psnr(render_frames(gop, times(len(frames)), SIZE, SIZE).astype(np.uint8), frames)


@pytest.mark.parametrize("deform", ["hybrid", "polynomial", "triplane"])
def test_some_of_the_loss_is_made_up_for(deform: Deform) -> None:
    frames = moving_texture(4, (2, 1), SIZE)
    gop = fitted(frames, deform)
    result = staged(gop, frames, deform)
    plain, tuned = (quality(dequantised(each, STEPS), frames) for each in (gop, result))
    assert plain < quality(gop, frames) - 0.5
    assert tuned > plain + 0.3


def test_all_but_colours_are_what_will_be_stored() -> None:
    frames = moving_texture(3, (2, 1), SIZE)
    gop = fitted(frames, "hybrid")
    static = np.arange(300) % 3 == 0
    gop = replace(gop, indicator=np.where(static, np.float32(1), gop.indicator))
    result = staged(gop, frames, "hybrid", 9)
    again = dequantised(result, STEPS)
    for name in {a.name for a in ATTRIBUTES} - {"colour", "rotation"}:
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    turned = np.abs(again.rotation - result.rotation)
    # Half a circle is a whole number of steps, but for what their nine digits leave.
    left = abs(40 * COARSE["rotation"] - np.pi)
    np.testing.assert_allclose(np.minimum(turned, np.pi - turned), 0, atol=1.01 * left)
    assert (result.indicator[static] == 1).all()
    assert (result.colour != again.colour).any()


def test_time_ends_it() -> None:
    frames = moving_texture(3, (2, 1), SIZE)
    gop = fitted(frames, "hybrid")
    rng = np.random.default_rng(1)
    result = quantise_in_stages(gop, STEPS, footage(frames), MAIN, 10**9, 0.1, rng, BACKEND)
    assert (result.colour != gop.colour).any()


class TestAnchored:
    def staged(self, gop: Gop, anchor: Anchor) -> Gop:
        shots = footage(moving_texture(5, (1, 0), SIZE))
        rng = np.random.default_rng(1)
        return quantise_in_stages(gop, STEPS, shots, MAIN, 30, None, rng, BACKEND, anchor=anchor)

    def test_what_is_unchanged_stays_so(self) -> None:
        _, anchor, gop = example()
        none = np.arange(28) % 2 == 0
        for name in LOOK:
            getattr(gop, name)[none] = 0
        for name in ("log_scale", "rotation", "log_opacity"):
            getattr(gop, name)[~none] = 0.4  # some steps: it does not round to nothing
        np.testing.assert_array_equal(unchanged(gop), none)
        result = self.staged(gop, anchor)
        held = none & anchor.carried
        for name in LOOK:
            # Away from the anchor's values and back costs a rounding of binary32.
            np.testing.assert_allclose(getattr(result, name)[held], 0, atol=2e-6)
            assert getattr(result, name)[~none].reshape((~none).sum(), -1).any(axis=1).all()
        # New Gaussians are not held, though they began with nothing.
        assert not unchanged(result)[~held].any()

    def test_changes_are_rounded(self) -> None:
        _, anchor, gop = example()
        result = self.staged(gop, anchor)
        codes = result.position / np.float32(COARSE["position"])
        np.testing.assert_allclose(codes, np.rint(codes), atol=2e-3)
        assert np.abs(result.colour - gop.colour).max() > 1e-4


#: Steps of motion that shift a Gaussian by much more than its place is rounded by.
MOTION_STEPS: Steps = {**STEPS, **dict.fromkeys(MOTION, (short_step(0.05),) * 2)}
#: Steps by which nothing but motion is rounded.
MOTION_ALONE: Steps = {
    name: steps if name in MOTION else (2.0**-16,) * len(steps)
    for name, steps in MOTION_STEPS.items()
}


def tracks(gop: Gop, anchor: Anchor) -> Float32Array:
    """Places of carried Gaussians in some frames, (T, N, 2)."""
    drawn = anchor.gop(gop)
    at = [drawn.position + t * drawn.linear + t * t * drawn.quadratic for t in times(9)]
    return np.stack(at)[:, anchor.carried]


def test_rounded_motion_is_made_up_for() -> None:
    """Else it shifts a carried Gaussian in all frames."""
    _, anchor, gop = example()
    anchor.start = -1.4
    still = np.arange(28) % 2 == 0
    for name in LOOK:
        getattr(gop, name)[still] = 0
    ready, wanted = with_places_for(gop, MOTION_STEPS, anchor), tracks(gop, anchor)
    before, after = (
        np.square(tracks(dequantised(each, MOTION_ALONE, anchor.carried), anchor) - wanted)
        for each in (gop, ready)
    )
    held = still[anchor.carried]
    assert after[:, held].mean() < 0.7 * before[:, held].mean()
    assert after[:, ~held].mean() < 0.5 * before[:, ~held].mean()
    # In the middle of the GOP places are as they were.
    np.testing.assert_allclose(after[4, ~held], 0, atol=1e-8)
    # Nothing changes that is not stored, and nothing of new Gaussians.
    np.testing.assert_array_equal(ready.position[still & anchor.carried], 0)
    new = ~anchor.carried
    np.testing.assert_array_equal(ready.position[new], gop.position[new])
    np.testing.assert_array_equal(ready.quadratic, gop.quadratic)
