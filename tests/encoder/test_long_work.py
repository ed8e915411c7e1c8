"""Encodes that take long: side by side, interrupted, resumed, verified."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import gsvrcodec
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.encoder.encode import EncodeResult, Progress
from gsvrcodec.encoder.tuned import LOOKAHEAD
from gsvrcodec.errors import OutputError, VerificationError
from tests import making

#: Two chains of two GOPs.
SETTINGS: dict[str, Any] = {
    **{"gop": 3, "keyint": 0.4, "frames": 11},
    **{"gaussians": 40, "pack": "deflate"},
}


def quick(source: Path, target: Path, **settings: Any) -> EncodeResult:
    """Encode with the least effort."""
    return gsvrcodec.encode(source, target, **({"preset": "fastest"} | settings))


class Stop(Exception):
    """Ends an encode half-way."""


def stopped(target: Path, after: int, source: Path = making.NOISE, **settings: Any) -> None:
    """Encode until so many GOPs are done."""

    def stop(state: Progress) -> None:
        if state.gop == after:
            raise Stop

    with pytest.raises(Stop):
        quick(source, target, progress=stop, **settings)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file of an encode that nothing interrupted."""
    target = tmp_path_factory.mktemp("whole") / "a.gsvr"
    quick(making.NOISE, target, workers=1, **SETTINGS)
    return target.read_bytes()


class TestWorkersAndResume:
    def test_workers_do_not_change_the_file(self, whole: bytes, tmp_path: Path) -> None:
        calls: list[Progress] = []
        result = quick(
            making.NOISE, tmp_path / "a.gsvr", workers=2, progress=calls.append, **SETTINGS
        )
        assert (tmp_path / "a.gsvr").read_bytes() == whole
        assert [gop.key for gop in result.gop_stats] == [True, False, True, False]
        assert list(dict.fromkeys(call.gop for call in calls)) == [0, 1, 2, 3, 4]
        assert calls[-1].psnr == pytest.approx(result.psnr)

    @pytest.mark.parametrize(("after", "first", "second"), [(1, 1, 1), (3, 1, 1), (2, 2, 1)])
    def test_resuming_gives_the_same_file(
        self, whole: bytes, tmp_path: Path, after: int, first: int, second: int
    ) -> None:
        target = tmp_path / "a.gsvr"
        stopped(target, after, workers=first, **SETTINGS)
        calls: list[Progress] = []
        quick(
            making.NOISE,
            target,
            resume=True,
            workers=second,
            progress=calls.append,
            **SETTINGS,
        )
        assert calls[0].gop == after
        assert calls[0].psnr is not None
        assert calls[0].seconds_per_frame is None
        assert target.read_bytes() == whole
        assert [path.name for path in tmp_path.iterdir()] == ["a.gsvr"]

    def test_a_film_of_several_sections(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Two shots, of which the longer ones are divided."""
        tuned = replace(LOOKAHEAD, seconds=0.2)
        monkeypatch.setattr("gsvrcodec.encoder.lookahead.LOOKAHEAD", tuned)
        settings: dict[str, Any] = {"gop": 4, "keyint": 0.2, "gaussians": 40, "pack": "deflate"}
        whole = quick(making.ODD, tmp_path / "a.gsvr", workers=1, **settings)
        assert [gop.key for gop in whole.gop_stats].count(True) > 3
        target = tmp_path / "b.gsvr"
        stopped(target, 3, making.ODD, workers=1, **settings)
        quick(making.ODD, target, resume=True, workers=2, **settings)
        assert target.read_bytes() == (tmp_path / "a.gsvr").read_bytes()

    def test_resuming_nothing_is_encoding(self, whole: bytes, tmp_path: Path) -> None:
        quick(making.NOISE, tmp_path / "a.gsvr", resume=True, **SETTINGS)
        assert (tmp_path / "a.gsvr").read_bytes() == whole

    def test_overwriting_starts_anew(self, whole: bytes, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        stopped(target, 1, **{**SETTINGS, "seed": 3})
        with pytest.raises(OutputError, match=r"1 finished GOPs .*`resume=True`"):
            quick(making.NOISE, target, **SETTINGS)
        with pytest.raises(OutputError, match="begun with `seed` 3, not 0;"):
            quick(making.NOISE, target, resume=True, **SETTINGS)
        quick(making.NOISE, target, overwrite=True, **SETTINGS)
        assert target.read_bytes() == whole

    def test_another_input_is_refused(self, tmp_path: Path) -> None:
        target, source = tmp_path / "a.gsvr", tmp_path / "a.mp4"
        source.write_bytes(making.NOISE.read_bytes())

        def stop(state: Progress) -> None:
            if state.gop:
                raise Stop

        with pytest.raises(Stop):
            quick(source, target, progress=stop, **SETTINGS)
        os.utime(source, ns=(1, 1))
        with pytest.raises(OutputError, match=r"begun with input-modified-ns \d+, not 1;"):
            quick(source, target, resume=True, **SETTINGS)

    def test_time_budget_with_workers(self, tmp_path: Path) -> None:
        settings: dict[str, Any] = {"time_budget": 0.5, "gop": 2, "workers": 2, "threads": 2}
        settings |= {"frames": 8, "keyint": 0.27, "pack": "deflate", "target_psnr": 30}
        result = gsvrcodec.encode(making.NOISE, tmp_path / "a.gsvr", **settings)
        assert result.psnr > 18
        assert (result.gops, result.key_gops) == (4, 2)


class TestVerify:
    def test_sound(self, tmp_path: Path) -> None:
        result = quick(making.NOISE, tmp_path / "a.gsvr", frames=4, gop=3, verify=True)
        assert result.frames == 4

    @pytest.mark.parametrize("what", ["picture", "time", "damage"])
    def test_a_mismatch_keeps_the_old_file(
        self, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        target = tmp_path / "a.gsvr"
        target.write_bytes(b"old")
        add_gop = GsvrWriter.add_gop

        def spoilt(writer: GsvrWriter, payload: bytes) -> Any:
            changed = bytearray(payload)
            if what == "time":
                changed[16] += 1  # the first timestamp
                changed[24] += 1  # the last one, of the same frame
            elif what == "damage":
                changed[78] ^= 255  # component of the first plane
            else:
                changed[-1] ^= 255
            return add_gop(writer, bytes(changed))

        monkeypatch.setattr(GsvrWriter, "add_gop", spoilt)
        with pytest.raises(VerificationError):
            quick(making.NOISE, target, frames=1, verify=True, overwrite=True)
        assert target.read_bytes() == b"old"
