"""How finely each parameter is stored: sensitivities, quantiser steps, and what is not stored."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Footage, backdrop, some_frames
from gsvrcodec.fit.parameters import LOOK, MOTION, Anchor
from gsvrcodec.fit.target import bit_worth
from gsvrcodec.fit.tuned import PREDICTION, RATE_CONTROL, STEPS
from gsvrcodec.model.attributes import ATTRIBUTES, CARRIED_ATTRIBUTES
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, Float32Array, Gop
from gsvrcodec.model.quantise import Precision, Refined, Steps, short_step
from gsvrcodec.model.refinement import REFINED, Levels, Refinement, levels
from gsvrcodec.model.static import select_gaussians
from gsvrcodec.render.backend import Backend

#: 8-bit codes squared, mean of the channels: the unit that quality is measured in.
_CODES = 255.0**2 / 3

#: The eight signs that a byte stands for, (256, 8): quicker to look up than to compute.
_SIGNS = 2 * np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).astype(np.float32) - 1


def sensitivities(
    footage: Footage,
    gop: Gop,
    rng: np.random.Generator,
    backend: Backend,
    *,
    frames: int = STEPS.frames,
) -> Gop:
    """Squared error of a change of each parameter by one, over all pixels and frames.

    The diagonal of J^T J by Hutchinson's estimator: with noise r of unit variance in place of a
    picture's error, the square of the gradient J^T r is that diagonal in the mean.

    Args:
        footage: The frames that show the GOP.
        gop: The state to look at.
        rng: Source of the noise.
        backend: Gives gradients.
        frames: Most frames that are looked at.

    Returns:
        In place of each parameter its sum, squared 8-bit codes (mean of the channels).
    """
    return _sum_of_squares(_answers(footage, gop, rng, backend, frames))


def sensitivities_of_motion(
    footage: Footage,
    gop: Gop,
    rng: np.random.Generator,
    backend: Backend,
    anchor: Anchor,
    *,
    frames: int = STEPS.frames,
) -> tuple[Gop, Gop]:
    """Sensitivities where a motion changes alone, and where its place makes up for that.

    A carried Gaussian moves from where the reference leaves it, so that a change of its motion
    alone shifts it in all frames. If what is stored of its place makes up for the shift in the
    middle of the GOP, the motion may be rounded to coarser steps.

    Args:
        footage: The frames that show the GOP.
        gop: The state to look at.
        rng: Source of the noise.
        backend: Gives gradients.
        anchor: What the stored values are relative to.
        frames: Most frames that are looked at.

    Returns:
        Where it changes alone, and where its place makes up; both as `sensitivities` returns them.
    """
    in_place = list(_answers(footage, gop, rng, backend, frames))
    alone = [
        replace(
            answer,
            linear=answer.linear - np.float32(anchor.start) * there,
            quadratic=answer.quadratic - np.float32(anchor.start**2) * there,
        )
        for answer in in_place
        for there in [anchor.carried[:, None] * answer.position]
    ]
    return _sum_of_squares(alone), _sum_of_squares(in_place)


def _answers(
    footage: Footage, gop: Gop, rng: np.random.Generator, backend: Backend, frames: int
) -> Iterator[Gop]:
    """Gradients J^T r of some frames, scaled so that their squares stand for all frames."""
    (width, height), taus = footage.size, footage.taus
    chosen = some_frames(len(taus), frames)
    behind = backdrop(footage.background, footage.size, footage.size, backend)
    scale = np.float32(math.sqrt(_CODES * len(taus) / len(chosen)))
    for tau in taus[chosen]:
        random = scale * noise((height, width, 3), rng)
        yield backend.gradient(gop, float(tau), random, footage.size, behind)


def _sum_of_squares(gradients: Iterable[Gop]) -> Gop:
    """Sum of the squares of each parameter's gradients."""
    total: dict[str, Float32Array] = {}
    for gradient in gradients:
        for name in Gop.__slots__:
            square = np.square(getattr(gradient, name))
            total[name] = total[name] + square if name in total else square
    return Gop(**total)


def noise(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return ones of random sign."""
    count = math.prod(shape)
    drawn = np.frombuffer(rng.bytes(-(-count // 8)), np.uint8)
    return np.take(_SIGNS, drawn, axis=0).ravel()[:count].reshape(shape)


def usual_qscale(pixels: int, gaussians: int, psnr: float) -> float:
    """The qscale at which quantisation costs 0.2 dB after tuning.

    Args:
        pixels: Pixels of all frames that show the GOP.
        gaussians: N.
        psnr: PSNR before quantisation, dB.
    """
    wanted = STEPS.usual_share * 255.0**2 / 10 ** (psnr / 10)
    costs = STEPS.unit * GAUSSIAN_PARAMETERS * gaussians / pixels
    return min(max(math.sqrt(wanted / costs), RATE_CONTROL.finest), RATE_CONTROL.coarsest)


def equal_slope_steps(sensitivities: Gop, qscale: float) -> Steps:
    """Steps of equal slope: the last bit of each plane buys the same quality.

    Rounding a sample to steps s costs s^2 / 12 times its sensitivity. One more bit a sample saves
    three quarters of that cost. So at the optimum the cost is the same for the samples of all
    planes, and the qscale sets it.

    Args:
        sensitivities: Squared error of a change of each parameter by one; see `sensitivities`.
        qscale: Factor of all steps; 1 is fine, 3 is coarse.
    """
    steps = {}
    for attribute in ATTRIBUTES:
        change = getattr(sensitivities, attribute.name).reshape(-1, attribute.components)
        mean = change.mean(axis=0, dtype=np.float64) if len(change) else np.ones(change.shape[1])
        if attribute.grid == "gaussians":
            # Components of an attribute differ by chance alone, or by the picture's aspect.
            mean = np.full(attribute.components, np.exp(np.log(np.maximum(mean, 1e-30)).mean()))
        coarser = STEPS.coarser.get(attribute.name, 1.0)
        wanted = coarser * qscale * np.sqrt(12 * STEPS.unit / np.maximum(mean, 1e-30))
        wanted = np.clip(wanted, STEPS.smallest, STEPS.largest[attribute.name])
        if attribute.name == "rotation":
            wanted = _of_half_turn(wanted)
        elif attribute.name == "indicator":  # so that 1 is a whole number of steps
            wanted = 2.0 ** np.round(np.log2(wanted))
        else:
            wanted = _short(wanted)
        steps[attribute.name] = tuple(wanted.tolist())
    return steps


def refined_steps(gop: Gop, sensitivities: Gop, qscale: float) -> Precision:
    """Steps of equal slope for each Gaussian: coarse ones, and bits for those that need them.

    Args:
        gop: The GOP to be stored; a key GOP.
        sensitivities: Squared error of a change of each parameter by one.
        qscale: Factor of all steps.
    """
    precision: dict[str, int | tuple[float, ...] | Refined] = {}
    precision.update(equal_slope_steps(sensitivities, qscale))
    if not len(gop):
        return precision
    moving = gop.linear.any(axis=1) | gop.quadratic.any(axis=1)
    plain = {name: np.array(precision[name]) for name in REFINED}
    costs = {
        name: getattr(sensitivities, name).reshape(len(gop), -1).mean(axis=1, dtype=np.float64)
        for name in REFINED
    }
    step = np.array(precision["log_opacity"], np.float32)
    log_opacity = np.rint(gop.log_opacity / step) * step
    log_scale = gop.log_scale
    for _ in range(STEPS.refinements):
        for name, own in levels(log_scale, log_opacity).items():
            counted = moving if name in ("linear", "quadratic") else slice(None)
            if not len(own[counted]):
                continue
            most, coarsest = STEPS.most_refined, STEPS.coarsest
            if name == "rotation":
                most, coarsest = STEPS.most_turned, math.inf
            of_counted = costs[name][counted], own[counted]
            refinement, coarser = _best_refinement(*of_counted, most, coarsest)
            wanted = coarser * plain[name]
            wanted = _of_half_turn(wanted) if name == "rotation" else _short(wanted)
            precision[name] = Refined(tuple(wanted.tolist()), refinement)
            if name == "log_scale":  # levels follow from rounded values
                step = wanted.astype(np.float32)
                log_scale = np.rint(gop.log_scale / step) * step
    return precision


def steps_of_predicted(
    gop: Gop, sensitivities: Gop, carried: NDArray[np.bool_], qscale: float
) -> Precision:
    """Steps of equal slope for what a predicted GOP stores: of new Gaussians, and of carried ones.

    Args:
        gop: Stored values, without changes and motion that are not stored.
        sensitivities: Squared error of a change of each parameter by one.
        carried: (N,) Gaussians of the reference.
        qscale: Factor of all steps.
    """
    new = ~carried
    precision = dict(
        refined_steps(select_gaussians(gop, new), select_gaussians(sensitivities, new), qscale)
    )
    for grid, names in (("changed", LOOK), ("moved", MOTION)):
        stored = np.any([getattr(gop, name).reshape(len(gop), -1).any(1) for name in names], axis=0)
        own = equal_slope_steps(select_gaussians(sensitivities, carried & stored), qscale)
        of_grid = [a for a in CARRIED_ATTRIBUTES if a.grid == grid]
        precision |= {attribute.name: own[attribute.change_of] for attribute in of_grid}
    return precision


def _best_refinement(
    costs: NDArray[np.float64], own_levels: Levels, most: int, coarsest: float
) -> tuple[Refinement, float]:
    """The refinement that saves most bits at equal cost, and how much coarser its steps are.

    Args:
        costs: Sensitivity of each value, (N,).
        own_levels: Level of each Gaussian, (N,).
        most: Most bits of a value.
        coarsest: Cap on how much coarser steps are.
    """
    best = -math.inf, Refinement(), 1.0
    for least in range(int(own_levels.min()), int(own_levels.max()) + 1):
        refinement = Refinement(least, most)
        bits = refinement.bits(own_levels)
        left = (costs * 4.0**-bits).mean()
        coarser = math.sqrt(costs.mean() / left) if left > 0 else 1.0
        saved = math.log2(coarser) - bits.mean()
        if saved > best[0] and coarser <= coarsest:
            best = saved, refinement, coarser
    return best[1:]


def _short(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steps of six binary digits, so that their multiples are exact in binary32."""
    return np.array([short_step(step, 6) for step in steps])


def _of_half_turn(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steps of which a whole number, at least two, is half a circle, as a file has them."""
    wanted = math.pi / np.maximum(np.round(math.pi / steps), 2)
    return np.array([short_step(step) for step in wanted])


def still(gop: Gop) -> Gop:
    """Return the Gaussians without their motion: no polynomial, and no tri-plane."""
    return replace(
        gop,
        indicator=np.ones_like(gop.indicator),
        linear=np.zeros_like(gop.linear),
        quadratic=np.zeros_like(gop.quadratic),
    )


def with_static(gop: Gop, sensitivities: Sequence[Gop], qscale: float) -> Gop:
    """Make the Gaussians static whose motion is worth less than the bits of that motion.

    A static Gaussian has no polynomial motion and the indicator 1, which switches the tri-plane
    off.

    Args:
        gop: The GOP to be stored.
        sensitivities: Squared error of a change of each parameter by one, in several states of the
            GOP of which the worst counts; see `sensitivities`.
        qscale: Factor of the steps that the GOP will be stored with.
    """
    losses = [
        (own.linear * np.square(gop.linear)).sum(axis=1)
        + (own.quadratic * np.square(gop.quadratic)).sum(axis=1)
        + own.indicator * np.square(1 - gop.indicator)
        for own in sensitivities
    ]
    moves = np.max(losses, axis=0) >= STEPS.static_worth * qscale**2
    static = still(gop)
    return replace(
        gop,
        indicator=np.where(moves, gop.indicator, static.indicator),
        linear=np.where(moves[:, None], gop.linear, static.linear),
        quadratic=np.where(moves[:, None], gop.quadratic, static.quadratic),
    )


def with_usual_opacity(gop: Gop, new: NDArray[np.bool_], sensitivities: Gop, qscale: float) -> Gop:
    """Give the opacity 1 to new Gaussians whose opacity is worth less than its bits.

    Args:
        gop: The GOP to be stored.
        new: (N,) Gaussians that do not come from a reference.
        sensitivities: Squared error of a change of each parameter by one.
        qscale: Factor of the steps that the GOP will be stored with.
    """
    loss = sensitivities.log_opacity * np.square(gop.log_opacity)
    usual = new & (loss < STEPS.opacity_bits * bit_worth(qscale))
    return replace(gop, log_opacity=np.where(usual, np.float32(0), gop.log_opacity))


def with_unchanged(
    stored: Gop,
    carried: NDArray[np.bool_],
    sensitivities: Sequence[Gop],
    steps: Steps,
    qscale: float,
) -> Gop:
    """Undo the changes of carried Gaussians that are worth less than their bits.

    Args:
        stored: The GOP to be stored, relative to its anchor.
        carried: (N,) Gaussians of the reference.
        sensitivities: Squared error of a change of each parameter by one, in several states of the
            GOP of which the worst counts: what has been hidden by a change would show without it.
        steps: Quantiser steps.
        qscale: Factor of the steps.
    """
    losses, bits = np.zeros((len(sensitivities), len(stored))), PREDICTION.change_bits
    for name in LOOK:
        change = getattr(stored, name).reshape(len(stored), -1)
        for loss, own in zip(losses, sensitivities, strict=True):
            loss += (getattr(own, name).reshape(change.shape) * np.square(change)).sum(axis=1)
        bits = bits + np.log2(1 + np.abs(change) / np.array(steps[name])).sum(axis=1)
    loss = losses.max(axis=0)
    return without_changes(stored, carried & (loss < PREDICTION.undone * bits * bit_worth(qscale)))


def without_changes(stored: Gop, chosen: NDArray[np.bool_]) -> Gop:
    """Undo what some carried Gaussians, (N,), change of their look."""
    values = {name: getattr(stored, name).copy() for name in LOOK}
    for value in values.values():
        value[chosen] = 0
    return replace(stored, **values)
