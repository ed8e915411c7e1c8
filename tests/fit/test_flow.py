"""Optical flow: known translations are found, and no size is too small."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from gsvrcodec.errors import UsageError
from gsvrcodec.fit.motion import flow_estimator, lengths, resize
from tests.fit.synthetic import moving_texture


class TestDis:
    @pytest.mark.parametrize("near", [False, True])
    @pytest.mark.parametrize("step", [(0, 0), (3, 0), (0, -2), (-4, 5)])
    def test_translation_is_recovered(self, step: tuple[int, int], near: bool) -> None:
        first, second = moving_texture(2, step)
        flow = flow_estimator("dis", near=near)(first, second)
        assert flow.shape == (120, 160, 2)
        assert flow.dtype == np.float32
        inside = flow[16:-16, 16:-16].reshape(-1, 2)
        np.testing.assert_allclose(np.median(inside, axis=0), step, atol=0.25)
        assert lengths(flow).mean() == pytest.approx(np.hypot(*step), abs=0.5)

    @pytest.mark.parametrize("size", [(1, 1), (200, 1), (8, 40), (31, 31), (32, 32), (33, 47)])
    def test_tiny_frames(self, size: tuple[int, int]) -> None:
        first, second = moving_texture(2, (1, 0), size)
        flow = flow_estimator("dis")(first, second)
        assert flow.shape == (size[1], size[0], 2)
        assert np.isfinite(flow).all()

    def test_something_small_and_fast_is_followed_nearly(self) -> None:
        """A patch of texture goes over another that stands, as hands do over a table."""
        ground, patch = moving_texture(2, (0, 0), (320, 240))[0], moving_texture(2, (0, 0))[1]
        frames = np.stack([ground, ground])
        frames[0, 100:140, 100:140] = patch[20:60, 20:60]
        frames[1, 103:143, 109:149] = patch[20:60, 20:60]
        misses = [
            np.abs(flow_estimator("dis", near=near)(*frames)[104:136, 104:136] - (9, 3)).mean()
            for near in (False, True)
        ]
        assert misses[1] < 0.6 * misses[0]

    def test_an_estimator_keeps_nothing_from_call_to_call(self) -> None:
        first, second = moving_texture(2, (2, 1))
        used = flow_estimator("dis")
        used(second, first)
        np.testing.assert_array_equal(used(first, second), flow_estimator("dis")(first, second))


class TestRaft:
    def test_without_torchvision_fails(self, monkeypatch: pytest.MonkeyPatch) -> None:
        for name in ("torchvision", "torchvision.models.optical_flow"):
            monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(UsageError, match=r"`flow='raft'` needs torchvision.*`flow='dis'`"):
            flow_estimator("raft")

    def test_encode_without_torchvision_leaves_nothing(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        import gsvrcodec
        from tests import making

        for name in ("torchvision", "torchvision.models.optical_flow"):
            monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(UsageError, match="torchvision"):
            gsvrcodec.encode(making.NOISE, tmp_path / "a.gsvr", flow="raft")
        assert not list(tmp_path.iterdir())


class TestResize:
    def test_keeps_the_aspect(self) -> None:
        assert resize(np.zeros((720, 1280, 3), np.uint8), 180).shape == (180, 320, 3)
        assert resize(np.zeros((405, 1, 3), np.uint8), 180).shape == (180, 1, 3)

    def test_never_enlarges(self) -> None:
        image = np.zeros((120, 160, 3), np.uint8)
        assert resize(image, 180) is image
