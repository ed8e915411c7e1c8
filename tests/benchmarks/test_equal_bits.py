"""The table of clips at equal bits."""

from __future__ import annotations

from gsvrcodec.report.curve import RateCurve
from tests import making
from tests.benchmarks import clips, equal_bits


class TestEqualBits:
    def test_time_is_by_pixels(self) -> None:
        sizes = ((1280, 720), (640, 480), (1920, 1080))
        assert [equal_bits.seconds(*size) for size in sizes] == [1.0, 0.33, 2.0]

    def test_a_row_for_each_quality(self) -> None:
        found = equal_bits.settings(making.NOISE)
        assert [row["crf"] for row in found] == list(equal_bits.CRFS)
        assert {row["time_budget"] for row in found} == {0.02}

    def test_table(self) -> None:
        other = {"psnr": 33.5, "ms_ssim_db": None}
        row = {"bpp": 0.05, "psnr": 34.0, "ms_ssim_db": 12.0, "others": {"x264 medium": other}}
        *_, line = equal_bits.lines([row])
        assert line.split() == ["0.0500", "34.00", "12.00", "+0.50", "-"]

    def test_settings_from_the_command_line(self) -> None:
        assert clips.setting("gop=12") == ("gop", 12)
        assert clips.setting("qat=false") == ("qat", False)
        assert clips.setting("deform=hybrid") == ("deform", "hybrid")

    def test_bd_rate_in_words(self) -> None:
        curve = RateCurve([(30.0, 1.0), (34.0, 2.0)])
        assert equal_bits.bd_text(curve.bd_rate(curve)) == "+0 % from 30.0 to 34.0 dB"
        assert equal_bits.bd_text(None) == "nothing in common"
