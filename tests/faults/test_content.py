"""Faults 10 to 18: sound bytes that say what cannot be."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from contextlib import nullcontext
from typing import get_args

import imagecodecs
import numpy as np
import pytest

from gsvrcodec.bitstream.chunk import (
    GOP_TYPE,
    HEAD_BYTES,
    HEAD_TYPE,
    SIGNATURE,
    chunk_bytes,
)
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, SUMMARY_BYTES
from gsvrcodec.errors import CorruptError, GsvrError, LimitError, UnsupportedError
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.quantise import step_number
from gsvrcodec.model.reconstruction import CUTOFF, GROUND, MOST_LOG_OPACITY, Blending
from gsvrcodec.native import _core
from gsvrcodec.render.native import NativeBackend
from gsvrcodec.render.reference import ReferenceBackend
from tests import memory
from tests.faults.small import FILE, FIRST, HEAD, opened
from tests.gops import (
    HEADER,
    decode_all,
    make_carried,
    make_chain,
    make_file,
    make_gop,
    make_payload,
)
from tests.tampering import (
    MODES,
    Piece,
    edited,
    joined,
    patched,
    pieces,
    with_plane,
)


class TestHeader:
    """Faults 10, 11, 12 and 16."""

    @pytest.mark.parametrize(("frames", "gops"), [(1, 3), (2**64 - 1, 3), (9, 1), (9, 2**32 - 1)])
    def test_counts_that_lie_lose_to_the_content(self, frames: int, gops: int) -> None:
        reader = opened(patched(FILE, HEAD_TYPE, 58, "QI", frames, gops))
        assert reader.frames == 9
        assert len(reader.gops) == 3
        assert len(reader.warnings) == 1
        assert "the header says" in reader.warnings[0]

    @pytest.mark.parametrize(
        "chunks", [[FIRST], [FIRST, HEAD], [HEAD, HEAD, FIRST], [HEAD, FIRST, HEAD]]
    )
    def test_missing_late_or_second(self, chunks: list[Piece]) -> None:
        for reindex in (False, True):
            with pytest.raises(CorruptError, match=r"expected HEAD|second header"):
                opened(joined(chunks, reindex=reindex))

    @pytest.mark.parametrize(
        ("offset", "layout", "value"), [(44, "I", 3), (48, "I", 2), (44, "I", 0), (48, "I", 0)]
    )
    def test_a_gop_over_the_maxima_is_refused(self, offset: int, layout: str, value: int) -> None:
        data = patched(FILE, HEAD_TYPE, offset, layout, value)
        with pytest.raises(CorruptError, match=r"chunk GOPD at byte \d+: .*the header's maximum"):
            decode_all(data)

    def test_a_triplane_over_the_maxima_is_refused(self) -> None:
        good = make_file([make_payload(4, (3, 2, 5))])
        for offset, value in ((52, 2), (54, 1), (56, 4)):
            with pytest.raises(CorruptError, match="tri-plane of"):
                decode_all(patched(good, HEAD_TYPE, offset, "H", value))

    @pytest.mark.parametrize("start_pts", [0, 79, 80, -(2**61)])
    def test_timestamps_that_do_not_increase_are_refused(self, start_pts: int) -> None:
        second = make_payload(4, first_frame=3, start_pts=start_pts)
        reader = opened(joined([HEAD, FIRST, Piece(GOP_TYPE, second)]))
        assert reader.recovered
        assert len(reader.gops) == 1
        assert "does not come after" in " ".join(reader.warnings)


def gop_file(plane: int, data: bytes, **fields: int) -> bytes:
    """A file of one GOP of 6 Gaussians (3 by 2) with one plane replaced."""
    payload = with_plane(make_payload(6), plane, data, **fields)
    return make_file([payload])


class TestPlanes:
    """Faults 13, 14 and 17."""

    @pytest.mark.parametrize("pixels", [np.zeros((2, 4)), np.zeros((3, 2)), np.zeros((2, 3, 3))])
    @pytest.mark.parametrize("codec", [2, 3])
    def test_another_size_or_colour(self, codec: int, pixels: np.ndarray) -> None:
        stored = pixels.astype(np.uint8)
        data = imagecodecs.png_encode(stored) if codec == 2 else imagecodecs.jpegxl_encode(stored)
        with pytest.raises(CorruptError, match=r"plane position\.0"):
            decode_all(gop_file(0, bytes(data), codec=codec, bits=8))

    def test_trailing_bytes_and_a_missing_end(self) -> None:
        png = bytes(imagecodecs.png_encode(np.zeros((2, 3), np.uint8)))
        assert decode_all(gop_file(0, png, codec=2, bits=8, first=0, step=step_number(1)))
        for data in (png + b"\0", png[:-12], png[:-1]):
            with pytest.raises(CorruptError, match="PNG"):
                decode_all(gop_file(0, data, codec=2, bits=8, first=0, step=step_number(1)))

    @pytest.mark.parametrize("fields", [{"step": 2**16 - 1}, {"first": 2**31 - 1}])
    @pytest.mark.parametrize("plane", range(14))
    def test_steps_and_first_values_that_are_enormous(
        self, plane: int, fields: dict[str, int]
    ) -> None:
        with pytest.raises(CorruptError, match="allowed is"):
            decode_all(gop_file(plane, b"", **fields))

    @pytest.mark.parametrize("fields", [{"first": 2**31}, {"size": 2**32}, {"size": 2**62}])
    def test_numbers_of_more_than_32_bits(self, fields: dict[str, int]) -> None:
        with pytest.raises(CorruptError, match="more than 32 bits in a plane table"):
            decode_all(gop_file(0, b"", **fields))

    def test_extreme_gaussians_stay_within_bounds(self) -> None:
        # Plane 2 is log_scale.0: exp(13) is the largest sigma that a file can ask for.
        fields = {"codec": 0, "bits": 1, "step": step_number(1)}
        with pytest.raises(CorruptError, match="spans 13 to 14, allowed is -32 to 13"):
            decode_all(gop_file(2, b"\0\0", first=13, **fields))
        (content,) = decode_all(gop_file(2, b"\1\0", first=12, **fields))
        assert content.gop.log_scale[:, 0].tolist() == [13] * 6

    def test_no_gaussian_is_valid(self) -> None:
        (content,) = decode_all(make_file([make_payload(0)]))
        assert len(content.gop) == 0

    def test_no_gaussian_with_planes_is_refused(self) -> None:
        data = patched(make_file([make_payload(4)]), GOP_TYPE, 12, "I", 0)
        with pytest.raises(CorruptError, match="14 planes, expected 0"):
            decode_all(data)


class TestOpacities:
    """Weights that are vast, that vanish, or that hide all others."""

    SIZE = (40, 30)

    @classmethod
    def pictures(cls, gop: Gop, blending: Blending = "mean") -> Iterator[Float32Array]:
        """The first, middle and last picture, by the kernels of every instruction set."""
        before = _core.isa()
        try:
            for isa in _core.isas():
                _core.use_isa(isa)
                backend = NativeBackend(1, blending)
                prepared = backend.prepare(gop)
                for tau in (-1.0, 0.0, 1.0):
                    yield backend.picture(prepared, tau, cls.SIZE, cls.SIZE)
        finally:
            _core.use_isa(before)

    @classmethod
    def covering(cls, log_opacity: float, seed: int = 0) -> Gop:
        """Gaussians that stand still, each larger than the frame, with one opacity."""
        gop = make_gop(200, seed=seed)
        gop.position[:] /= 100
        gop.log_scale[:] = np.log(200)
        gop.linear[:] = gop.quadratic[:] = 0
        gop.colour[:] = gop.colour.clip(0, 1)
        gop.log_opacity[:] = log_opacity
        return gop

    @pytest.mark.parametrize("bound", [-MOST_LOG_OPACITY, MOST_LOG_OPACITY])
    def test_over_the_bounds(self, bound: float) -> None:
        # Plane 8 is log_opacity, and plane 9 behind the modes its change.
        fields = {"codec": 0, "bits": 1, "step": step_number(1)}
        code = bytes([bound > 0, 0])  # the greater of two where the bound is the greatest
        with pytest.raises(CorruptError, match=r"log_opacity spans .* allowed is -12 to 12"):
            decode_all(gop_file(8, code, first=int(bound) - (bound < 0), **fields))
        (content,) = decode_all(gop_file(8, code, first=int(bound) - (bound > 0), **fields))
        assert content.gop.log_opacity.tolist() == [bound] * 6
        key, predicted = make_chain((3, 3))
        for outside in (False, True):
            first = int(2 * bound) - (bound < 0 if outside else bound > 0)
            change = with_plane(predicted, MODES + 9, code, first=first, **fields)
            with pytest.raises(CorruptError, match="is -24 to 24") if outside else nullcontext():
                decode_all(make_file([key, change]))

    @pytest.mark.parametrize("blending", get_args(Blending))
    @pytest.mark.parametrize("seed", range(8))
    def test_no_picture_of_values_at_their_bounds_is_infinite_or_nan(
        self, seed: int, blending: Blending
    ) -> None:
        draw = np.random.default_rng(seed)
        gop = make_gop(300, (3, 2, 4), seed, blending)
        for attribute in ATTRIBUTES:
            values = getattr(gop, attribute.name)
            ends = draw.choice([attribute.low, attribute.high], values.shape)
            at_bound = draw.random(values.shape) < draw.choice([0.02, 0.5])
            values[at_bound] = ends[at_bound]
        for picture in self.pictures(gop, blending):
            assert np.isfinite(picture).all()

    def test_all_opacities_at_the_upper_bound_are_their_mean(self) -> None:
        gop, plain = self.covering(MOST_LOG_OPACITY), self.covering(0)
        backend = ReferenceBackend()
        wanted = backend.picture(backend.prepare(plain), 0.0, self.SIZE, self.SIZE)
        for picture in self.pictures(gop):
            np.testing.assert_allclose(picture, wanted, atol=1e-4)

    def test_weights_that_vanish_leave_the_ground(self) -> None:
        gop = self.covering(-MOST_LOG_OPACITY)
        gop.colour[:] = 1
        for picture in self.pictures(gop):
            weight = 200 * np.exp(-MOST_LOG_OPACITY) * (1 - CUTOFF)
            np.testing.assert_allclose(picture, weight / (weight + GROUND), rtol=0.05)
        gop.position[:] += 900
        for picture in self.pictures(gop):
            assert not picture.any()

    def test_one_gaussian_hides_all_others_in_the_whole_frame(self) -> None:
        gop = self.covering(0)
        gop.log_opacity[7] = MOST_LOG_OPACITY
        gop.colour[7] = (0.25, 0.5, 0.75)
        for picture in self.pictures(gop):
            np.testing.assert_allclose(picture - gop.colour[7], 0, atol=1 / 255)


class TestBombs:
    """Fault 15: refused in under a second and in little memory."""

    @staticmethod
    def check(data: bytes, error: type[GsvrError], says: str) -> None:
        spans: list[float] = []
        while len(spans) < 3 and min(spans, default=1) >= 1:  # others on a core make one slow
            begin = time.process_time()
            with memory.at_most(256 * 2**20), pytest.raises(error, match=says):
                decode_all(data)
            spans.append(time.process_time() - begin)
        assert min(spans) < 1

    def test_png(self) -> None:
        data = bytes(imagecodecs.png_encode(np.zeros((8192, 8192), np.uint8), level=9))
        self.check(gop_file(0, data, codec=2, bits=8), CorruptError, "PNG header")

    def test_jxl(self) -> None:
        pixels = np.zeros((2048, 2048), np.uint8)
        data = imagecodecs.jpegxl_encode(pixels, lossless=True, effort=1)
        data = bytes(data)[bytes(data).find(b"\xff\x0a") :]
        self.check(gop_file(0, data, codec=3), CorruptError, "2048x2048, expected 3x2")

    def test_planes_that_expand_without_end(self) -> None:
        # A thousand bytes that say 2^24 Gaussians, all planes constant: a gigabyte of values.
        def grow(payload: bytearray) -> None:
            struct.pack_into("<I", payload, 12, 2**24)

        data = edited(make_file([make_payload(1)]), GOP_TYPE, grow)
        data = patched(data, HEAD_TYPE, 44, "I", 2**24)
        self.check(data, LimitError, "would expand to")

    def test_frames_without_end(self) -> None:
        data = patched(make_file([make_payload(1)]), HEAD_TYPE, 48, "I", 2**32 - 2)
        self.check(data, LimitError, "GSVR_LIMIT_GOP_FRAMES")
        unknown = patched(make_file([make_payload(1)]), HEAD_TYPE, 48, "I", 2**32 - 1)
        data = patched(unknown, GOP_TYPE, 8, "I", 2**31)
        self.check(data, LimitError, "GSVR_LIMIT_GOP_FRAMES")

    @pytest.mark.parametrize("reindex", [False, True])
    def test_a_million_unknown_chunks(self, reindex: bool) -> None:
        if reindex:
            chunks = [HEAD, FIRST, *[Piece(b"xabc", b"")] * 70_000]
            data = joined(chunks)
        else:
            data = SIGNATURE + HEAD.to_bytes() + chunk_bytes(b"xabc", b"") * 1_000_000
        self.check(data, LimitError, "GSVR_LIMIT_CHUNKS")

    def test_a_million_tiny_gops(self) -> None:
        tiny = chunk_bytes(GOP_TYPE, make_payload(0, frames=1))
        data = SIGNATURE + HEAD.to_bytes() + tiny * 1_000_000
        self.check(data, LimitError, "GSVR_LIMIT_CHUNKS")

    def test_a_million_damaged_chunk_heads(self) -> None:
        head = b"GOPD" + bytes(HEAD_BYTES - 4)
        data = SIGNATURE + HEAD.to_bytes() + head * 1_000_000
        self.check(data, LimitError, "GSVR_LIMIT_CHUNKS")


class TestPrediction:
    """What a GOP may claim of its reference."""

    PAYLOADS = make_chain((3, 3))
    CHUNKS = pieces(make_file(PAYLOADS))

    def with_second(self, payload: bytes | bytearray) -> bytes:
        """The file with another predicted GOP."""
        return joined([*self.CHUNKS[:2], Piece(GOP_TYPE, bytes(payload))])

    def second(self, offset: int, layout: str, *values: int) -> bytes:
        """The file with fields in the head of its predicted GOP overwritten."""
        payload = bytearray(self.PAYLOADS[1])
        struct.pack_into("<" + layout, payload, offset, *values)
        return self.with_second(payload)

    def test_the_file_is_valid(self) -> None:
        key, predicted = decode_all(joined(self.CHUNKS))
        assert (len(key.gop), len(predicted.gop)) == (30, 24 + 5)
        assert predicted.reference == 0

    def test_a_key_gop_with_carried_gaussians(self) -> None:
        # A distance of 0 frames means no reference: a GOP cannot refer to itself.
        with pytest.raises(CorruptError, match="key GOP that carries 30 Gaussians"):
            decode_all(self.second(40, "I", 0))

    @pytest.mark.parametrize("reference", [1, 2, 4, 2**31, 2**32 - 1])
    def test_a_reference_to_a_later_or_missing_gop(self, reference: int) -> None:
        data = self.second(40, "I", reference)
        reader = opened(data)
        assert reader.recovered
        if reference > 3:
            assert len(reader.gops) == 1
            assert "frames before frame 3" in " ".join(reader.warnings)
        else:
            with pytest.raises(CorruptError, match="is lost, which the GOP at frame 3 is pred"):
                decode_all(data)

    def test_a_reference_of_another_size(self) -> None:
        other = Piece(GOP_TYPE, make_payload(29, (3, 2, 4)))
        with pytest.raises(CorruptError, match="has 29 Gaussians, the GOP expects 30"):
            decode_all(joined([self.CHUNKS[0], other, self.CHUNKS[2]]))

    @pytest.mark.parametrize(
        ("offset", "values"),
        [
            (56, (29,)),
            (56, (2**32 - 1, 2**32 - 1)),
            (56, (2**32 - 1, 2**32 - 25)),
            (60, (31,)),
            (60, (0,)),
            (60, (2**32 - 1,)),
            (64, (25,)),
            (64, (2**32 - 1, 2**32 - 1)),
            (68, (25,)),
            (68, (11,)),
            (12, (2**32 - 1,)),
            (12, (23,)),
        ],
    )
    def test_counts_that_lie_or_overflow(self, offset: int, values: tuple[int, ...]) -> None:
        with pytest.raises((CorruptError, LimitError)):
            decode_all(self.second(offset, f"{len(values)}I", *values))

    def test_counts_that_differ_from_the_modes(self) -> None:
        # One more dropped and one less in all: every plane keeps its size.
        payload = bytearray(self.PAYLOADS[1])
        struct.pack_into("<I", payload, 12, 28)
        struct.pack_into("<I", payload, 60, 7)
        with pytest.raises(CorruptError, match="the GOP's head says 7, 12 and 12"):
            decode_all(self.with_second(payload))

    @pytest.mark.parametrize("mode", [5, 6, 7])
    def test_an_unknown_mode(self, mode: int) -> None:
        payload = with_plane(self.PAYLOADS[1], MODES, bytes([mode, 0]), codec=0)
        with pytest.raises(CorruptError, match=f"mode {mode} of a Gaussian"):
            decode_all(self.with_second(payload))

    @pytest.mark.parametrize("fields", [{"step": step_number(0.5)}, {"first": 1}, {"bits": 2}])
    def test_modes_that_are_no_integers(self, fields: dict[str, int]) -> None:
        payload = with_plane(self.PAYLOADS[1], MODES, b"\1\0", codec=0, **fields)
        with pytest.raises(CorruptError, match="plane mode"):
            decode_all(self.with_second(payload))

    @pytest.mark.parametrize(("offset", "value"), [(44, 29), (48, 2), (54, 1)])
    def test_over_the_header_maxima(self, offset: int, value: int) -> None:
        data = patched(joined(self.CHUNKS), HEAD_TYPE, offset, "H", value)
        with pytest.raises(CorruptError, match="the header's maximum is"):
            decode_all(data)

    def test_a_very_long_chain(self) -> None:
        none = make_carried(np.zeros(0, np.uint8))
        payload = bytearray(
            make_payload(0, frames=1, first_frame=1, start_pts=40, reference=1, carried=none)
        )
        chunks = [Piece(GOP_TYPE, make_payload(0, frames=1))]
        for number in range(1, 1025):
            for offset, value in ((0, number), (16, 40 * number), (24, 40 * number)):
                struct.pack_into("<Q", payload, offset, value)
            chunks.append(Piece(GOP_TYPE, bytes(payload)))
        head = self.CHUNKS[0]
        assert len(decode_all(joined([head, *chunks[:-1]]))) == 1024
        for reindex in (False, True):
            with pytest.raises(LimitError, match="GSVR_LIMIT_CHAIN"):
                opened(joined([head, *chunks], reindex=reindex))

    def test_every_changed_byte_is_refused_or_stays_finite(self) -> None:
        rng = np.random.default_rng(4)
        refused = 0
        for offset in range(len(self.PAYLOADS[1])):
            value = int(rng.integers(1, 256))
            try:
                found = decode_all(self.second(offset, "B", self.PAYLOADS[1][offset] ^ value))
            except GsvrError:
                refused += 1
                continue
            for name in Gop.__slots__:
                assert np.isfinite(getattr(found[-1].gop, name)).all()
        assert refused > 0.3 * len(self.PAYLOADS[1])


class TestVersions:
    """Fault 18."""

    def test_a_newer_minor_version_is_read(self) -> None:
        assert len(decode_all(patched(FILE, HEAD_TYPE, 2, "H", 99))) == 3

    @pytest.mark.parametrize("major", [2, 3, 65535])
    def test_another_major_version_is_unsupported(self, major: int) -> None:
        with pytest.raises(UnsupportedError, match=rf"version {major}\.0, this decoder reads 1\.x"):
            opened(patched(FILE, HEAD_TYPE, 0, "H", major))

    @pytest.mark.parametrize("minor", [1, 6])
    def test_before_the_first_release(self, minor: int) -> None:
        says = rf"version 0\.{minor}, this decoder reads 1\.x .*: encode the video anew"
        with pytest.raises(UnsupportedError, match=says):
            opened(patched(FILE, HEAD_TYPE, 0, "HHI", 0, minor, 13))

    @pytest.mark.parametrize("bit", [1, 4, 31])
    def test_flags(self, bit: int) -> None:
        assert opened(patched(FILE, HEAD_TYPE, 8, "I", 1 << bit)).warnings == ()
        with pytest.raises(UnsupportedError, match="features this decoder does not know"):
            opened(patched(FILE, HEAD_TYPE, 4, "I", 1 << bit))

    @pytest.mark.parametrize("number", [2, 128, 255])
    def test_blendings(self, number: int) -> None:
        with pytest.raises(UnsupportedError, match=rf"this decoder does not know \({number}\)"):
            opened(patched(FILE, HEAD_TYPE, 70, "B", number))

    def test_a_longer_gop_head_of_a_newer_version_is_read(self) -> None:
        def grow(payload: bytearray) -> None:
            payload[SUMMARY_BYTES] += 4
            payload[GOP_HEAD_BYTES:GOP_HEAD_BYTES] = b"more"

        longer = edited(FILE, GOP_TYPE, grow)
        with pytest.raises(CorruptError, match="GOP head of 76 bytes, expected 72"):
            decode_all(longer)
        assert len(decode_all(patched(longer, HEAD_TYPE, 2, "H", 1))) == 3

    @pytest.mark.parametrize("reindex", [False, True])
    def test_unknown_chunks(self, reindex: bool) -> None:
        skipped = joined([HEAD, Piece(b"zABC", b"x"), FIRST], reindex=reindex)
        assert len(decode_all(skipped)) == 1
        with pytest.raises(UnsupportedError, match="chunk Zabc at byte"):
            opened(joined([HEAD, Piece(b"Zabc", b"x"), FIRST], reindex=reindex))

    @pytest.mark.parametrize("codec", range(6, 16))
    def test_an_unknown_codec_is_unsupported(self, codec: int) -> None:
        with pytest.raises(UnsupportedError, match=f"unknown plane codec {codec}"):
            decode_all(gop_file(0, b"", codec=codec))


def test_a_header_alone_is_not_a_video() -> None:
    with pytest.raises(CorruptError, match="no whole GOP"):
        opened(SIGNATURE + chunk_bytes(HEAD_TYPE, HEADER.to_bytes()))
