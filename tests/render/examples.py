"""Examples for the renderers' tests, and both renderers as functions of the same arguments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop, parameters_of
from gsvrcodec.model.reconstruction import GROUND, MOST_LOG_OPACITY, Blending
from gsvrcodec.native import _core
from gsvrcodec.render import reference

Gradients = dict[str, NDArray[np.floating]]

SIZE = (67, 45)
TAU = 0.3


def random_gop(n: int, *, grid: tuple[int, int, int] = (6, 5, 4), seed: int = 0) -> Gop:
    """N Gaussians of all shapes in and around the frame; `grid` is Gx, Gy, Gt, 0 = no planes."""
    r = np.random.default_rng(seed)
    gx, gy, gt = grid
    arrays = {
        "position": r.uniform(-1.2, 1.2, (n, 2)),
        "log_scale": r.uniform(-2, 2.5, (n, 2)),
        "rotation": r.uniform(-4, 7, n),
        "colour": r.uniform(-1, 1, (n, 3)),
        "indicator": r.uniform(0, 1, n),
        "linear": r.normal(0, 0.1, (n, 2)),
        "quadratic": r.normal(0, 0.1, (n, 2)),
        "xy": r.normal(0, 0.3, (gy, gx, 8)),
        "xt": r.normal(1, 0.2, (gt, gx, 8)),
        "yt": r.normal(1, 0.2, (gt, gy, 8)),
        "log_opacity": r.normal(0, 2, n),
    }
    return Gop(**{name: np.ascontiguousarray(a, np.float32) for name, a in arrays.items()})


@dataclass(frozen=True)
class Example:
    """What to render and how large."""

    gop: Gop
    size: tuple[int, int] = SIZE
    coded_size: tuple[int, int] = SIZE
    blending: Blending = "mean"

    @property
    def mean(self) -> bool:
        """Whether pictures are means."""
        return self.blending == "mean"

    def backdrop(self, seed: int = 7) -> Float32Array:
        """Sums (H, W, 4) of a solid backdrop: weights of 0.5 to 1, and as much colour.

        Where nothing else is, the edge of a Gaussian counts as much as its middle: a weight of
        1/1024 there is half the frame, and single precision gives it three digits if the Gaussian
        is thin. Over a backdrop no such pixel hides what the others say.
        """
        width, height = self.size
        sums = np.random.default_rng(seed).uniform(0.5, 1, (height, width, 4))
        return sums.astype(np.float32)


def _shaped(sigma_px: tuple[float, float], n: int = 20) -> Gop:
    gop = random_gop(n, seed=n)
    gop.log_scale[:] = np.log(sigma_px)
    return gop


def _off_frame() -> Gop:
    gop = random_gop(40)
    gop.position[:] = 1.5 * np.sign(gop.position) + 0.2 * gop.position
    return gop


def _colourless() -> Gop:
    gop = random_gop(20, grid=(0, 0, 0))
    gop.colour[:] = 0
    return gop


def _opacities(spread: float) -> Gop:
    """Gaussians of which some hide all others, beyond the bounds too."""
    gop = random_gop(60, seed=3)
    gop.log_opacity[:] *= spread / 2
    return gop


def at_bounds(gop: Gop) -> Gop:
    """The same GOP, its opacities the least and the greatest by turns."""
    gop.log_opacity[0::2], gop.log_opacity[1::2] = -MOST_LOG_OPACITY, MOST_LOG_OPACITY
    return gop


def faint(gop: Gop) -> Gop:
    """The same GOP, all of whose opacities are the least."""
    gop.log_opacity[:] = -MOST_LOG_OPACITY
    return gop


def hidden(gop: Gop) -> Gop:
    """The same GOP, whose first Gaussian hides the others in the middle of the frame."""
    gop.position[0] = gop.linear[0] = gop.quadratic[0] = 0
    gop.indicator[0], gop.log_scale[0] = 1, np.log(3)
    gop.colour[0], gop.log_opacity[0] = (0.2, 0.5, 0.7), MOST_LOG_OPACITY
    return gop


def covered(gop: Gop) -> Gop:
    """The same GOP, whose first Gaussian covers any frame evenly."""
    gop.position[0] = gop.linear[0] = gop.quadratic[0] = 0
    gop.indicator[0], gop.log_scale[0], gop.log_opacity[0] = 1, np.log(3000), 0
    return gop


def static(gop: Gop, chosen: slice) -> Gop:
    """The same GOP, where some Gaussians are static."""
    gop.indicator[chosen] = 1
    gop.linear[chosen] = gop.quadratic[chosen] = 0
    return gop


EXAMPLES = {
    "mixed": Example(random_gop(50)),
    "one": Example(random_gop(1)),
    "15": Example(random_gop(15)),
    "16": Example(random_gop(16)),
    "17": Example(random_gop(17)),
    "none": Example(random_gop(0)),
    "no tri-plane": Example(random_gop(33, grid=(0, 0, 0))),
    "one cell": Example(random_gop(33, grid=(1, 1, 1))),
    "tiny": Example(_shaped((0.002, 0.01), 200)),
    "huge": Example(_shaped((500.0, 300.0), 5), (200, 150), (200, 150)),
    "wide": Example(_shaped((60.0, 1.0)), (400, 40), (400, 40)),
    "thin": Example(_shaped((20.0, 0.4)), (131, 97), (131, 97)),
    "needles": Example(_shaped((100.0, 0.1), 9), (131, 197), (131, 197)),
    "static": Example(static(random_gop(50), slice(None))),
    "half static": Example(static(random_gop(50), slice(None, None, 2))),
    "off frame": Example(_off_frame()),
    "zero colour": Example(_colourless()),
    "1x1": Example(random_gop(20), (1, 1), (1, 1)),
    "narrow": Example(random_gop(20), (1, 77), (1, 77)),
    "low": Example(random_gop(20), (77, 1), (77, 1)),
    "smaller": Example(random_gop(50), (33, 31), (96, 64)),
    "larger": Example(random_gop(20), (150, 140), (64, 48)),
    "stretched": Example(random_gop(20), (20, 140), (96, 48)),
    "opaque": Example(_opacities(8.0)),
    "at bounds": Example(at_bounds(static(random_gop(50), slice(20)))),
    "faint": Example(faint(random_gop(30))),
    "hidden": Example(hidden(random_gop(30))),
}


def sums(examples: Mapping[str, Example]) -> dict[str, Example]:
    """The same examples, whose pictures are sums."""
    return {f"sum, {name}": replace(own, blending="sum") for name, own in examples.items()}


EXAMPLES |= sums(EXAMPLES)


def all_levels(n: int, log_sigma: float) -> Gop:
    """Gaussians of all levels of the pyramid."""
    gop = random_gop(n, grid=(3, 2, 4), seed=9)
    gop.log_scale[:] += log_sigma
    return gop


#: Small enough for Triton's interpreter.
SMALL = {
    "all levels": Example(all_levels(24, 2.2), (48, 32), (48, 32)),
    "no tri-plane": Example(random_gop(12, grid=(0, 0, 0)), (33, 17), (33, 17)),
    "one cell": Example(random_gop(9, grid=(1, 1, 1)), (17, 33), (17, 33)),
    "smaller": Example(all_levels(16, 1.5), (31, 14), (48, 32)),
    "larger": Example(all_levels(8, 0.5), (35, 30), (14, 12)),
    "half static": Example(static(random_gop(9), slice(None, None, 2)), (13, 9), (13, 9)),
    "1x1": Example(all_levels(5, 1.0), (1, 1), (1, 1)),
    "none": Example(random_gop(0), (5, 3), (5, 3)),
    "at bounds": Example(at_bounds(static(random_gop(12), slice(4))), (23, 14), (23, 14)),
    "faint": Example(faint(all_levels(9, 0.5)), (14, 9), (14, 9)),
    "hidden": Example(hidden(random_gop(9)), (33, 20), (33, 20)),
}
SMALL |= sums(SMALL)


def native_float(example: Example, taus: Float32Array, threads: int = 1) -> Float32Array:
    """Frames (F, H, W, 3) before the clamp."""
    width, height = example.size
    out = np.full((len(taus), height, width, 3), np.nan, np.float32)
    _core.render_float(
        parameters_of(example.gop), taus, out, *example.coded_size, example.mean, threads
    )
    return out


def empty_gradient(gop: Gop) -> Gop:
    """Room for gradients, filled with NaN."""
    return Gop(**{name: np.full_like(getattr(gop, name), np.nan) for name in Gop.__slots__})


def native_sums(example: Example, tau: float = TAU) -> Float32Array:
    """The sums (H, W, 4) that a frame is made of."""
    width, height = example.size
    out = np.full((1, height, width, 4), np.nan, np.float32)
    taus = np.array([tau], np.float32)
    _core.render_sums(parameters_of(example.gop), taus, out, *example.coded_size, example.mean, 1)
    sums: Float32Array = out[0]
    return sums


def frame_of(example: Example, sums: NDArray[np.floating]) -> NDArray[np.floating]:
    """The frame (H, W, 3) that sums (H, W, 4) make."""
    return sums[..., :3] / (sums[..., 3:] + GROUND) if example.mean else sums[..., :3]


def native_gradients(
    example: Example,
    weights: Float32Array,
    tau: float = TAU,
    threads: int = 1,
    backdrop: Float32Array | None = None,
) -> Gradients:
    """Gradients of sum(frame * weights)."""
    gradient = empty_gradient(example.gop)
    _core.backward_float(
        parameters_of(example.gop),
        tau,
        weights,
        *example.coded_size,
        example.mean,
        parameters_of(gradient),
        threads,
        None if backdrop is None else _core.Backdrop(backdrop),
    )
    return {name: getattr(gradient, name) for name in Gop.__slots__}


def reference_render(
    example: Example,
    weights: Float32Array | None = None,
    tau: float = TAU,
    backdrop: Float32Array | None = None,
) -> tuple[NDArray[np.float64], Gradients]:
    """A frame before the clamp and the gradients of sum(frame * weights)."""
    tensors = {
        name: torch.tensor(getattr(example.gop, name), dtype=torch.float64, requires_grad=True)
        for name in Gop.__slots__
    }
    behind = None if backdrop is None else torch.from_numpy(backdrop)
    frame = reference.render(
        tensors, tau, example.size, example.coded_size, example.blending, behind
    )
    if weights is not None and frame.requires_grad:
        torch.autograd.backward((frame * torch.from_numpy(weights)).sum())
    gradients = {
        name: np.zeros(tensor.shape) if tensor.grad is None else tensor.grad.numpy()
        for name, tensor in tensors.items()
    }
    return frame.detach().numpy(), gradients


def reference_sums(example: Example) -> NDArray[np.float64]:
    """The sums (H, W, 4) that a frame is made of."""
    tensors = {
        name: torch.tensor(getattr(example.gop, name), dtype=torch.float64)
        for name in Gop.__slots__
    }
    sums: NDArray[np.float64] = reference.render_sums(
        tensors, TAU, example.size, example.coded_size, example.blending
    ).numpy()
    return sums


def assert_gradients_close(actual: Gradients, expected: Gradients) -> None:
    """Relative error at most 1e-3 in each parameter, as a whole and against its largest entry."""
    for name, wanted in expected.items():
        error = np.abs(actual[name] - wanted)
        if wanted.size == 0:
            continue
        assert np.linalg.norm(error) <= 1e-3 * np.linalg.norm(wanted) + 1e-9, name
        assert error.max() <= 1e-3 * np.abs(wanted).max() + 1e-9, name
