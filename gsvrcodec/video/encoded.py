"""Writers with a video encoder: H.264 or HEVC in MP4, lossless FFV1 in Matroska."""

from __future__ import annotations

import logging
import sys
from abc import ABC, abstractmethod
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import ColorRange

from gsvrcodec.errors import OutputError
from gsvrcodec.video.colour import MATRIX_RGB, AnyRgb, output_matrix, to_ycbcr, ycbcr_format
from gsvrcodec.video.copies import StreamCopies
from gsvrcodec.video.matroska import set_sample_aspect
from gsvrcodec.video.output import OutputInfo
from gsvrcodec.video.tags import write_tags

_log = logging.getLogger(__name__)

#: Greatest timescale of MP4, ticks a second.
_MAX_TIMESCALE = 2**31 - 1

#: Least side of a picture that x265 accepts, pixels.
_LEAST_HEVC_SIDE = 16

#: Tick of Matroska files, seconds.
_MILLISECOND = Fraction(1, 1000)


class _ContainerWriter(ABC):
    """A file with one video stream, written by FFmpeg; the time base of the source is kept."""

    def __init__(
        self,
        path: Path | None,
        info: OutputInfo,
        *,
        container: str,
        container_options: dict[str, str],
        codec: str,
        codec_options: dict[str, str],
        pixel_format: str,
        matrix: int,
        copies: StreamCopies,
    ) -> None:
        self._info = info
        self._copies = copies
        self._scale = info.time_base.numerator
        self._base = Fraction(1, info.time_base.denominator)
        target = sys.stdout.buffer if path is None else f"file:{path}"
        self._file = av.open(target, "w", format=container, container_options=container_options)
        stream = self._file.add_stream(codec, rate=info.rate, options=codec_options)
        assert isinstance(stream, av.VideoStream)
        self._stream = stream
        self._durations: dict[int, int] = {}
        context = stream.codec_context
        context.width, context.height = info.width, info.height
        context.pix_fmt = pixel_format
        context.time_base = stream.time_base = self._base
        context.sample_aspect_ratio = info.sample_aspect
        context.thread_count = info.threads
        context.color_primaries = info.colour.primaries
        context.color_trc = info.colour.transfer
        context.colorspace = matrix
        full = info.colour.full_range or matrix == MATRIX_RGB
        context.color_range = ColorRange.JPEG if full else ColorRange.MPEG
        if info.mirrored:  # FFmpeg mirrors after turning: the angle changes sign
            stream.set_display_rotation(info.rotation, hflip=True)
        elif info.rotation:
            stream.set_display_rotation(-info.rotation)
        copies.add_to(self._file)
        write_tags(info.tags, self._file, stream, info.span)

    @abstractmethod
    def _frame(self, rgb: AnyRgb) -> av.VideoFrame:
        """Return the picture in the stream's pixel format."""

    def write(self, rgb: AnyRgb, pts: int, duration: int) -> None:
        """Code one picture."""
        frame = self._frame(rgb)
        frame.pts = pts * self._scale
        frame.time_base = self._base
        self._durations[frame.pts] = duration * self._scale
        self._mux(self._stream.encode(frame))

    def close(self) -> None:
        """Finish the file."""
        self._mux(self._stream.encode(None))
        self._copies.write()
        self._copies.close()
        self._file.close()

    def _mux(self, packets: list[av.Packet[av.VideoStream]]) -> None:
        """Write coded pictures with their durations, which encoders do not pass on."""
        for packet in packets:
            if packet.dts is not None:
                self._copies.write(packet.dts * packet.time_base)
            if packet.pts is not None:
                packet.duration = self._durations.pop(packet.pts, 0)
            self._file.mux(packet)

    def abort(self) -> None:
        """Close the unfinished file."""
        try:
            self._file.close()
        except (av.FFmpegError, OSError) as error:
            _log.debug("closing an unfinished output: %s", error)


class Mp4Writer(_ContainerWriter):
    """Near-lossless H.264 in MP4, or HEVC for 10 bits; timestamps are exact."""

    def __init__(self, path: Path | None, info: OutputInfo) -> None:
        """Create the file at `path`."""
        assert path is not None
        if info.time_base.denominator > _MAX_TIMESCALE:
            raise OutputError(f"a time base of {info.time_base} s is too fine for .mp4; use .mkv")
        self._format = ycbcr_format(info.width, info.height, info.bit_depth)
        codec = "libx264"
        options = {
            "crf": str(info.crf),
            "preset": info.codec_preset or "veryfast",
            # Without B-frames the duration of each sample in the file is its display duration.
            "bf": "0",
            # Optimise PSNR, not perceived quality; no lower quality for unreferenced blocks.
            "x264-params": "mbtree=0:psy=0",
        }
        if info.bit_depth > 8 and min(info.width, info.height) >= _LEAST_HEVC_SIDE:
            codec = "libx265"
            # With blocks of 16 pixels ultrafast takes a third of the time of veryfast, for 4 % more
            # bits and 0.9 dB less at 55 dB.
            options["preset"] = info.codec_preset or "ultrafast"
            options["x265-params"] = (
                "bframes=0:cutree=0:psy-rd=0:psy-rdoq=0:log-level=none"
                f"{'' if info.codec_preset else ':ctu=16'}"
                f"{':lossless=1' if info.crf == 0 else ''}"
                f"{f':pools={info.threads}' if info.threads else ''}"
            )
        copies = StreamCopies(info.streams, info.span)
        timescale = info.time_base.denominator
        super().__init__(
            path,
            info,
            container="mp4",
            # FFmpeg's default timescales round the start of the film to milliseconds.
            container_options={
                "video_track_timescale": str(timescale),
                "movie_timescale": str(copies.timescale(timescale, _MAX_TIMESCALE)),
                "movflags": "+faststart",
            },
            codec=codec,
            codec_options=options,
            pixel_format=self._format,
            matrix=output_matrix(info.colour),
            copies=copies,
        )

    def _frame(self, rgb: AnyRgb) -> av.VideoFrame:
        """Return the picture as YCbCr."""
        return to_ycbcr(rgb, self._format, self._info.colour)


class Ffv1Writer(_ContainerWriter):
    """Lossless FFV1 of the RGB samples in Matroska; timestamps are rounded to milliseconds."""

    def __init__(self, path: Path | None, info: OutputInfo) -> None:
        """Create the file at `path`; None = standard output."""
        self._warned = False
        self._path = path
        super().__init__(
            path,
            info,
            container="matroska",
            # Audio that starts before the video must not shift the timestamps of the video.
            container_options={
                "avoid_negative_ts": "disabled",
                # `set_sample_aspect` changes the file without updating checksums.
                "write_crc32": str(int(info.sample_aspect == 1)),
                "live": str(int(path is None)),
            },
            codec="ffv1",
            codec_options={"level": "3", "slicecrc": "1"},
            pixel_format="bgr0" if info.bit_depth == 8 else f"gbrp{info.bit_depth}le",
            matrix=MATRIX_RGB,
            copies=StreamCopies(info.streams, info.span),
        )

    def write(self, rgb: AnyRgb, pts: int, duration: int) -> None:
        """Code one picture."""
        if not self._warned and (pts * self._info.time_base) % _MILLISECOND:
            _log.warning("timestamps are rounded to milliseconds in .mkv; .mp4 keeps them exact")
            self._warned = True
        super().write(rgb, pts, duration)

    def close(self) -> None:
        """Finish the file."""
        super().close()
        size, aspect = (self._info.width, self._info.height), self._info.sample_aspect
        if aspect == 1:
            return
        if self._path is None or not set_sample_aspect(self._path, size, aspect):
            _log.warning("pixels of %s are shown square in .mkv; use .mp4", aspect)

    def _frame(self, rgb: AnyRgb) -> av.VideoFrame:
        """Return the RGB samples; 8-bit samples with a byte of padding after each pixel."""
        if rgb.dtype == np.uint16:
            frame = av.VideoFrame.from_ndarray(
                np.ascontiguousarray(rgb, np.uint16), format="gbrp10le"
            )
            frame.color_range = ColorRange.JPEG
            return frame
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb, np.uint8), format="rgb24")
        frame.color_range = ColorRange.JPEG
        return frame.reformat(format="bgr0")
