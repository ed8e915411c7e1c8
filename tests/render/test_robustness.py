"""Parameters that no encoder writes: never a crash, and a defined result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.model.gop import Gop, parameters_of
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.native import _core
from gsvrcodec.render import render_frames
from tests.render import examples
from tests.render.examples import SIZE, TAU, Example

PER_GAUSSIAN = (
    "position",
    "log_scale",
    "rotation",
    "colour",
    "log_opacity",
    "indicator",
    "linear",
    "quadratic",
)
GRIDS = ("xy", "xt", "yt")
TAUS = np.array([TAU], np.float32)


def _copy(gop: Gop) -> Gop:
    return Gop(**{name: getattr(gop, name).copy() for name in Gop.__slots__})


def _without(gop: Gop, index: int) -> Gop:
    return Gop(
        **{
            name: np.delete(getattr(gop, name), index, 0)
            if name in PER_GAUSSIAN
            else getattr(gop, name)
            for name in Gop.__slots__
        }
    )


each_blending = pytest.mark.parametrize("blending", ["mean", "sum"])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("name", "blending"),
    [
        *((name, "mean") for name in PER_GAUSSIAN),
        *((name, "sum") for name in PER_GAUSSIAN if name != "log_opacity"),
    ],
)
def test_not_finite_is_not_drawn(name: str, value: float, blending: Blending, isa: str) -> None:
    base = examples.random_gop(20)
    gop = _copy(base)
    getattr(gop, name)[7] = value
    example = Example(gop, blending=blending)
    expected = examples.native_float(replace(example, gop=_without(base, 7)), TAUS)
    np.testing.assert_allclose(examples.native_float(example, TAUS), expected, atol=1e-5)
    weights = np.ones((SIZE[1], SIZE[0], 3), np.float32)
    gradients = examples.native_gradients(example, weights)
    for parameter, gradient in gradients.items():
        assert np.isfinite(gradient).all(), parameter
        if parameter in PER_GAUSSIAN:
            assert not gradient[7].any(), parameter


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9])
def test_sums_have_no_opacities(value: float, isa: str) -> None:
    gop = examples.random_gop(20)
    example = Example(gop, blending="sum")
    weights = np.ones((SIZE[1], SIZE[0], 3), np.float32)
    frame = examples.native_float(example, TAUS)
    gradients = examples.native_gradients(example, weights)
    gop.log_opacity[:] = value
    np.testing.assert_array_equal(examples.native_float(example, TAUS), frame)
    for name, gradient in examples.native_gradients(example, weights).items():
        np.testing.assert_array_equal(gradient, gradients[name])
    assert not gradients["log_opacity"].any()


@each_blending
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e38, -1e38])
@pytest.mark.parametrize("name", GRIDS)
def test_broken_grid(name: str, value: float, blending: Blending, isa: str) -> None:
    """Every Gaussian that reads a broken cell goes; nothing else happens."""
    gop = _copy(examples.random_gop(20))
    getattr(gop, name)[:] = value
    frame = examples.native_float(Example(gop, blending=blending), TAUS)
    assert not frame.any()  # they all do
    assert not render_frames(gop, TAUS, SIZE, SIZE, blending=blending).any()


@each_blending
@pytest.mark.parametrize("value", [1e-45, -1e3, 88.8, 90.0, 1e4, 1e9, -1e9, 1e30, 3e38, -3e38])
@pytest.mark.parametrize("name", PER_GAUSSIAN)
def test_huge(name: str, value: float, blending: Blending, isa: str) -> None:
    for size, coded in ((SIZE, SIZE), ((1, 40), (65536, 1)), ((40, 1), (1, 65536))):
        gop = _copy(examples.random_gop(40))
        getattr(gop, name)[::2] = value
        example = Example(gop, size, coded, blending)
        frame = examples.native_float(example, TAUS)
        assert not np.isnan(frame).any()
        gradients = examples.native_gradients(example, np.ones((size[1], size[0], 3), np.float32))
        if abs(value) < 3e38 or name != "colour":  # that one overflows by right
            for parameter, gradient in gradients.items():
                assert np.isfinite(gradient).all(), parameter
        render_frames(gop, TAUS, size, coded, blending=blending)


@each_blending
def test_random_bits(blending: Blending, isa: str) -> None:
    """Any 32 bits as any parameter."""
    r = np.random.default_rng(5)
    gop = examples.random_gop(500)
    for name in Gop.__slots__:
        array = getattr(gop, name)
        array[:] = r.integers(0, 2**32, array.shape, np.uint64).astype(np.uint32).view(np.float32)
    for size in (SIZE, (1, 1), (300, 3)):
        example = Example(gop, size, blending=blending)
        examples.native_float(example, TAUS)
        examples.native_gradients(example, np.ones((size[1], size[0], 3), np.float32))
    taus = np.array([np.nan, np.inf, -np.inf, 1e38], np.float32)
    render_frames(gop, taus, SIZE, SIZE, blending=blending)


def test_wrong_shapes_fail() -> None:
    gop = examples.random_gop(20)
    broken = {
        "position": np.zeros((20, 3), np.float32),
        "log_scale": np.zeros((19, 2), np.float32),
        "rotation": np.zeros((20, 1), np.float32),
        "log_opacity": np.zeros(19, np.float32),
        "xy": np.zeros((5, 6, 7), np.float32),
        "xt": np.zeros((4, 5, 8), np.float32),
        "yt": np.zeros((0, 5, 8), np.float32),
    }
    for name, array in broken.items():
        arrays = {n: getattr(gop, n) for n in Gop.__slots__} | {name: array}
        with pytest.raises(ValueError, match="must"):
            _core.Parameters(**arrays)


def test_wrong_sizes_fail() -> None:
    gop = parameters_of(examples.random_gop(2))
    out = np.zeros((1, 0, 4, 3), np.uint8)
    with pytest.raises(ValueError, match=r"1\.\.65536"):
        _core.render_rgb8(gop, TAUS, out, 4, 4, True, 1)
    with pytest.raises(ValueError, match="one frame"):
        _core.render_rgb8(gop, TAUS, np.zeros((2, 4, 4, 3), np.uint8), 4, 4, True, 1)
    with pytest.raises(ValueError, match=r"1\.\.65536"):
        _core.render_rgb8(gop, TAUS, np.zeros((1, 4, 4, 3), np.uint8), 0, 4, True, 1)
    other = parameters_of(examples.random_gop(3))
    with pytest.raises(ValueError, match="gradient"):
        _core.backward_float(gop, 0.0, np.zeros((4, 4, 3), np.float32), 4, 4, True, other, 1)
    with pytest.raises(ValueError, match="backdrop must have the size"):
        _core.backward_float(
            *(gop, 0.0, np.zeros((4, 4, 3), np.float32), 4, 4, True, gop, 1),
            _core.Backdrop(np.zeros((4, 5, 4), np.float32)),
        )


@pytest.mark.parametrize("other", _core.isas()[:-1])
def test_a_backdrop_of_other_kernels_fails(other: str) -> None:
    """Those of "portable", the last, have vectors of another width."""
    gop, used = parameters_of(examples.random_gop(2)), _core.isa()
    how = 0.0, np.zeros((4, 4, 3), np.float32), 4, 4, True, gop, 1
    try:
        _core.use_isa("portable")
        backdrop = _core.Backdrop(np.zeros((4, 4, 4), np.float32))
        _core.use_isa(other)
        with pytest.raises(ValueError, match="another instruction set"):
            _core.backward_float(gop, *how, backdrop)
    finally:
        _core.use_isa(used)


def test_other_dtype_fails() -> None:
    """A converted copy would lose what is written to it."""
    gop = examples.random_gop(2)
    arrays = {n: getattr(gop, n) for n in Gop.__slots__}
    with pytest.raises(TypeError):
        _core.Parameters(**arrays | {"log_scale": gop.log_scale.astype(np.float64)})


@pytest.mark.parametrize(
    "out",
    [
        np.zeros((1, 4, 5, 3), np.uint8),
        np.zeros((1, 4, 4, 3), np.float32),
        np.zeros((1, 4, 8, 3), np.uint8)[:, :, ::2],
    ],
    ids=["size", "dtype", "strides"],
)
def test_wrong_out_fails(out: NDArray[np.uint8]) -> None:
    with pytest.raises(ValueError, match="out must be"):
        render_frames(examples.random_gop(2), TAUS, (4, 4), (4, 4), out=out)
