"""What a fit changes: the trainable form of a GOP, and the anchor of a predicted one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.recipe import Deform
from gsvrcodec.fit.tuned import OPACITY
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.prediction import Look, change_units
from gsvrcodec.model.static import append_gaussians
from gsvrcodec.render.backend import Backend, Samples, Scalar, Tensor

#: Attributes that a predicted GOP stores as changes.
LOOK = ("position", "log_scale", "rotation", "colour", "log_opacity")


@dataclass(slots=True, eq=False)
class Anchor:
    """What N stored Gaussians are relative to; new ones are relative to nothing.

    A carried Gaussian stores the change of its look at the time `start`, in units of its own; its
    canonical position follows from that and its motion (spec section "Prediction").
    """

    start: float  #: when carried Gaussians begin to move, in units of tau
    look: Look  #: (N, ...), zeros where new
    source: NDArray[np.intp]  #: (N,) number of the Gaussian in the reference; -1 = new

    @property
    def carried(self) -> NDArray[np.bool_]:
        """Which Gaussians come from the reference, (N,)."""
        return self.source >= 0

    def gop(self, stored: Gop) -> Gop:
        """Return the Gaussians that stored values stand for."""
        units = self.units
        values = {
            name: getattr(stored, name) * getattr(units, name) + getattr(self.look, name)
            for name in LOOK
        }
        values["position"] = values["position"] - self._way(stored)
        return replace(stored, **values)

    def stored(self, gop: Gop) -> Gop:
        """Return the stored values of Gaussians."""
        values = {
            **{name: getattr(gop, name) for name in LOOK},
            "position": gop.position + self._way(gop),
        }
        units = self.units
        return replace(
            gop,
            **{
                name: (v - getattr(self.look, name)) / getattr(units, name)
                for name, v in values.items()
            },
        )

    @property
    def units(self) -> Look:
        """What a stored value of 1 stands for; ones where new, since `look` has zeros there."""
        return change_units(self.look)

    def costs(self, sensitivities: Gop) -> Gop:
        """Return the sensitivities of stored values, from those of what is drawn."""
        units = self.units
        values = {
            name: getattr(sensitivities, name) * np.square(getattr(units, name)) for name in LOOK
        }
        return replace(sensitivities, **values)

    def _way(self, gop: Gop) -> Float32Array:
        """Motion at the time `start`, (N, 2); zeros where new."""
        way = np.float32(self.start) * gop.linear + np.float32(self.start**2) * gop.quadratic
        return np.asarray(self.carried[:, None] * way, np.float32)

    def rearrange(self, order: NDArray[np.intp]) -> None:
        """Put the Gaussians into another order."""
        self.look, self.source = self.look[order], self.source[order]

    def release(self, chosen: NDArray[np.intp]) -> None:
        """Make Gaussians new."""
        self.source[chosen] = -1
        for name in LOOK:
            getattr(self.look, name)[chosen] = 0

    def copy(self) -> Anchor:
        """Return an anchor of its own arrays."""
        return Anchor(self.start, self.look[np.arange(len(self.source))], self.source.copy())

    def arrays(self) -> dict[str, Float32Array]:
        """The look and its units, and "carried", 1 or 0, (N, 1)."""
        look, units = self.look, self.units
        return {
            **{name: getattr(look, name) for name in LOOK},
            **{_unit_of(name): getattr(units, name) for name in LOOK},
            "carried": self.carried[:, None].astype(np.float32),
        }


def _unit_of(name: str) -> str:
    """The key of an attribute's units among the arrays of an anchor."""
    return f"unit of {name}"


NAMES = Gop.__slots__
GRIDS = ("xy", "xt", "yt")  #: attributes that no Gaussian owns
MOTION = ("linear", "quadratic")  #: attributes of the polynomial
Tensors = dict[str, Tensor]  #: parameters by the names of `Gop`
_INDICATOR_RANGE = (1e-3, 1 - 1e-3)


def put(held: Tensors, values: Tensors) -> None:
    """Hold values, in place where there are some already: a recorded step looks for them there."""
    for name, value in values.items():
        if name in held:
            held[name][...] = value
        else:
            held[name] = value


class Parameters:
    """Parameters that an optimiser may change, and the way from them to a `Gop`.

    `raw` holds one tensor for each trained attribute, by the names of `Gop`; the indicator is
    a logit there. Attributes that `deform` switches off are not in `raw`.

    Carried Gaussians too are held as they are drawn, not as changes: what is stored of their place
    is where the reference leaves them, so that a step of their motion alone would move them most at
    the other end of the GOP. About their canonical positions, place and motion hardly depend on
    each other, and converge sooner.

    Args:
        start: the state to begin with, as it is stored; copied.
        deform: parts of the deformation field in use.
        backend: the renderer, on whose device the tensors lie.
        background: static Gaussians that are drawn behind the parameters and never change.
        anchor: what the stored values are relative to; None = a key GOP.
    """

    def __init__(
        self,
        start: Gop,
        deform: Deform,
        backend: Backend,
        background: Gop | None = None,
        anchor: Anchor | None = None,
    ) -> None:
        self.backend, xp = backend, backend.xp
        self.anchor = None if anchor is None else anchor.copy()
        self._anchored = self._anchor_tensors()
        self._frozen: Tensor | None = None
        self._moves: Tensor | None = None  # 1, or 0 for what is static, (N, 1)
        self.background = background
        drawn = self._drawn(start)
        tensors = {name: backend.hold(getattr(drawn, name).astype(np.float32)) for name in NAMES}
        self._fixed: dict[str, Tensor] = {}
        if deform == "triplane":
            names = ("indicator", "linear", "quadratic")
            self._fixed |= {name: xp.zeros_like(tensors[name]) for name in names}
        elif deform == "polynomial":
            none = backend.hold(np.zeros((0, 0, 8), np.float32))
            self._fixed |= {
                "indicator": xp.ones_like(tensors["indicator"]),
                **dict.fromkeys(GRIDS, none),
            }
        if backend.blending == "sum":
            self._fixed["log_opacity"] = xp.zeros_like(tensors["log_opacity"])
        self.raw = {name: tensor for name, tensor in tensors.items() if name not in self._fixed}
        if "indicator" in self.raw:
            share = xp.clip(tensors["indicator"], *_INDICATOR_RANGE)
            self.raw["indicator"] = xp.log(share / (1 - share))

    def tensors(self) -> Tensors:
        """The decoder's parameters, in the order of `Gop`."""
        out = {**self._fixed, **self.raw}
        if "indicator" in self.raw:
            out["indicator"] = self.backend.sigmoid(out["indicator"])
            if self._moves is not None:
                out["indicator"] = 1 - self._moves[:, 0] * (1 - out["indicator"])
        return {name: out[name] for name in NAMES}

    def gradients(
        self,
        tensors: Tensors,
        tau: Scalar,
        target: Samples,
        coded_size: tuple[int, int],
        backdrop: Samples | None = None,
        weights: Float32Array | None = None,
    ) -> Tensors:
        """Gradients of the mean squared error of a frame in `raw`, by the names of `Gop`.

        The backend renders, compares and differentiates in one call; the gradient passes through
        the clamp of the frame, and through quantisation.

        Args:
            tensors: the decoder's parameters as `tensors` gives them, or the same quantised.
            tau: normalised time.
            target: (H, W, 3) uint8 from `Backend.upload`; the frame is rendered at this size.
            coded_size: width and height that scales are relative to.
            backdrop: (H, W, 4) float32 from `footage.backdrop`; None = none.
            weights: of the tiles of the frame, as `Backend.squared_error` takes them.
        """
        found = self.backend.squared_error(tensors, tau, target, coded_size, backdrop, weights)[1]
        gradients = dict(zip(NAMES, found, strict=True))
        if "indicator" in self.raw:
            indicator = self.backend.sigmoid(self.raw["indicator"])
            gradients["indicator"] = gradients["indicator"] * indicator * (1 - indicator)
        return {name: gradients[name] for name in self.raw}

    @property
    def carried(self) -> Tensor | None:
        """1 for Gaussians of the reference, 0 for others, (N, 1); None = a key GOP."""
        return None if self._anchored is None else self._anchored["carried"]

    def changes(self) -> Tensors:
        """What is stored of looks in `raw`: of carried Gaussians the change, of new ones all."""
        now = {name: self.raw[name] for name in LOOK if name in self.raw}
        if self._anchored is None:
            return now
        found = {name: value - self._anchored[name] for name, value in now.items()}
        if "position" in found:
            every = self._fixed | self.raw
            for name, power in self._powers():
                found["position"] += power * every[name]
        return {name: value / self._anchored[_unit_of(name)] for name, value in found.items()}

    def pass_back(self, slopes: Tensors) -> None:
        """Turn slopes of what is stored into those of `raw`, in place.

        The changes of a carried Gaussian have units; that of its place follows its motion besides.

        Args:
            slopes: of `changes` and of motion, by name.
        """
        if self._anchored is None:
            return
        for name in slopes.keys() & LOOK:
            slopes[name] /= self._anchored[_unit_of(name)]
        if "linear" in self.raw:
            for name, power in self._powers():
                slopes[name] += power * slopes["position"]

    def _powers(self) -> Iterator[tuple[str, Tensor]]:
        """Names of motion, and by how much of it a stored place is off a canonical one, (N, 1)."""
        assert self.anchor is not None
        assert self._anchored is not None
        start, carried = self.anchor.start, self._anchored["carried"]
        return ((name, start**power * carried) for power, name in enumerate(MOTION, 1))

    def limit(self) -> None:
        """Bound the opacities that are drawn by `OPACITY.most`, in place.

        Those of the reference too, which the tri-plane may have raised: nothing new could hide
        them.
        """
        if "log_opacity" in self.raw:
            raw = self.raw["log_opacity"]
            self.backend.xp.clip(raw, -OPACITY.most, OPACITY.most, out=raw)

    def rearrange(self, order: NDArray[np.intp]) -> None:
        """Put the Gaussians into another order, which may lack some and repeat others."""
        for tensors in (self.raw, self._fixed):
            for name in tensors.keys() - set(GRIDS):
                tensors[name] = tensors[name][order]
        if self._moves is not None:
            self._moves = self._moves[order]
        if self.anchor is not None:
            self.anchor.rearrange(order)
            self._anchored = self._anchor_tensors()

    def freeze(self, chosen: NDArray[np.bool_]) -> None:
        """From now on `hold` keeps the look of these Gaussians, (N,)."""
        self._frozen = self.backend.hold(np.flatnonzero(chosen))

    def make_static(self, chosen: NDArray[np.intp], static: NDArray[np.bool_]) -> None:
        """Take the motion of Gaussians away, and give them none from now on; or let them move.

        Without polynomials nothing is done.

        Args:
            chosen: (K,) numbers of Gaussians.
            static: (K,) which of them have no motion; the others may have one.
        """
        if "linear" not in self.raw:
            return
        if self._moves is None:
            self._moves = self.backend.xp.ones_like(self.raw["linear"][:, :1])
        self._moves[chosen] = self.backend.hold(1 - static[:, None].astype(np.float32))
        for name in MOTION:
            self.raw[name][chosen[static]] = 0.0

    def hold(self, gradients: Tensors) -> None:
        """Set the gradients of frozen looks, and of the motion of static Gaussians, to 0."""
        if self._frozen is not None:
            for name in gradients.keys() & LOOK:
                gradients[name][self._frozen] = 0.0
        if self._moves is not None:
            for name in MOTION:
                gradients[name] *= self._moves
            if "indicator" in gradients:
                gradients["indicator"] *= self._moves[:, 0]

    def renew(
        self, chosen: NDArray[np.intp], like: NDArray[np.intp], **values: Float32Array
    ) -> None:
        """Make Gaussians new: as others are, but for the `values` given by the names of `Gop`."""
        fresh = {name: self.raw[name][like] for name in self.raw if name not in GRIDS}
        for name, tensor in fresh.items():
            self.raw[name][chosen] = tensor
        for name, value in values.items():
            self.raw[name][chosen] = self.backend.hold(value)
        if self.anchor is not None:
            self.anchor.release(chosen)
            self._anchored = self._anchor_tensors()

    def _anchor_tensors(self) -> Tensors | None:
        if self.anchor is None:
            return None
        return {name: self.backend.hold(array) for name, array in self.anchor.arrays().items()}

    def fix(self, names: Iterable[str], stored: Gop) -> None:
        """From now on attributes stay as they are stored: they leave `raw`.

        Looks in `raw` begin anew as stored, since places follow motion.
        """
        drawn = self._drawn(stored)
        for name in names:
            self.raw.pop(name, None)
            self._fixed[name] = self.backend.hold(getattr(drawn, name))
        for name in self.raw.keys() & LOOK:
            self.raw[name] = self.backend.hold(getattr(drawn, name).copy())

    def _drawn(self, stored: Gop) -> Gop:
        return stored if self.anchor is None else self.anchor.gop(stored)

    def drawn(self) -> Gop:
        """The present state together with the background."""
        gop = self.gop()
        return gop if self.background is None else append_gaussians(gop, self.background)

    def gop(self) -> Gop:
        """The present state, as arrays of its own, well within the bounds of the spec."""
        tensors = self.tensors()
        return Gop(
            **{
                a.name: np.clip(self.backend.fetch(tensors[a.name]), 0.99 * a.low, 0.99 * a.high)
                for a in ATTRIBUTES
            }
        )

    def stored(self) -> Gop:
        """The present state as it is stored: relative to the anchor."""
        gop = self.gop()
        return gop if self.anchor is None else self.anchor.stored(gop)
