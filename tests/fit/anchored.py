"""A predicted GOP and a key GOP of a few Gaussians, which the tests of fitting share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsvrcodec.fit.parameters import LOOK, Anchor, Parameters
from gsvrcodec.fit.recipe import Deform
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.prediction import Look, last_look, start_of_motion
from tests import making
from tests.fit.synthetic import BACKEND
from tests.gops import make_gop

FRAMES = 5  #: of the reference
#: Of the example: the others are new.
CARRIED = 20


def small(gaussians: int, seed: int) -> Gop:
    """Changes and motions of usual size."""
    gop = making.random_gop(np.random.default_rng(seed), gaussians)
    return replace(gop, **{name: 0.1 * getattr(gop, name) for name in LOOK})


def example(carried: int = 20, new: int = 8) -> tuple[Gop, Anchor, Gop]:
    """A reference of FRAMES frames, an anchor of some of its Gaussians, and stored values."""
    reference = make_gop(30, (4, 3, 5), seed=2)
    source = np.sort(np.random.default_rng(3).permutation(30)[:carried])
    none = Look(*(np.zeros((new, *s), np.float32) for s in ((2,), (2,), (), (3,), ())))
    look = last_look(reference, FRAMES)[source]
    look = Look(*(np.concatenate([getattr(a, n) for a in (look, none)]) for n in LOOK))
    anchor = Anchor(start_of_motion(FRAMES), look, np.append(source, np.full(new, -1)))
    return reference, anchor, small(carried + new, 4)


def predicted(deform: Deform = "hybrid", **values: Float32Array) -> Parameters:
    """Parameters of a predicted GOP, of which `values` are stored by the names of `Gop`."""
    _, anchor, stored = example(CARRIED)
    return Parameters(replace(stored, **values), deform, BACKEND, anchor=anchor)


def key(deform: Deform = "hybrid", **values: Float32Array) -> Parameters:
    """Parameters of a key GOP, of which `values` are stored by the names of `Gop`."""
    gop = making.random_gop(np.random.default_rng(1), 28)
    return Parameters(replace(gop, **values), deform, BACKEND)
