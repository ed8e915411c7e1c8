"""What the benchmarks beside x264 compute: moving areas, seeking, decoding speed, pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from gsvrcodec.report.reference import measure, parse_reference
from gsvrcodec.video import Rgb, open_video
from gsvrcodec.video.colour import to_rgb
from gsvrcodec.video.elementary import ycbcr_frames
from tests import making
from tests.benchmarks import decode, moving, pictures, seek, x264
from tests.benchmarks.decode import Ratio
from tests.benchmarks.footage import Footage, read
from tests.benchmarks.moving import Point

SETTINGS = {"crop": [160, 96, 20, 30], "start_frame": 2}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of random Gaussians that says it was made from a part of the small Bunny."""
    path = tmp_path_factory.mktemp("ours") / "small.gsvr"
    return making.gsvr_file(path, size=(160, 96), settings=SETTINGS)


@pytest.fixture(scope="module")
def footage(file: Path) -> Footage:
    return read(making.BUNNY_SMALL, file)[0]


def travelling(frames: int = 24) -> list[Rgb]:
    """A white square that goes right by 4 pixels a frame, over a grey ground."""
    found = []
    for number in range(frames):
        picture = np.full((64, 160, 3), 90, np.uint8)
        picture[20:40, 10 + 4 * number : 30 + 4 * number] = 255
        found.append(picture)
    return found


class TestFootage:
    def test_part_that_was_encoded(self, file: Path, footage: Footage) -> None:
        with open_video(making.BUNNY_SMALL, (160, 96, 20, 30), 2, 12) as video:
            expected = [shot.rgb for shot in video]
        assert np.array_equal(footage.pictures, expected)
        assert footage.pixels == 12 * 160 * 96

    def test_first_frames(self, file: Path) -> None:
        few, ours = read(making.BUNNY_SMALL, file, 3)
        assert len(few.pictures) == len(list(ours.pictures())) == 3

    def test_other_footage_is_told_apart(self, footage: Footage) -> None:
        assert footage.same(footage)
        assert not footage.same(Footage(footage.info, footage.pictures[1:]))
        assert not footage.same(Footage(footage.info, footage.pictures[::-1]))


class TestX264:
    @pytest.mark.usefixtures("exact_x264")
    @pytest.mark.parametrize("key", [None, 3])
    def test_it_is_what_the_report_measures(
        self, footage: Footage, tmp_path: Path, key: int | None
    ) -> None:
        found = x264.encode(footage, tmp_path / "a.mp4", 30, key)
        reference = parse_reference("x264" if key is None else f"x264:key={key}")
        with open_video(making.BUNNY_SMALL, (160, 96, 20, 30), 2, 12) as video:
            (expected,) = measure(reference, video, 12, crfs=[30]).points
        assert found.psnr == pytest.approx(expected.quality.psnr_rgb)
        # The parameter sets stand in the container.
        assert 0 < 8 * (expected.bpp - found.bpp) * footage.pixels / 64 < 60 * expected.key_frames
        assert x264.label(key) == reference.label

    @pytest.mark.parametrize(("by", "wanted"), [("psnr", 33.0), ("bpp", 0.3)])
    def test_match(self, footage: Footage, tmp_path: Path, by: str, wanted: float) -> None:
        path = tmp_path / "a.mp4"
        found = x264.match(footage, path, 12, wanted, "psnr" if by == "psnr" else "bpp")
        assert getattr(found, by) == pytest.approx(wanted, rel=0.01)
        assert footage.psnr(found.pictures()) == pytest.approx(found.psnr)

    def test_nearest_crf_of_what_cannot_be_met(self) -> None:
        assert x264.nearest_crf(lambda crf: 60 - crf, 1, 0.1) == 51

    def test_nearest_crf_of_a_curve(self) -> None:
        tried: list[float] = []

        def excess(crf: float) -> float:
            tried.append(crf)
            return 50 - 0.5 * crf - 0.004 * crf**2 - 30

        found = x264.nearest_crf(excess, 0.55, 0.03)
        assert abs(50 - 0.5 * found - 0.004 * found**2 - 30) < 0.03
        assert len(tried) <= 5

    def test_conversion_is_the_readers(self, footage: Footage) -> None:
        convert = x264.rgb_of()
        for frame in ycbcr_frames(footage.pictures[:2], footage.info):
            assert np.array_equal(convert(frame), to_rgb(frame))


class TestMovingAreas:
    def test_median_of_every_sixth(self) -> None:
        values = [5, 90, 90, 90, 90, 90, 7, 90, 90, 90, 90, 90, 30]
        stack = [np.full((70, 9, 3), value, np.uint8) for value in values]
        assert np.array_equal(moving.median_picture(stack), np.full((70, 9, 3), 7, np.float32))

    def test_median_of_two_is_their_mean(self) -> None:
        stack = [np.full((3, 3, 3), value, np.uint8) for value in [10] * 6 + [13]]
        assert moving.median_picture(stack)[0, 0, 0] == 11.5

    def test_box_mean_of_the_channels_mean(self) -> None:
        still = np.full((32, 32, 3), 100, np.float32)
        picture = np.full((32, 32, 3), 100, np.uint8)
        picture[16, 16] = (100 - 90, 100 + 60, 100)  # 50 in the mean of the channels
        found = moving.difference(picture, still)
        assert found[16, 16] == found[12, 20] == pytest.approx(50 / 81)
        assert found[11, 16] == found[16, 21] == 0

    def test_threshold(self) -> None:
        still = np.full((16, 16, 3), 100, np.float32)
        same = np.full((16, 16, 3), 112, np.uint8)
        assert not moving.moving(same, still).any()
        assert moving.moving(same + 1, still).all()

    def test_mask_follows_the_square(self) -> None:
        stack = travelling()
        found = moving.masks(stack)
        for number, mask in enumerate(found):
            assert mask is not None
            middle = 20 + 4 * number
            assert mask[30, middle]
            assert not mask[30, : middle - 16].any()
            assert not mask[30, middle + 16 :].any()
            assert not mask[:14].any()

    def test_frames_with_too_little_do_not_count(self) -> None:
        stack = [np.full((100, 100, 3), 90, np.uint8) for _ in range(13)]
        stack[3][50:52, 50:52] = 255  # 4 * 165 / 81 = 8
        stack[4][50:56, 50:56] = 255
        assert [n for n, mask in enumerate(moving.masks(stack)) if mask is not None] == [4]

    def test_psnr_over_the_mask_alone(self) -> None:
        source = np.full((40, 40, 3), 100, np.uint8)
        coded = source.copy()
        coded[:20] = 110
        coded[20:] = 200
        mask = np.zeros((40, 40), np.bool_)
        mask[5:15, 5:15] = True
        assert moving.moving_psnr(source, coded, mask) == pytest.approx(20 * np.log10(25.5))

    def test_point_is_the_mean_of_the_frames_that_count(self, footage: Footage) -> None:
        sources = footage.pictures[:3]
        coded = [
            np.clip(s.astype(int) + d, 0, 255).astype(np.uint8)
            for s, d in zip(sources, (3, 6, 9), strict=True)
        ]
        whole = np.ones((96, 160), np.bool_)
        areas: Sequence[NDArray[np.bool_] | None] = [whole, None, whole]
        found = moving.point(0.1, Footage(footage.info, sources), areas, coded)
        values = [making.psnr(a, b) for a, b in zip(sources, coded, strict=True)]
        assert found.psnr == pytest.approx(sum(values) / 3)
        assert found.moving == pytest.approx((values[0] + values[2]) / 2)

    def test_nothing_moves_fails(self, footage: Footage) -> None:
        one = Footage(footage.info, footage.pictures[:1])
        with pytest.raises(ValueError, match="nothing moves"):
            moving.point(0.1, one, [None], one.pictures)

    def test_comparison_at_equal_bits_and_at_equal_psnr(self) -> None:
        theirs = [Point(2.0**n, 30.0 + 2 * n, 20.0 + 3 * n) for n in range(4)]
        found = moving.compare(Point(2.0, 34.0, 24.5), "x", theirs)
        assert found.equal_bits is not None
        assert found.equal_psnr is not None
        assert (found.equal_bits.psnr, found.equal_bits.moving) == pytest.approx((32, 23))
        assert (found.equal_psnr.bpp, found.equal_psnr.moving) == pytest.approx((4, 26))

    def test_nothing_is_said_outside(self) -> None:
        theirs = [Point(2.0**n, 30.0 + 2 * n, 20.0 + 3 * n) for n in range(4)]
        found = moving.compare(Point(9.0, 29.0, 24.5), "x", theirs)
        assert (found.equal_bits, found.equal_psnr) == (None, None)

    def test_command(self, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(moving, "CRFS", (20, 40))
        output = tmp_path / "a.json"
        arguments = [str(making.BUNNY_SMALL), str(file), "--frames", "7", "--json", str(output)]
        result = CliRunner().invoke(moving.main, arguments, catch_exceptions=False)
        assert result.exit_code == 0
        assert "x264 medium key 12, equal bits" in result.output
        data = json.loads(output.read_text())
        assert data["frames"] == 7
        assert len(data["points"]["x264 medium"]) == 2
        assert data["rows"][0]["ours"]["moving"] < 30


class TestSeek:
    @pytest.mark.parametrize("key", [None, 5])
    @pytest.mark.parametrize("threads", [1, 2])
    def test_the_frames_are_the_right_ones(
        self, footage: Footage, tmp_path: Path, key: int | None, threads: int
    ) -> None:
        encode = x264.encode(footage, tmp_path / "a.mp4", 20, key)
        expected = list(encode.pictures())
        with seek.AvFrames(encode.path, threads) as frames:
            assert len(frames) == 12
            for index in (11, 0, 5, 4, 10, 9, 6, 6, 1):
                assert np.array_equal(frames[index], expected[index])

    def test_requests_come_again(self) -> None:
        found = seek.requests(96, 1)
        assert len(found) == 80
        assert found == seek.requests(96, 1) != seek.requests(96, 2)
        assert 0 <= min(found) < max(found) < 96

    def test_command(self, file: Path, tmp_path: Path) -> None:
        output = tmp_path / "a.json"
        arguments = [str(making.BUNNY_SMALL), str(file), "--repeats", "1", "--json", str(output)]
        result = CliRunner().invoke(seek.main, arguments, catch_exceptions=False)
        assert result.exit_code == 0
        data = json.loads(output.read_text())
        for name in ("gsvr", "gsvr, no GOP in memory", "x264 medium key 12, 1 thread"):
            assert name in result.output
            assert 0 < data["seconds"][name]["median"] <= data["seconds"][name]["worst"]


class TestDecode:
    def test_ratio_of_the_rounds(self) -> None:
        assert Ratio.of([1, 2, 4], [2, 2, 2]) == Ratio(1, 0.5, 2)

    def test_command(self, file: Path, tmp_path: Path) -> None:
        output = tmp_path / "a.json"
        arguments = [str(file), str(making.BUNNY_SMALL), "--repeats", "1", "--json", str(output)]
        result = CliRunner().invoke(decode.main, arguments, catch_exceptions=False)
        assert result.exit_code == 0
        assert "bitstream to RGB, fps" in result.output
        data = json.loads(output.read_text())
        assert data["ratios"]["bitstream to RGB, fps"]["median"] > 0
        assert set(data["fps"]) >= {"ours", "theirs", "render_only", "to_mp4"}


class TestPictures:
    def test_busiest_window(self) -> None:
        stack = [np.full((400, 800, 3), 90, np.uint8) for _ in range(13)]
        stack[7][210:250, 500:560] = 255
        stack[9][20:30, 20:30] = 255
        window, frame = pictures.busiest(stack)
        assert frame == 7
        assert (window.width, window.height) == pictures.WINDOW
        assert window.of(stack[7])[..., 0].max() == 255
        assert (window.of(stack[7]) == 255).all(2).sum() == 40 * 60

    def test_strip_shows_both_sides_of_borders(self) -> None:
        found = pictures.over_time([0, 12, 24, 36, 48], 60, 14)
        assert len(found) == pictures.STRIP
        assert set(found) >= {12, 23, 24, 35, 36, 47}
        assert found == sorted(found)

    def test_strip_at_the_end(self) -> None:
        found = pictures.over_time([0, 12, 24, 36], 40, 39)
        assert len(found) == pictures.STRIP
        assert set(found) >= {35, 36, 39}

    def test_strip_of_short_gops_covers_some_time(self) -> None:
        found = pictures.over_time(list(range(0, 60, 2)), 60, 10)
        assert len(found) == pictures.STRIP
        assert found[-1] - found[0] >= 23

    def test_strip_of_few_frames(self) -> None:
        assert pictures.over_time([0], 5, 3) == [0, 1, 2, 3, 4]

    def test_crops(self) -> None:
        (window,) = pictures.windows([(40, 20, None, 3)], 160, 96)
        assert window.text == "40:20:60:3"
        with pytest.raises(ValueError, match="does not fit"):
            pictures.windows([(40, 20, 130, 3)], 160, 96)

    def test_files_stay_small(self, tmp_path: Path) -> None:
        noise = np.random.default_rng(1).integers(0, 256, (800, 1000, 3), np.uint8)
        pictures.save(tmp_path / "a.png", noise)
        assert 0.8e6 < (tmp_path / "a.png").stat().st_size <= pictures.MAX_BYTES

    def test_command(self, file: Path, tmp_path: Path) -> None:
        arguments = [str(making.BUNNY_SMALL), str(file), "--out", str(tmp_path), "--frame", "6"]
        arguments += ["--crop", "40:30:8:9"]
        result = CliRunner().invoke(pictures.main, arguments, catch_exceptions=False)
        assert result.exit_code == 0
        names = sorted(path.name for path in tmp_path.iterdir())
        assert names == ["small-6-crop1.png", "small-6-strip1.png", "small-6.png"]
        shown = np.asarray(cv2.imread(str(tmp_path / "small-6-crop1.png")))[..., ::-1]
        assert shown.shape == (2 * 30 + 22, 3 * 80 + 2 * 4, 3)
        with open_video(making.BUNNY_SMALL, (160, 96, 20, 30), 2, 12) as video:
            source = [shot.rgb for shot in video][6][9:39, 8:48]
        assert np.array_equal(shown[22::2, :80:2], source)
