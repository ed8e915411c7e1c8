"""Plates from end to end: when a film gets one, what it wins, and what reads it."""

from __future__ import annotations

import io
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.bitstream.gop_head import parse_gop_head
from gsvrcodec.bitstream.gop_payload import unpack_gop, unpack_plate
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.encoder.encode import Progress
from gsvrcodec.encoder.plates import gop_plate, grounds
from gsvrcodec.encoder.rate import qscale_of
from gsvrcodec.errors import UnsupportedError
from gsvrcodec.fit.target import Slope
from gsvrcodec.limits import Limits
from gsvrcodec.report.spending import spending
from tests.fit.test_plate import Frames, curtain, film, panned, texture
from tests.making import psnr, write_video
from tests.tampering import patched

FILM = film(24)


def encoded(film: Frames = FILM, **options: Any) -> bytes:
    settings = {"fps": 30, "gop": 8, "preset": "fastest", "workers": 1, "threads": 2, **options}
    data = gsvrcodec.encode(film, None, **settings).data
    assert data is not None
    return data


def shown(data: bytes, **how: Any) -> np.ndarray[Any, np.dtype[np.uint8]]:
    with gsvrcodec.open(data, **how) as decoder:
        return np.stack([frame.data for frame in decoder])


@pytest.fixture(scope="module")
def with_plate() -> bytes:
    return encoded()


def test_texture_that_stands_still_gets_one(with_plate: bytes) -> None:
    """Better at fewer bytes than without, by a lower constant quality."""
    lower, without = encoded(crf=29), encoded(plates=False)
    assert psnr(shown(lower), FILM) > psnr(shown(without), FILM)
    assert len(lower) < len(without)
    with GsvrReader(io.BytesIO(with_plate)) as reader, GsvrReader(io.BytesIO(without)) as other:
        assert reader.header.plates
        assert not other.header.plates
        sizes = {item.name: item.bytes for item in spending(reader)}
        assert 0 < sizes["plates"] < len(with_plate)
        assert sum(sizes.values()) == len(with_plate)


def test_predicted_gops_have_that_of_their_key_gop(with_plate: bytes) -> None:
    with gsvrcodec.open(with_plate) as decoder:
        in_order = shown(with_plate)
        for number in (17, 0, 9, 23, 3):
            assert np.array_equal(decoder[number].data, in_order[number])
    with GsvrReader(io.BytesIO(with_plate)) as reader:
        assert [gop.is_key for gop in reader.gops] == [True] + [False] * (len(reader.gops) - 1)
        assert len(reader.gops) == 3


def chained(source: Frames = FILM, **options: Any) -> bytes:
    """Encode chains of eight frames, of two GOPs each."""
    return encoded(source, **{"gop": 4, "keyint": 8 / 30, **options})


def test_later_chains_have_that_of_the_first() -> None:
    """They begin with GOPs that drop all Gaussians of the first key GOP."""
    data = chained()
    with GsvrReader(io.BytesIO(data)) as reader:
        assert {gop.reference_frame for gop in reader.gops} == {0}
        head = parse_gop_head(reader.read_gop(2))
        assert head.carried_from == head.dropped == reader.gops[0].gaussians
    apart, in_order = chained(keyint=0, gop=8), shown(data)
    assert len(data) < 0.75 * len(apart)
    assert psnr(in_order, FILM) > psnr(shown(apart), FILM)
    for number in (17, 0, 9, 23, 3):
        with gsvrcodec.open(data) as decoder:
            assert np.array_equal(decoder[number].data, in_order[number])


class TestGroundOfMotion:
    """Whether GOPs before a plate are predicted from each other."""

    def parts(self, frames: Frames) -> list[int]:
        """Return the number of GOPs of each part of a chain."""
        chain = [range(n, n + 8) for n in range(0, len(frames), 8)]
        slope = Slope(qscale_of(26), most=10**6)
        (ground,) = grounds([chain], [slope], lambda n: frames[list(n)], share=True)
        assert ground.plate is not None
        return [len(part) for part in ground.parts(chain)]

    def test_where_it_moves_on_each_is_a_chain(self) -> None:
        assert self.parts(film(48)) == [1] * 6

    def test_where_it_stays_for_long_they_are_one(self) -> None:
        came = np.concatenate([film(48)[:4], np.repeat(film(48)[4:5], 44, axis=0)])
        assert self.parts(came) == [6]

    def test_what_repairs_the_plate_stays(self) -> None:
        assert self.parts(film(48, box=1)) == [6]

    def test_its_gops_are_fitted_side_by_side(self) -> None:
        """With the bytes of one after another."""
        together = encoded(film(48), workers=3)
        assert together == encoded(film(48))
        with GsvrReader(io.BytesIO(together)) as reader:
            assert {gop.reference_frame for gop in reader.gops} == {0}


class TestChainPlates:
    """Which chains have which plate; each chain has 12 frames."""

    SLOPE = Slope(qscale_of(26), most=10**6, lasting=3.0)

    def of(
        self,
        *chains: Frames,
        slopes: Sequence[Slope | None] = (),
        share: bool = True,
        seconds: float | None = None,
    ) -> tuple[list[bytes | None], list[int]]:
        """Return the plates, and how many frames had been read when each was made."""
        frames = np.concatenate(chains)
        read, plates, reads = 0, [], []

        def some(numbers: Sequence[int]) -> Frames:
            nonlocal read
            assert numbers[0] >= read
            read = numbers[-1] + 1
            return frames[list(numbers)]

        last = len(frames)
        gops = [[range(n, n + 4), range(n + 4, min(n + 12, last))] for n in range(0, last, 12)]
        slopes = slopes or [self.SLOPE] * len(gops)
        for ground in grounds(gops, slopes, some, share=share, frame_seconds=seconds):
            plates.append(ground.plate)
            reads.append(read)
        return plates, reads

    def test_it_holds_as_long_as_nothing_changes(self) -> None:
        """And is coded the better for it. Frames are read as far as it holds, and one chain on."""
        plates, reads = self.of(film(), film(), film(), np.roll(film(), 7, axis=2))
        assert plates[0] is not None
        assert plates[0] == plates[1] == plates[2] != plates[3]
        assert reads == [48] * 4
        (alone, _), reads = self.of(film(), np.roll(film(), 7, axis=2))
        assert alone is not None
        assert len(alone) < len(plates[0])

    def test_chains_that_show_little_of_it_have_it_too(self) -> None:
        """One that is there takes no bits; a new one needs more that stands still."""
        little, nothing = curtain(0.4, 12), curtain(0.1, 12)
        plates, _ = self.of(film(), little, film())
        assert plates[0] == plates[1] == plates[2]
        plates, reads = self.of(film(), nothing, little, film())
        assert plates[1] is plates[2] is None
        assert plates[0] is not None
        assert plates[3] is not None
        assert reads == [24, 36, 48, 48]

    def test_each_has_its_own_if_none_is_to_be_shared(self) -> None:
        plates, reads = self.of(film(), film(noise=2), share=False)
        assert plates[0] != plates[1]
        assert None not in plates
        assert reads == [24, 24]

    def test_it_is_coded_quickly_where_it_would_take_much_of_the_time(self) -> None:
        """For more bytes."""
        (slow,), (quick,), (same,) = (self.of(film(), seconds=s)[0] for s in (None, 1e-4, 1e3))
        assert slow == same
        assert slow is not None
        assert quick is not None
        assert 1.02 * len(slow) < len(quick) < 1.5 * len(slow)
        of_one = gop_plate(film(), self.SLOPE), gop_plate(film(), self.SLOPE, 1e-4)
        assert None not in of_one
        assert of_one[0] != of_one[1]

    def test_what_has_no_slope_has_no_plate(self) -> None:
        assert self.of(film(), slopes=[None]) == ([None], [0])
        assert self.of(film()[:1]) == ([None], [0])

    def test_a_short_time_is_no_reason_for_one(self) -> None:
        """There is one where it takes many bits, for which Gaussians would take more."""
        coarse = [Slope(qscale_of(44), most=10**6, lasting=3.0)]
        for frames in (2, 5):
            assert self.of(film()[:frames], slopes=coarse)[0] == [None]
            assert self.of(film()[:frames])[0] != [None]
        assert self.of(film()[:6], slopes=coarse)[0] != [None]

    @pytest.mark.parametrize("textured", [True, False])
    def test_texture_is_a_reason_for_one_that_takes_few_bits(self, textured: bool) -> None:
        """Where less than most of the picture stands still."""
        coarse, frames = [Slope(qscale_of(44), most=10**6, lasting=3.0)], curtain(0.6, 12)
        if not textured:
            ground = cv2.GaussianBlur(texture(), (0, 0), 4)
            frames = np.stack([np.vstack([f[:38], ground[38:]]) for f in frames])
        ((plate,), _) = self.of(frames, slopes=coarse)
        assert (plate is not None) == textured

    def test_none_before_a_camera_that_moves_slowly(self) -> None:
        (still, moves), _ = self.of(panned(0.2, 12), panned(1.5, 12), share=False)
        assert still is not None
        assert moves is None

    def test_it_is_renewed_when_its_age_costs_more_than_another(self) -> None:
        """The ground becomes another one, a little from chain to chain."""
        goal, plates = texture(4).astype(float), []
        for step in (0.01, 0.15):
            ground = [texture() * (1 - step * n) + goal * step * n for n in range(6)]
            chains = [np.repeat(one[None].round().astype(np.uint8), 12, axis=0) for one in ground]
            plates.append(self.of(*chains)[0])
        assert None not in plates[0] + plates[1]
        assert len(set(plates[0])) == 1
        assert 1 < len(set(plates[1])) < 6


def test_with_key_gops_only_each_has_its_own() -> None:
    with GsvrReader(io.BytesIO(chained(keyint=0, gop=8))) as reader:
        assert all(gop.is_key for gop in reader.gops)
        assert all(parse_gop_head(reader.read_gop(n)).plate for n in range(len(reader.gops)))


def test_a_gop_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is all of its chain has no plate of its own where the chain has none."""
    looked: list[int] = []

    def look(frames: Frames, slope: Slope, _: float | None) -> None:
        looked.append(len(frames))

    monkeypatch.setattr("gsvrcodec.encoder.gop.gop_plate", look)
    turned = np.vstack([texture(1)[:58], texture()[58:]])
    changing = np.stack([texture()] * 12 + [turned] * 12)
    encoded(changing, keyint=0)
    assert looked == []
    encoded(changing)
    assert looked
    assert set(looked) == {8}


def test_a_camera_that_was_pushed_has_another() -> None:
    """From one chain to the next, the ground moves on by some pixels."""
    pushed = film(36)
    pushed[12:] = np.roll(pushed[12:], 5, axis=2)
    with GsvrReader(io.BytesIO(chained(pushed, gop=6, keyint=12 / 30))) as reader:
        assert [gop.reference_frame for gop in reader.gops] == [0, 0, 12, 12, 12, 12]


def test_chains_that_share_one_are_the_same_however_they_are_made(tmp_path: Path) -> None:
    source, target = tmp_path / "a.mkv", tmp_path / "a.gsvr"
    write_video(source, list(FILM))
    options: dict[str, Any] = {"gop": 4, "keyint": 8, "preset": "fastest"}
    whole = gsvrcodec.encode(source, None, workers=1, **options).data
    assert gsvrcodec.encode(source, None, workers=2, **options).data == whole

    class Stop(Exception):
        pass

    def stop(state: Progress) -> None:
        if state.gop == 3:
            raise Stop

    with pytest.raises(Stop):
        gsvrcodec.encode(source, target, progress=stop, workers=1, **options)
    result = gsvrcodec.encode(source, target, resume=True, verify=True, workers=1, **options)
    assert (result.gops, result.key_gops) == (6, 1)
    assert target.read_bytes() == whole


def test_it_shows_what_later_gops_uncover() -> None:
    """The box waits for a GOP: its place in the plate is that of the frames after it."""
    waiting = np.concatenate([np.repeat(FILM[:1], 8, axis=0), FILM])
    with GsvrReader(io.BytesIO(encoded(waiting))) as reader:
        plate = unpack_gop(reader.read_gop(0), None, Limits()).plate
    assert plate is not None
    box = np.s_[30:54, :24]
    assert psnr(unpack_plate(plate).shown()[box], texture()[box]) > 25


def test_the_static_layer_has_it(with_plate: bytes) -> None:
    static, dynamic = (shown(with_plate, layers=layers) for layers in ("static", "dynamic"))
    far = np.s_[0, 70:]  # where the box never is
    assert psnr(static[far], texture()[70:]) > 30
    assert psnr(dynamic[far], texture()[70:]) < 15


@pytest.mark.parametrize("size", [(80, 48), (320, 192), (100, 100)])
def test_sizes(with_plate: bytes, size: tuple[int, int]) -> None:
    with gsvrcodec.open(with_plate) as decoder:
        found = decoder.render(Fraction(4, 30), size)
    wanted = cv2.resize(FILM[4], size, interpolation=cv2.INTER_AREA)
    assert psnr(found, wanted) > 27


def test_the_same_in_any_process(with_plate: bytes) -> None:
    assert encoded(threads=1) == with_plate
    assert encoded(workers=2, threads=1) == with_plate


@pytest.mark.parametrize("options", [{"gaussians": 300}, {"profile": "paper"}])
def test_only_slopes_have_them(options: dict[str, Any]) -> None:
    if options.get("profile") == "paper":
        options = {**options, "gaussians": 300}
    with GsvrReader(io.BytesIO(encoded(**options))) as reader:
        assert not reader.header.plates


def test_streams_announce_them(with_plate: bytes) -> None:
    """A stream says so before its first GOP is known."""

    class Pipe(io.BytesIO):
        def seekable(self) -> bool:
            return False

    pipe = Pipe()
    gsvrcodec.encode(FILM, pipe, fps=30, gop=8, preset="fastest", workers=1, threads=2)
    with GsvrReader(io.BytesIO(pipe.getvalue())) as reader:
        assert reader.header.stream
        assert reader.header.plates
    assert np.array_equal(shown(pipe.getvalue()), shown(with_plate))


def test_older_decoders_refuse_them(with_plate: bytes) -> None:
    """What is unknown among the flags that must be understood is said with its number."""
    with pytest.raises(UnsupportedError, match="flags 0x00000002"):
        gsvrcodec.open(patched(with_plate, b"HEAD", 4, "I", 3))
