"""Frame statistics: shot cuts of real clips, motion, and what is kept of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gsvrcodec.encoder.analysis import Analysis, FrameStats, analyse
from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.motion import flow_estimator
from tests import making
from tests.fit.synthetic import FRAMES, moving_texture, sample


def analysed(frames: Frames) -> list[FrameStats]:
    return list(analyse(frames, flow_estimator("dis")))


class TestAnalyse:
    @pytest.mark.parametrize("path", FRAMES, ids=lambda path: path.stem)
    def test_cuts_of_real_clips(self, path: Path) -> None:
        stats = list(analyse(sample(path), flow_estimator("dis")))
        assert len(stats) == FRAMES[path]
        cuts = [number for number, frame in enumerate(stats) if frame.cut]
        # In one a shot begins; the other lost frames, in which a hand came near.
        assert cuts == ([0, 12] if path in (making.ODD, making.VFR_ROTATED) else [0])
        assert all(frame.motion == 0 for frame in stats if frame.cut)
        assert any(frame.motion > 0 for frame in stats)

    def test_motion_does_not_depend_on_resolution(self) -> None:
        small = list(analyse(moving_texture(3, (2, 0), (320, 180)), flow_estimator("dis")))
        doubled = moving_texture(3, (2, 0), (320, 180)).repeat(2, axis=1).repeat(2, axis=2)
        large = list(analyse(doubled, flow_estimator("dis")))
        assert [frame.motion for frame in large] == pytest.approx([frame.motion for frame in small])

    def test_a_static_picture_does_not_move(self) -> None:
        picture = moving_texture(1, (0, 0))[0]
        stats = list(analyse([picture] * 4, flow_estimator("dis")))
        assert [frame.cut for frame in stats] == [True, False, False, False]
        assert max(frame.motion for frame in stats) < 0.05

    def test_a_page_is_scrolled(self) -> None:
        """A picture that rests changes at once; once more, without a rest; and scrolls on."""
        dots = np.random.default_rng(0).random((600, 320, 1)) < 0.2
        page = np.where(dots, 0, 255).astype(np.uint8).repeat(3, axis=2)

        def cuts(*tops: int) -> list[int]:
            frames = np.stack([page[top : top + 180] for top in tops])
            return [number for number, frame in enumerate(analysed(frames)) if frame.cut]

        assert cuts(*[0] * 5, *[48] * 4, 96, *[144] * 3) == [0, 5, 9, 10]
        assert cuts(*[0] * 4, *[48] * 4) == [0]  # not known to rest
        assert cuts(*[0] * 5, *range(48, 337, 48)) == [0, 5, 6]

    def test_the_fastest_motion_is_found(self) -> None:
        still = moving_texture(1, (0, 0), (320, 180))[0]
        frames = still[None].repeat(4, axis=0)
        frames[:, 60:120, 100:160] = moving_texture(4, (6, 0), (60, 60))
        for frame in analysed(frames)[1:]:
            assert frame.fast > 3 > 10 * frame.motion / 3
        assert max(frame.fast for frame in analysed(still[None].repeat(3, axis=0))) < 0.2

    def test_the_part_of_the_picture_that_changes(self) -> None:
        texture = moving_texture(6, (2, 0), (320, 180))

        def changed(frames: Frames, psnr: float = 36.0) -> list[float]:
            first, *others = analysed(frames)
            assert first.changed == (1.0,) * 5
            return [frame.changed_at(psnr) for frame in others]

        assert min(changed(texture)) > 0.9
        assert max(changed(texture[:1].repeat(4, axis=0))) == 0
        half = texture.copy()
        half[:, :, 160:] = half[0, :, 160:]
        assert all(0.3 < share < 0.7 for share in changed(half))
        # A fine difference matters at a high quality alone.
        faint = (100 + texture / 12).astype(np.uint8)
        shares = [min(changed(faint, psnr)) for psnr in (20, 28, 30, 34, 44, 60)]
        assert shares == sorted(shares)
        assert shares[0] == shares[1] < 0.2 < 0.5 < shares[-2] == shares[-1]

    def test_noise_is_no_change(self) -> None:
        rng = np.random.default_rng(0)
        still = np.full((4, 180, 320, 3), 128)
        noisy = np.clip(still + rng.normal(0, 12, still.shape), 0, 255).astype(np.uint8)
        assert max(frame.changed_at(36.0) for frame in analysed(noisy)[1:]) < 0.5

    def test_change_adds_up_within_a_shot(self) -> None:
        slow = moving_texture(12, (0.1, 0), (320, 180))
        shares = [frame.changed_at(36.0) for frame in analysed(slow)[1:]]
        assert shares[0] < 0.5 * shares[6]
        # It is counted against the picture of some frames before, not against the first one.
        assert shares[-1] == pytest.approx(shares[7], rel=0.1)

    def test_no_frames(self) -> None:
        assert list(analyse([], flow_estimator("dis"))) == []


class TestKept:
    ANALYSIS = Analysis(
        (FrameStats(0.0, True, 0.0, 0.1 + 0.2), FrameStats(1.5, False)), (-3, 900), (903, 40)
    )

    def test_json_brings_it_back(self) -> None:
        text = json.dumps(self.ANALYSIS.to_json())
        assert Analysis.from_json(json.loads(text)) == self.ANALYSIS

    @pytest.mark.parametrize(
        "changed",
        [
            {"stats": 3},
            {"stats": [3, 3]},
            {"stats": {}},
            {"stats": [{"motion": 1.0}] * 2},
            {"stats": [{"motion": 1.0, "cut": True, "speed": 2, "changed": [1]}] * 2},
            {"stats": [{"motion": 1.0, "cut": True, "changed": 3}] * 2},
            {"pts": [1]},
            {"pts": [1, None]},
            {"durations": [1, 2.5]},
            {"durations": 1},
            {"checksums": None},
        ],
        ids=str,
    )
    def test_another_shape_is_none(self, changed: dict[str, Any]) -> None:
        value = json.loads(json.dumps(self.ANALYSIS.to_json()))
        assert Analysis.from_json(value) is not None
        assert Analysis.from_json(value | changed) is None

    @pytest.mark.parametrize("value", [None, [], {}, 3], ids=str)
    def test_no_object_is_none(self, value: Any) -> None:
        assert Analysis.from_json(value) is None
