"""Where a fit starts: as many Gaussians as asked for, close to the picture, moving with it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.motion import flow_estimator
from gsvrcodec.fit.paper import random_start
from gsvrcodec.fit.start import affordable, content_aware
from gsvrcodec.fit.tuned import TRIPLANE
from gsvrcodec.model.attributes import gaussian_parameters, triplane_channels
from gsvrcodec.model.gop import Gop, GridSize
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.planes import avif
from gsvrcodec.render import render_frames
from tests import making
from tests.fit.synthetic import BACKEND, assert_finite, footage, moving_texture, sample

GRID = (6, 4, 5)


def start(
    frames: Frames,
    gaussians: int,
    grid: tuple[int, int, int] = GRID,
    *,
    moving: bool = True,
    seed: int = 0,
) -> Gop:
    estimate = flow_estimator("dis") if moving else None
    rng = np.random.default_rng(seed)
    return content_aware(footage(frames), gaussians, grid, estimate, rng, BACKEND)


def assert_shapes(gop: Gop, gaussians: int, grid: tuple[int, int, int]) -> None:
    assert_finite(gop)
    gx, gy, gt = grid
    assert len(gop) == gaussians
    assert gop.position.shape == gop.log_scale.shape == (gaussians, 2)
    assert gop.linear.shape == gop.quadratic.shape == (gaussians, 2)
    assert gop.rotation.shape == gop.indicator.shape == (gaussians,)
    assert gop.colour.shape == (gaussians, 3)
    assert gop.xy.shape == (gy, gx, 8)
    assert gop.xt.shape == (gt, gx, 8)
    assert gop.yt.shape == (gt, gy, 8)
    assert all(getattr(gop, name).dtype == np.float32 for name in Gop.__slots__)


class TestContentAware:
    def test_resembles_the_middle_frame(self) -> None:
        frames = sample(making.BUNNY_SMALL, frames=5)
        gop = start(frames, 1500)
        assert_shapes(gop, 1500, GRID)
        size = frames.shape[2], frames.shape[1]
        shown = render_frames(gop, np.zeros(1, np.float32), size, size)[0]
        assert np.corrcoef(frames[2].ravel(), shown.ravel())[0, 1] > 0.6

    def test_same_seed_same_start(self) -> None:
        frames = sample(making.NOISE, frames=3)
        first, second, other = (start(frames, 90, seed=seed) for seed in (1, 1, 2))
        for name in Gop.__slots__:
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        assert not np.array_equal(first.position, other.position)

    def test_detail_draws_gaussians(self) -> None:
        frames = np.full((1, 64, 128, 3), 90, np.uint8)
        frames[:, :, 64:] = moving_texture(1, (0, 0), (64, 64))
        gop = start(frames, 400)
        right = gop.position[:, 0] > 0
        assert right.mean() > 0.7
        assert np.median(gop.log_scale[right]) < np.median(gop.log_scale[~right])

    @pytest.mark.parametrize(
        ("shape", "gaussians"),
        [((1, 1, 1), 1), ((2, 1, 9), 4), ((3, 7, 1), 100), ((2, 5, 5), 1), ((1, 6, 4), 24)],
    )
    def test_tiny_frames_and_more_gaussians_than_pixels(
        self, shape: tuple[int, int, int], gaussians: int
    ) -> None:
        frames = np.random.default_rng(0).integers(0, 256, (*shape, 3), np.uint8)
        assert_shapes(start(frames, gaussians), gaussians, GRID)

    @pytest.mark.parametrize("level", [0, 255])
    def test_flat_frames(self, level: int) -> None:
        assert_shapes(start(np.full((2, 40, 40, 3), level, np.uint8), 50), 50, GRID)

    def test_what_the_middle_frame_lacks_starts_at_the_ends(self) -> None:
        # The picture moves by half its width: the middle frame has seen half of each end at most.
        frames = moving_texture(9, (12, 0), (192, 96))
        gop = start(frames, 3000)
        assert_shapes(gop, 3000, GRID)
        ends = np.array([-1, 1], np.float32)
        pictures = render_frames(gop, ends, (192, 96), (192, 96))
        for shown, frame in zip(pictures, frames[[0, -1]], strict=True):
            for side in (slice(0, 40), slice(152, 192)):
                assert shown[:, side].mean() >= 0.5 * frame[:, side].mean()

    def test_without_triplane(self) -> None:
        assert_shapes(start(sample(making.NOISE, frames=2), 30, (0, 0, 0)), 30, (0, 0, 0))

    @given(
        st.tuples(*[st.integers(1, 64)] * 3),
        st.integers(1, 10**5),
        st.sampled_from(["sum", "mean"]),
    )
    def test_as_many_cells_as_the_gaussians_afford(
        self, grid: GridSize, gaussians: int, blending: Blending
    ) -> None:
        gx, gy, gt = found = affordable(grid, gaussians, blending)
        least = TRIPLANE.cells[0]
        assert gt == grid[2]
        assert all(
            min(least, usual) <= n <= usual for n, usual in zip((gx, gy), grid[:2], strict=True)
        )
        numbers = triplane_channels(blending) * (gx * gy + gt * (gx + gy))
        spare = TRIPLANE.share * gaussian_parameters(blending) * gaussians
        if min(gx, gy) > least:  # sides are rounded
            assert numbers <= 1.3 * spare or found == grid
        assert affordable((0, 0, 0), gaussians, blending) == (0, 0, 0)

    def test_at_rest_without_flow(self) -> None:
        gop = start(moving_texture(3, (3, 0)), 30, moving=False)
        assert not gop.linear.any()
        assert not gop.quadratic.any()


class TestRandomStart:
    def test_shapes_and_ranges(self) -> None:
        frames = sample(making.NOISE, frames=2)
        gop = random_start(frames, 77, GRID, np.random.default_rng(0))
        assert_shapes(gop, 77, GRID)
        assert np.abs(gop.position).max() <= 1
        assert not gop.linear.any()

    def test_one_gaussian_of_one_pixel(self) -> None:
        frames = np.zeros((1, 1, 1, 3), np.uint8)
        gop = random_start(frames, 1, (32, 16, 1), np.random.default_rng(0))
        assert_shapes(gop, 1, (32, 16, 1))


def test_before_a_plate_they_start_where_it_is_hidden() -> None:
    plate = Plate(avif.decode(avif.encode(moving_texture(1, (0, 0), (96, 64))[0], 90), None))
    frames = np.stack([plate.shown()] * 3)
    frames[:, 20:44, 30:66] = 128
    backend = BACKEND.over(plate)
    gop = content_aware(footage(frames), 400, (0, 0, 0), None, np.random.default_rng(0), backend)
    x, y = ((gop.position + 1) / 2 * (96, 64)).T
    assert ((x > 26) & (x < 70) & (y > 16) & (y < 48)).mean() > 0.9
