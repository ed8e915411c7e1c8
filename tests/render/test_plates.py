"""Plates: every backend against the reference, at any size, in value and gradient."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.model.gop import Gop
from gsvrcodec.model.plate import Plate
from gsvrcodec.render.native import NativeBackend
from gsvrcodec.render.reference import ReferenceBackend
from tests.render import examples
from tests.render.examples import SIZE, TAU
from tests.render.test_backends import Backends, backends, tensors

__all__ = ["backends"]

SIZES = [SIZE, (100, 30), (1, 1)]


def plate(seed: int = 0) -> Plate:
    rng = np.random.default_rng(seed)
    return Plate(rng.integers(0, 256, (3, SIZE[1], SIZE[0]), np.uint8))


def weights(size: tuple[int, int], seed: int = 1) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 1, (size[1], size[0], 3)).astype(np.float32)


@pytest.mark.parametrize("static", [0, 55])
@pytest.mark.parametrize("size", SIZES)
def test_pictures(backends: Backends, size: tuple[int, int], static: int) -> None:
    """Of one frame, of several, and as floats; with Gaussians that are drawn once."""
    gop = examples.random_gop(60)
    gop.indicator[:static], gop.linear[:static], gop.quadratic[:static] = 1, 0, 0
    backend, reference = backends("mean").over(plate()), ReferenceBackend().over(plate())
    taus = np.array([-1, TAU, 1], np.float32)
    wanted = reference.render(reference.prepare(gop), taus, size, SIZE)
    found = backend.render(backend.prepare(gop), taus, size, SIZE)
    assert np.abs(found.astype(int) - wanted).max() <= 1
    assert (found != wanted).mean() <= 2e-3
    alone = backend.render(backend.prepare(gop), taus[1:2], size, SIZE)
    assert np.array_equal(alone[0], found[1])
    deep = backend.render(backend.prepare(gop), taus[1:2], size, SIZE, bit_depth=16)
    picture = reference.picture(reference.prepare(gop), TAU, size, SIZE)
    assert np.abs(deep[0] / 65535 - picture.clip(0, 1)).max() <= 1e-4
    assert np.abs(backend.picture(backend.prepare(gop), TAU, size, SIZE) - picture).max() <= 1e-4


@pytest.mark.parametrize("size", [(37, 21), (40, 64), (7, 1), (97, 130)])
@pytest.mark.parametrize("count", [0, 60])
def test_at_the_coded_size(backends: Backends, size: tuple[int, int], count: int) -> None:
    """Whatever its width and height; with no Gaussians it is what is shown."""
    width, height = size
    codes = np.random.default_rng(2).integers(0, 256, (3, height, width), np.uint8)
    behind, gop = Plate(codes), examples.random_gop(count)
    backend, reference = backends("mean").over(behind), ReferenceBackend().over(behind)
    taus = np.array([-1, 0, TAU], np.float32)
    wanted = reference.render(reference.prepare(gop), taus, size, size)
    found = backend.render(backend.prepare(gop), taus, size, size)
    assert np.abs(found.astype(int) - wanted).max() <= 1
    if not count:
        # The ground takes a 1025th of the light.
        assert np.abs(found - behind.shown().astype(int)).max() <= 1


@pytest.mark.parametrize("static", [0, 55, 60])
@pytest.mark.parametrize("size", [(37, 21), (97, 130), (300, 70)])
def test_instruction_sets(size: tuple[int, int], static: int, isa: str) -> None:
    """A frame is the same alone as among others, whose still parts are drawn once."""
    codes = np.random.default_rng(3).integers(0, 256, (3, size[1], size[0]), np.uint8)
    gop = examples.random_gop(60)
    gop.indicator[:static], gop.linear[:static], gop.quadratic[:static] = 1, 0, 0
    reference = ReferenceBackend().over(Plate(codes))
    taus = np.linspace(-1, 1, 5, dtype=np.float32)
    wanted = reference.render(reference.prepare(gop), taus, size, size)
    for threads in (1, 3):
        backend = NativeBackend(threads).over(Plate(codes))
        prepared = backend.prepare(gop)
        found = backend.render(prepared, taus, size, size)
        assert np.abs(found.astype(int) - wanted).max() <= 1
        for number, tau in enumerate(taus):
            alone = backend.render(prepared, np.array([tau]), size, size)
            np.testing.assert_array_equal(alone[0], found[number])


@pytest.mark.parametrize("size", SIZES)
def test_gradients(backends: Backends, size: tuple[int, int]) -> None:
    gop = examples.random_gop(40)
    backend, reference = backends("mean").over(plate()), ReferenceBackend().over(plate())
    wanted = reference.gradient(gop, TAU, weights(size), SIZE)
    found = backend.gradient(gop, TAU, weights(size), SIZE)
    names = Gop.__slots__
    examples.assert_gradients_close(
        {n: getattr(found, n) for n in names}, {n: getattr(wanted, n) for n in names}
    )


def test_error(backends: Backends) -> None:
    """And its gradients; what is before the plate as a backdrop counts as if it were drawn."""
    gop, before = examples.random_gop(40), examples.random_gop(9, grid=(0, 0, 0), seed=5)
    target = np.random.default_rng(3).integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8)
    backend, reference = backends("mean").over(plate()), ReferenceBackend().over(plate())
    values = tensors(gop, backend)
    for other in (None, before):
        behind = [
            None if other is None else b.upload(b.sums(b.prepare(other), TAU, SIZE, SIZE))
            for b in (backend, reference)
        ]
        wanted, slopes = reference.squared_error(
            tensors(gop, reference), TAU, target, SIZE, behind[1]
        )
        error, found = backend.squared_error(values, TAU, backend.upload(target), SIZE, behind[0])
        assert float(error) == pytest.approx(wanted, rel=1e-4)
        examples.assert_gradients_close(
            dict(zip(values, map(backend.fetch, found), strict=True)),
            dict(zip(values, map(reference.fetch, slopes), strict=True)),
        )


def test_sums_have_the_plate_in_them(backends: Backends) -> None:
    gop, backend = examples.random_gop(40), backends("mean")
    over = backend.over(plate())
    without = backend.sums(backend.prepare(gop), TAU, SIZE, SIZE)
    found = over.sums(over.prepare(gop), TAU, SIZE, SIZE)
    np.testing.assert_allclose(found, without + plate().sums(SIZE), rtol=1e-5, atol=1e-5)
    assert backend.plate is None  # it is another backend that has one
    assert over.over(None).plate is None


def test_colours() -> None:
    """By the matrix of BT.601 and full range, as in JPEG."""
    ycc = plate().ycc.transpose(1, 2, 0)
    wanted = cv2.cvtColor(np.ascontiguousarray(ycc[..., [0, 2, 1]]), cv2.COLOR_YCrCb2RGB)
    assert np.abs(plate().shown().astype(int) - wanted).max() <= 1
    inside = (wanted > 0) & (wanted < 255)
    # OpenCV rounds the matrix to three digits.
    assert np.abs(plate().colours * 255 - wanted)[inside].max() <= 0.7


@pytest.mark.parametrize(
    ("size", "wanted"),
    [
        ((4, 1), [0, 1, 2, 3]),
        ((8, 1), [0, 0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3]),
        # By triangles of four pixels, cut at the edges: (3/4 0 + 3/4 1 + 1/4 2) / (7/4) first.
        ((2, 1), [5 / 7, 16 / 7]),
        ((1, 1), [1.5]),
    ],
)
def test_sizes(size: tuple[int, int], wanted: list[float]) -> None:
    """Interpolated in larger pictures, filtered in smaller ones."""
    ycc = np.full((3, 1, 4), 128, np.uint8)
    ycc[0, 0] = [0, 51, 102, 153]
    found = Plate(ycc).sums(size)
    assert found.shape == (size[1], size[0], 4)
    np.testing.assert_allclose(found[0, :, 0] * 5, wanted, rtol=1e-5, atol=1e-5)
    assert (found[..., 3] == 1).all()


def test_it_is_held_in_the_last_two_sizes() -> None:
    """A fit goes back and forth between whole frames and half of them."""
    behind, sizes = plate(), [(64, 48), (32, 24), (64, 48), (32, 24), (16, 12), (32, 24), (64, 48)]
    made: list[tuple[int, int]] = []

    def held(size: tuple[int, int], place: str) -> tuple[int, int]:
        def make() -> tuple[int, int]:
            made.append(size)
            return size

        found: tuple[int, int] = behind.held(size, place, make)
        return found

    assert [held(size, "here") for size in sizes] == sizes
    assert made == [(64, 48), (32, 24), (16, 12), (64, 48)]
    held((64, 48), "there")
    assert len(made) == 5
