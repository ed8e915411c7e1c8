"""Layers: each Gaussian is in one of the two, and their sums add up to the whole."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.layers import DYNAMIC_DISPLACEMENT, Layers, select_layers
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render.native import NativeBackend
from tests.gops import make_gop

SIZE = (40, 30)


def sums(gop: Gop, tau: float, blending: Blending = "mean") -> Float32Array:
    """Sums of weighted colours and of weights, of which pictures are made."""
    backend = NativeBackend(1, blending)
    return backend.sums(backend.prepare(gop), tau, SIZE, SIZE)


@pytest.fixture
def gop() -> Gop:
    """Half of the Gaussians have no motion of their own."""
    gop = make_gop(200, (4, 3, 5))
    gop.linear[::2] = gop.quadratic[::2] = 0
    return gop


def test_every_gaussian_is_in_one_layer(gop: Gop) -> None:
    dynamic, static = (select_layers(gop, name, SIZE) for name in ("dynamic", "static"))
    assert min(len(dynamic), len(static)) > 20
    rows = np.concatenate([dynamic.position, static.position])
    assert sorted(map(tuple, rows)) == sorted(map(tuple, gop.position))
    assert select_layers(gop, "all", SIZE) is gop


@pytest.mark.parametrize("camera", [0.0, 0.3], ids=["still", "panning"])
def test_dynamic_is_what_leaves_the_common_motion(gop: Gop, camera: float) -> None:
    gop.linear[:], gop.quadratic[:] = camera, camera / 2
    way = 2 * DYNAMIC_DISPLACEMENT  # a frame is 2 wide
    gop.linear[0, 0] += 1.01 * way
    gop.linear[1, 0] += 0.99 * way
    gop.quadratic[2, 1] -= 1.01 * way * SIZE[0] / SIZE[1]
    gop.quadratic[3, 1] -= 0.99 * way * SIZE[0] / SIZE[1]
    gop.linear[4, 0] -= 0.6 * way
    gop.quadratic[4, 0] += 0.6 * way
    assert np.array_equal(select_layers(gop, "dynamic", SIZE).position, gop.position[[0, 2, 4]])


def test_the_camera_is_what_most_of_the_area_does(gop: Gop) -> None:
    """A wall has few and large Gaussians, what moves before it has many and small ones."""
    gop.linear[:], gop.quadratic[:] = 0.2, 0
    gop.log_scale[:] = 0
    gop.linear[:20], gop.log_scale[:20] = 0, 2
    assert np.array_equal(select_layers(gop, "static", SIZE).position, gop.position[:20])


@pytest.mark.parametrize("blending", get_args(Blending))
@pytest.mark.parametrize("tau", [-1.0, 0.3])
def test_sums_add_up(gop: Gop, tau: float, blending: Blending) -> None:
    parts = [select_layers(gop, name, SIZE) for name in get_args(Layers)]
    whole, dynamic, static = (sums(part, tau, blending) for part in parts)
    assert np.abs(dynamic).max() > 0.1
    assert np.abs(static).max() > 0.1
    np.testing.assert_allclose(dynamic + static, whole, atol=1e-5)


@pytest.mark.parametrize("gaussians", [0, 50])
def test_a_layer_may_be_empty(gaussians: int) -> None:
    gop = make_gop(gaussians, (4, 3, 5))
    gop.linear[:] = gop.quadratic[:] = 0
    assert len(select_layers(gop, "static", SIZE)) == gaussians
    assert len(select_layers(gop, "dynamic", SIZE)) == 0
    assert not sums(select_layers(gop, "dynamic", SIZE), 0).any()
