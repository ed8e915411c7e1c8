"""What every renderer offers: hold a GOP, render it, differentiate its error, take a step."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.reconstruction import Blending

Codes = NDArray[np.uint8] | NDArray[np.uint16]  #: RGB samples
Size = tuple[int, int]  #: width and height, pixels
Prepared = Any  #: a GOP as a backend holds it
#: Numbers that are optimised, float32: a NumPy array on the CPU, a torch tensor on a GPU.
Tensor = Any
#: Samples where a backend compares them: a NumPy array on the CPU, a torch tensor on a GPU.
Samples = Any
#: A float; in a step that a GPU has recorded, a tensor of one element there.
Scalar = Any
#: Width and height of the tiles of a frame whose error can be weighted, pixels; at the right and at
#: the bottom less.
TILE = 256, 64


class AdamRule(NamedTuple):
    """How Adam steps: plainly by default."""

    betas: tuple[float, float]  #: decay of the two moments
    epsilon: float = 1e-15  #: added to the root of the second moment
    agreeing: float = 1.0  #: factor of a step of a number that the present gradient agrees with
    opposing: float = 1.0  #: factor of a step of a number that the present gradient opposes


@dataclass(slots=True, eq=False)
class AdamPart:
    """A tensor that Adam moves, and what it remembers of it."""

    value: Tensor  #: what is optimised
    mean: Tensor  #: first moment, of the same shape
    square: Tensor  #: second moment, of the same shape
    rates: Tensor  #: (C,) learning rates of the components of the last axis
    pace: Tensor | None = None  #: factors of the rates, of the same shape; None = 1
    #: (N, 2, 2) x and y of each axis that a pair of the value moves along, in the last axis the
    #: axes; None = along x and y
    axes: Tensor | None = None
    held: Any = None  #: the same where the backend wants it; None = not yet there


class Prices(NamedTuple):
    """Prices of the values of an attribute."""

    change: float = 0.0  #: of what is carried over from a reference
    fresh: float = 0.0  #: of what another differs by from the usual
    near: int = 0  #: neighbours in drawing order whose mean is the usual value; 0 = that is 0


class Backend(ABC):
    """One renderer on one device. All backends agree (spec section 8.6).

    The parameters that are optimised lie on `device`, by the names of `Gop`.
    """

    device: str  #: "cpu" or "cuda:N"
    xp: Any  #: the library of their arrays: NumPy on the CPU, torch on a GPU
    blending: Blending  #: how pictures are formed
    #: whether a step takes less time if it leaves out some tiles of a frame
    skips_tiles: bool = False
    threads: int = 0  #: for what is computed on the CPU; 0 = GSVR_THREADS or all cores
    plate: Plate | None = None  #: lies behind all that is drawn; None = nothing

    def over(self, plate: Plate | None) -> Self:
        """Return this backend with a plate behind all that it draws; None = with none."""
        if plate is self.plate:
            return self
        other = copy.copy(self)
        other.plate = plate
        return other

    def behind(self, size: Size, backdrop: Samples | None = None) -> Samples | None:
        """Return a backdrop, which has the plate in it; None = that of the plate at a size."""
        plate = self.plate
        if backdrop is not None or plate is None:
            return backdrop
        place = type(self), self.device
        return plate.held(size, place, lambda: self.upload_plate(plate, size))

    def upload_plate(self, plate: Plate, size: Size) -> Samples:
        """Return a backdrop that has a plate alone."""
        return self.upload(plate.sums(size))

    @abstractmethod
    def prepare(self, gop: Gop) -> Prepared:
        """Hold a GOP where it is rendered; a GPU gets its parameters once.

        Raises:
            DeviceError: the memory of the GPU does not suffice.
        """

    @abstractmethod
    def render(
        self,
        prepared: Prepared,
        taus: Float32Array,
        size: Size,
        coded_size: Size,
        *,
        bit_depth: int = 8,
        out: Codes | None = None,
    ) -> Codes:
        """Render frames of a prepared GOP; see `gsvrcodec.render.render_frames`."""

    @abstractmethod
    def picture(self, prepared: Prepared, tau: float, size: Size, coded_size: Size) -> Float32Array:
        """Render one frame, (H, W, 3), neither clamped nor rounded."""

    @abstractmethod
    def sums(self, prepared: Prepared, tau: float, size: Size, coded_size: Size) -> Float32Array:
        """Return what a frame is made of, (H, W, 4): sums of weighted colours, and of weights.

        The plate has a part in them, the ground has not. Where pictures are sums, the last has no
        meaning.
        """

    @abstractmethod
    def gradient(
        self,
        gop: Gop,
        tau: float,
        weights: Float32Array,
        coded_size: Size,
        backdrop: Samples | None = None,
    ) -> Gop:
        """Return the gradient of sum(weights * picture) in place of each parameter.

        Args:
            gop: what is rendered.
            tau: normalised time.
            weights: (H, W, 3); the picture is rendered at this size.
            coded_size: width and height that scales are relative to.
            backdrop: (H, W, 4) float32 from `upload`, added to the sums, which has the plate in it;
                None = the plate.
        """

    @abstractmethod
    def squared_error(
        self,
        parameters: Mapping[str, Tensor],
        tau: Scalar,
        target: Samples,
        coded_size: Size,
        backdrop: Samples | None = None,
        weights: Float32Array | None = None,
    ) -> tuple[float | Tensor, Sequence[Tensor]]:
        """Return the mean squared error of one clamped frame, in [0, 1], and its gradients.

        The gradient passes through the clamp.

        Args:
            parameters: in the order of `Gop`; detached.
            tau: normalised time.
            target: (H, W, 3) uint8 from `upload`; the frame is rendered at this size.
            coded_size: width and height that scales are relative to.
            backdrop: (H, W, 4) float32 from `upload`, added to the sums, which has the plate in it;
                None = the plate.
            weights: factors of the squared error of each `TILE`, (tiles down, tiles across); None
                = 1. Only where the backend `skips_tiles`.
        """

    @abstractmethod
    def adam_step(
        self,
        parts: Sequence[AdamPart],
        gradients: Sequence[Tensor],
        rule: AdamRule,
        factor: Scalar,
        step: Scalar,
    ) -> None:
        """Take one step of Adam in place.

        Args:
            parts: what moves.
            gradients: of each part, of the shape of its value.
            rule: how.
            factor: of all rates.
            step: number of this step, from 1.
        """

    def price_slopes(
        self, value: Tensor, step: Tensor, carried: Tensor | None, prices: Prices
    ) -> Tensor:
        """Return the slopes of prices of bits, (N, C); here of torch tensors.

        With S(x) = sign(x) / (|x| + step), which is the derivative of ln(1 + |x| / step), they are
        change carried S(value) + fresh (1 - carried) S(value - usual).

        Args:
            value: (N, C), in drawing order.
            step: (C,) of the quantisers.
            carried: (N, 1), 1 for what is carried over from the reference; None = 0.
            prices: by which values are multiplied, and what is usual.
        """
        of_reference = 0.0 if carried is None else carried
        differing = value - _usual(value, prices.near) if prices.near else value
        slopes = prices.fresh * (1 - of_reference) * _slope(differing, step)
        return slopes + prices.change * of_reference * _slope(value, step)

    def sigmoid(self, values: Tensor) -> Tensor:
        """Return 1 / (1 + exp(-x)) of each number; of x below -80, that of -80."""
        return 1 / (1 + self.xp.exp(self.xp.clip(-values, None, 80)))

    def recorded(self, step: Callable[..., None]) -> Callable[..., None]:
        """Return a step that takes less time when it is repeated.

        A GPU records what the step launches, and from the third call on launches all of it at once.
        So the step must change tensors in place, must not look at their values, and must work on
        the same tensors in each call, its arguments apart.

        Args:
            step: takes numbers, which it gets as `Scalar`, and samples from `upload`.
        """
        return step

    def upload(self, samples: NDArray[Any]) -> Samples:
        """Put frames or a picture where they are compared."""
        return samples

    @abstractmethod
    def hold(self, values: NDArray[Any]) -> Tensor:
        """Put numbers where they are optimised; on the CPU they are not copied."""

    @abstractmethod
    def fetch(self, values: Tensor) -> NDArray[Any]:
        """Return numbers as an array; on the CPU they are not copied."""


def _slope(value: Tensor, step: Tensor) -> Tensor:
    """Derivative of ln(1 + |value| / step)."""
    return value.sign() / (value.abs() + step)


def _usual(value: Tensor, near: int) -> Tensor:
    """Mean of the neighbours in drawing order, (N, C)."""
    side, last = near // 2, len(value) - 1
    total, number = value.clone(), value.new_ones(len(value)).cumsum(0) - 1
    for shift in range(1, min(side, last) + 1):
        total[shift:] += value[:-shift]
        total[:-shift] += value[shift:]
    return total / (1 + number.clamp(max=side) + (last - number).clamp(max=side))[:, None]
