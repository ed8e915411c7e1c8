from collections.abc import Sequence
from typing import Any, overload

# A C-contiguous float32 array on the CPU, NumPy or torch; images may be uint8 instead.
Array = Any

def isa() -> str:
    """Return the name of the instruction set in use."""

def isas() -> list[str]:
    """Return the names of the instruction sets that this machine supports, fastest first."""

def use_isa(name: str) -> None:
    """Use the kernels of another instruction set from now on."""

def resolve_threads(requested: int) -> int:
    """Return the number of threads for a call: `requested`; 0 = GSVR_THREADS or all cores."""

def constants() -> dict[str, float]:
    """Return the constants of `gsvrcodec.model.reconstruction` as C++ has them, by name."""

class Parameters:
    """The arrays of a `gsvrcodec.model.gop.Gop`, or of its gradients; used without a copy."""

    def __init__(
        self,
        position: Array,
        log_scale: Array,
        rotation: Array,
        colour: Array,
        log_opacity: Array,
        indicator: Array,
        linear: Array,
        quadratic: Array,
        xy: Array,
        xt: Array,
        yt: Array,
    ) -> None: ...

# In all functions below, `coded_width` and `coded_height` are the size, in pixels, in which the
# Gaussians have their scales, `mean` says that pictures are means and not sums, and `threads` = 0
# means GSVR_THREADS or all cores.

class Backdrop:
    """What lies behind frames of this size; a copy.

    Either sums (H, W, 4) float32 that are added to theirs, or the codes of a plate, (3, H, W)
    uint8. For the instruction set that is in use when it is made.
    """

    @overload
    def __init__(self, sums: Array) -> None: ...
    @overload
    def __init__(self, ycc: Array) -> None: ...

def render_rgb8(
    parameters: Parameters,
    taus: Array,
    out: Array,
    coded_width: int,
    coded_height: int,
    mean: bool,
    threads: int,
    backdrop: Backdrop | None = None,
) -> None:
    """Render a GOP at times `taus` (F,) to `out` (F, H, W, 3) uint8."""

def render_planes8(
    parameters: Parameters,
    taus: Array,
    out: Array,
    coded_width: int,
    coded_height: int,
    mean: bool,
    threads: int,
    backdrop: Backdrop | None = None,
) -> None:
    """Render a GOP at times `taus` (F,) to `out` (F, 3, H, W) uint8."""

def render_float(
    parameters: Parameters,
    taus: Array,
    out: Array,
    coded_width: int,
    coded_height: int,
    mean: bool,
    threads: int,
    backdrop: Backdrop | None = None,
) -> None:
    """Render a GOP at times `taus` (F,) to `out` (F, H, W, 3) float32, not clamped."""

def render_sums(
    parameters: Parameters,
    taus: Array,
    out: Array,
    coded_width: int,
    coded_height: int,
    mean: bool,
    threads: int,
    backdrop: Backdrop | None = None,
) -> None:
    """Write the sums of weighted colours, and of weights, to `out` (F, H, W, 4) float32."""

def pixel_errors(sums: Array, target: Array, out: Array) -> None:
    """Write the squared error of each pixel of a mean to `out` (H, W) float32.

    In 8-bit codes, clamped, summed over the colours.

    Args:
        sums: (H, W, 4) float32, as `render_sums` writes them.
        target: (H, W, 3) uint8.
        out: receives the errors.
    """

def add_effects(
    look: Look, sums: Array, coded_width: int, coded_height: int, out: Array, threads: int = 0
) -> None:
    """Add the squared change of a picture without each Gaussian, summed over colours and pixels.

    Args:
        look: N Gaussians as drawn.
        sums: (H, W, 4) float32, of these Gaussians and all others, as `render_sums` writes them.
        coded_width: of the frame that scales are relative to, pixels.
        coded_height: likewise.
        out: (N,) float64, added to.
        threads: 0 = GSVR_THREADS or all cores.
    """

def backward_float(
    parameters: Parameters,
    tau: float,
    weights: Array,
    coded_width: int,
    coded_height: int,
    mean: bool,
    gradient: Parameters,
    threads: int,
    backdrop: Backdrop | None = None,
) -> None:
    """Write the gradients of sum(frame * weights) to `gradient`; `weights` is (H, W, 3) float32.

    The backdrop is added to the sums.
    """

def squared_error(
    parameters: Parameters,
    tau: float,
    target: Array,
    coded_width: int,
    coded_height: int,
    mean: bool,
    gradient: Parameters,
    threads: int,
    backdrop: Backdrop | None = None,
    weights: Array | None = None,
) -> float:
    """Return the mean squared error of a frame, clamped to [0, 1], and write its gradients.

    Args:
        parameters: of the GOP.
        tau: time of the frame.
        target: (H, W, 3) uint8; 255 stands for 1.
        coded_width: see above.
        coded_height: see above.
        mean: see above.
        gradient: receives the gradients. The gradient of the clamp counts as 1 everywhere.
        threads: see above.
        backdrop: added to the sums.
        weights: factors of the error of each tile, float32 (tiles down, tiles across); None = 1.
    """

class AdamPart:
    """The arrays of a `gsvrcodec.render.backend.AdamPart`; used without a copy."""

    def __init__(
        self,
        value: Array,
        mean: Array,
        square: Array,
        rates: Array,
        pace: Array | None = None,
        axes: Array | None = None,
    ) -> None: ...

def adam_step(
    parts: Sequence[AdamPart],
    gradients: Sequence[Array],
    factor: float,
    beta1: float,
    beta2: float,
    epsilon: float,
    agreeing: float,
    opposing: float,
    step: int,
    threads: int = 0,
) -> None:
    """Do one step of Adam in place.

    Args:
        parts: what moves.
        gradients: of each part, of the size of its value.
        factor: of all rates.
        beta1: decay of the first moments.
        beta2: decay of the second moments.
        epsilon: added to the root of the second moments.
        agreeing: factor of a step of a number that the present gradient agrees with.
        opposing: factor of a step of a number that the present gradient opposes.
        step: number of the step, from 1.
        threads: see above.
    """

def price_slopes(
    value: Array,
    step: Array,
    carried: Array | None,
    near: int,
    change: float,
    fresh: float,
    out: Array,
    threads: int = 0,
) -> None:
    """Write slopes of prices; see `gsvrcodec.render.backend.Backend.price_slopes`.

    Args:
        value: (N, C) float32.
        step: (C,) float32.
        carried: (N,) float32; None = 0.
        near: see there.
        change: see there.
        fresh: see there.
        out: receives the slopes, (N, C) float32.
        threads: see above.
    """

class Look:
    """The arrays of a `gsvrcodec.model.prediction.Look`, or of changes of one; not copied."""

    def __init__(
        self,
        position: Array,
        log_scale: Array,
        rotation: Array,
        colour: Array,
        log_opacity: Array,
    ) -> None: ...

def look_at(parameters: Parameters, tau: float, mean: bool, out: Look) -> None:
    """Write the Gaussians of a GOP as drawn at a time."""

def change_units(look: Look, out: Look) -> None:
    """Write what a stored change of 1 adds to each value of a look."""

def carry_over(
    reference: Parameters,
    tau: float,
    mean: bool,
    mode: Array,
    change: Look,
    indicator: Array,
    linear: Array,
    quadratic: Array,
    start: float,
    bounds: Array,
    out: Parameters,
) -> None:
    """Write the Gaussians that a GOP takes over, in the order of its reference, to the first rows.

    Args:
        reference: M Gaussians.
        tau: time of its last frame.
        mean: see above.
        mode: (M,) uint8; see `gsvrcodec.model.prediction`.
        change: of those that change.
        indicator: (V,) float32, of those that move.
        linear: (V, 2) float32.
        quadratic: (V, 2) float32.
        start: time at which they begin to move.
        bounds: (5, 2) float32, least and greatest value of each attribute of a look.
        out: receives the Gaussians; may have room for more.
    """

def drawing_order(position: Array, log_scale: Array, width: int, height: int, out: Array) -> None:
    """Write a permutation; see `gsvrcodec.render.order.drawing_order`.

    Args:
        position: (N, 2) float32.
        log_scale: (N, 2) float32.
        width: of the frame, pixels.
        height: of the frame, pixels.
        out: receives the numbers, (N,) int64.
    """

def arrange(parameters: Parameters, width: int, height: int, out: Parameters) -> None:
    """Write Gaussians in another order; see `gsvrcodec.render.order.arranged`.

    Args:
        parameters: Gaussians.
        width: of the coded frame, pixels.
        height: of the coded frame, pixels.
        out: receives the Gaussians; its tri-plane is left alone.
    """

def dequantise(
    codes: Array,
    offsets: Sequence[float],
    steps: Sequence[float],
    bits: Array | None,
    numbers: Array | None,
    least: float,
    most: float,
    out: Array,
) -> None:
    """Write the values of codes; see `gsvrcodec.model.quantise.values_of`.

    Args:
        codes: (components, N) uint16.
        offsets: of each component, the value of code 0.
        steps: of each component, the difference of neighbouring values.
        bits: (N,) int8, 0 to 8: bits that refine each value; None = none.
        numbers: (components, N) uint8: what they say.
        least: bound of the values.
        most: bound of the values.
        out: receives the values, (N, components) float32.
    """
