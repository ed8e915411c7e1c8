"""The decoder: random access to the frames of a .gsvr file, and pictures at any time."""

from __future__ import annotations

import logging
import operator
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import groupby, islice, zip_longest
from math import ceil, floor, prod
from types import TracebackType
from typing import Self, overload

import numpy as np

from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.source import Readable
from gsvrcodec.bitstream.tags import StreamTags
from gsvrcodec.decoder.frames import Frame, FrameBatch, Metadata
from gsvrcodec.decoder.gop_cache import GopCache
from gsvrcodec.decoder.pictures import PictureMaker, RequestedSize, picture_size
from gsvrcodec.errors import CorruptError, LimitError, UsageError
from gsvrcodec.limits import Limits
from gsvrcodec.model.layers import Layers
from gsvrcodec.render import Codes, backend_on
from gsvrcodec.render.device import choose_device

_log = logging.getLogger(__name__)

#: Most frames, and most bytes of frames, rendered in one batch while iterating.
_BATCH_FRAMES = 16
_BATCH_BYTES = 32 * 2**20


class Decoder:
    """The frames of a .gsvr file, as `open` returns it. Thread-safe.

    Of a pipe, `frames` yields what comes; all that needs to know its end waits for it.
    """

    def __init__(
        self,
        reader: GsvrReader,
        gops: GopCache,
        maker: PictureMaker,
        limits: Limits,
        *,
        keep_going: bool,
    ) -> None:
        """Take the parts that `open` has put together."""
        self._reader, self._gops, self._maker = reader, gops, maker
        self._limits, self._keep_going = limits, keep_going
        self._known = Metadata.of(reader)
        self.lost_frames = 0  #: pictures left out by iteration with `keep_going`

    def __enter__(self) -> Self:
        """Return the decoder itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file; later requests for frames raise `ValueError`."""
        self._gops.close()

    @property
    def metadata(self) -> Metadata:
        """Properties of the whole video."""
        self.wait_for(None)
        return self.known

    @property
    def known(self) -> Metadata:
        """Properties of the video as far as it is known: of a pipe, of the GOPs that came."""
        if self._known.gops != len(self._reader.gops):
            self._known = self._known.extended(self._reader)
        return self._known

    @property
    def complete(self) -> bool:
        """Whether all frames are known: not while a pipe may bring more."""
        return self._reader.complete

    def wait_for(self, frames: int | None) -> int:
        """Wait until so many frames of a pipe are known.

        Args:
            frames: Number of frames; None = all.

        Returns:
            The number of frames that are known.

        Raises:
            CorruptError: The pipe is damaged or cut short, and `keep_going` is not set.
        """
        while (frames is None or self._reader.frames < frames) and self._reader.grow():
            pass
        _check_whole(self._reader, keep_going=self._keep_going)
        return self._reader.frames

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the decoded pictures, pixels."""
        return self._maker.size

    @property
    def bit_depth(self) -> int:
        """Bits a sample of the decoded pictures."""
        return self._maker.bit_depth

    @property
    def batch(self) -> int:
        """Pictures rendered in one batch, and held in memory, while iterating."""
        picture_bytes = 3 * prod(self.size) * (1 if self.bit_depth == 8 else 2)
        return max(1, min(_BATCH_FRAMES, _BATCH_BYTES // picture_bytes))

    @property
    def recovered(self) -> bool:
        """Whether the file is cut short or damaged; only `keep_going` opens such a file."""
        return self._reader.recovered

    @property
    def warnings(self) -> tuple[str, ...]:
        """Faults of the file that do not prevent decoding."""
        return self._reader.warnings

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.wait_for(None)

    @overload
    def __getitem__(self, key: int) -> Frame: ...
    @overload
    def __getitem__(self, key: slice) -> FrameBatch: ...
    def __getitem__(self, key: int | slice) -> Frame | FrameBatch:
        """Return frame `key`, from the end if negative, or the frames of a slice."""
        if isinstance(key, slice):
            return self.get_frames_at(range(*key.indices(len(self))))
        try:
            number = operator.index(key)
        except TypeError:
            raise TypeError(f"a frame is a whole number or a slice, not {key!r}") from None
        return self.get_frame_at(number)

    def __iter__(self) -> Iterator[Frame]:
        """Yield all frames in order."""
        return self.frames()

    def get_frame_at(self, index: int) -> Frame:
        """Return one frame.

        Args:
            index: Number of the frame, from 0; -1 = the last.

        Returns:
            The frame.

        Raises:
            IndexError: `index` is out of range.
            CorruptError: The GOP of the frame, or one that it is predicted from, is damaged.
            ValueError: The decoder is closed.
        """
        return self.get_frames_at([index])[0]

    def get_frames_at(self, indices: Sequence[int]) -> FrameBatch:
        """Return frames in the order of `indices`; repeats are fine. Raises as `get_frame_at`."""
        self._gops.check_open()
        numbers = [self._number(index) for index in indices]
        count = len(numbers)
        data = self._maker.empty(count, self.size)
        pts, durations = np.empty(count, np.int64), np.empty(count, np.int64)
        start = 0
        for position, group in groupby(numbers, self._reader.gop_of_frame):
            gop = self._gops.get(position)
            inside = np.fromiter(group, np.int64) - gop.first_frame
            part = slice(start, start + len(inside))
            pts[part], durations[part] = gop.pts[inside], gop.durations[inside]
            self._maker.frames(gop, inside, self.size, data[part])
            start = part.stop
        base = self._reader.header.time_base
        return FrameBatch(
            data=self._maker.given(data),
            index=np.array(numbers, np.int64),
            pts=pts,
            duration=durations,
            pts_seconds=np.array([float(tick * base) for tick in pts.tolist()]),
            duration_seconds=np.array([float(tick * base) for tick in durations.tolist()]),
        )

    def get_frame_played_at(self, seconds: float | Fraction) -> Frame:
        """Return the frame shown at a time.

        Args:
            seconds: The time, on the clock of the timestamps.

        Returns:
            The frame.

        Raises:
            ValueError: The video shows no frame at that time, or the decoder is closed.
        """
        return self.get_frame_at(self._played_at(seconds))

    def get_frames_played_in_range(
        self, start_seconds: float | Fraction, stop_seconds: float | Fraction
    ) -> FrameBatch:
        """Return the frames shown in a part of the video.

        Args:
            start_seconds: The first time, on the clock of the timestamps.
            stop_seconds: The time up to which, but not at which.

        Returns:
            The frames in order; none if both times are the same.

        Raises:
            ValueError: The stop is before the start, or the range exceeds the video.
        """
        ticks = self.metadata.ticks(stop_seconds)
        if start_seconds > stop_seconds or ticks > self.metadata.ticks(self.metadata.end_seconds):
            raise ValueError(f"{start_seconds} s to {stop_seconds} s: {self.metadata.span}")
        first = self._played_at(start_seconds)
        if start_seconds == stop_seconds:
            return self.get_frames_at([])
        last = self._gops.frame_at(ceil(ticks) - 1)
        return self.get_frames_at(range(first, last + 1))

    def streams(self) -> Iterator[tuple[StreamTags, bytes]]:
        """Yield tags and bytes of each copied sound and subtitle stream.

        The bytes are a MP4, QuickTime, Matroska or NUT file with that one stream, on the clock of
        the frames' timestamps. A damaged stream is left out with a warning, and so is one that has
        not come yet by a pipe.
        """
        self._gops.check_open()
        for tags, chunk in zip_longest(self.known.tags.streams, self._reader.streams):
            if chunk is not None:
                try:
                    yield tags or StreamTags(), self._reader.read_chunk(chunk)
                except (CorruptError, LimitError) as error:
                    _log.warning("a copied stream is left out: %s", error)

    def render(self, seconds: float | Fraction, size: RequestedSize | None = None) -> Codes:
        """Return the picture at any time, also between frames.

        At the timestamp of a frame this is the frame; between two frames of a GOP the Gaussians are
        rendered at that time. Between the last frame of a GOP and the first frame of the next GOP
        the Gaussians go in a straight line if the next GOP is predicted from this one; otherwise
        the two frames are cross-faded, or the last frame is held if a cut lies between them.

        Args:
            seconds: From the start of the first frame up to, but not at, the end of the last; a
                fraction for times that a float cannot express.
            size: Width and height in pixels, -1 = keep the aspect ratio; or a factor for both;
                None = the size of the decoder.

        Returns:
            (H, W, 3), uint8, or uint16 for a bit depth over 8; an array or a tensor, see `open`.

        Raises:
            CorruptError: The GOP, or one that it is predicted from, is damaged.
            LimitError: The size is over the limits.
            UsageError: The size is invalid.
            ValueError: The video shows no frame at that time, or the decoder is closed.
        """
        picture: Codes = self.render_many([seconds], size)[0]
        return picture

    def render_many(
        self, seconds: Iterable[float | Fraction], size: RequestedSize | None = None
    ) -> Codes:
        """Return the pictures at several times, (F, H, W, 3), in that order; see `render`."""
        self._gops.check_open()
        pixels = self.size
        if size is not None:
            pixels = picture_size(size, self._maker.coded_size, self._limits)
        ticks = [self.metadata.shown(moment) for moment in seconds]
        data, start = self._maker.empty(len(ticks), pixels), 0
        for (position, between), group in groupby(ticks, self._place):
            gop, moments = self._gops.get(position), list(group)
            part = data[start : start + len(moments)]
            if between:
                following = self._gops.get(position + 1)
                self._maker.between(gop, following, moments, pixels, part)
            else:
                self._maker.moments(gop, moments, pixels, part)
            start += len(moments)
        return self._maker.given(data)

    def rendered(self, seconds: Iterable[float | Fraction]) -> Iterator[tuple[int, Codes]]:
        """Yield number and picture for each time in `seconds`, with one batch in memory.

        With `keep_going`, pictures of damaged GOPs are left out and counted in `lost_frames`.
        """
        self._gops.check_open()
        numbered = enumerate(map(self.metadata.shown, seconds))
        base = self._reader.header.time_base
        for (position, _), group in groupby(numbered, lambda one: self._place(one[1])):
            while batch := list(islice(group, self.batch)):
                self._gops.prefetch(position)
                numbers, ticks = zip(*batch, strict=True)
                try:
                    pictures = self.render_many([tick * base for tick in ticks])
                except CorruptError as error:
                    first, last = (float(tick * base) for tick in (ticks[0], ticks[-1]))
                    self._lose(len(batch), f"pictures from {first:.6g} s to {last:.6g} s", error)
                else:
                    yield from zip(numbers, pictures, strict=True)

    def starts_at(self, index: int) -> Fraction:
        """Return the timestamp of a frame, seconds. Raises as `get_frame_at`."""
        self._gops.check_open()
        number = self._number(index)
        gop = self._reader.gop_of_frame(number)
        entry, base = self._reader.gops[gop], self._reader.header.time_base
        if number == entry.first_frame:
            return entry.start_pts * base
        return int(self._gops.get(gop).pts[number - entry.first_frame]) * base

    def first_frame_from(self, seconds: float | Fraction) -> int:
        """Return the first frame that starts at a time or later.

        Args:
            seconds: The time, on the clock of the timestamps.

        Returns:
            The number of the frame; `len(self)` if none does.

        Raises:
            CorruptError: The GOP shown at that time is damaged.
            ValueError: The time is not finite, or the decoder is closed.
        """
        self._gops.check_open()
        ticks = ceil(self.metadata.ticks(seconds))
        if ticks <= self._reader.gops[0].start_pts:
            return 0
        return self._gops.frame_at(ticks - 1) + 1

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        """Yield frames `start` up to `stop`, None = to the end, with one batch in memory.

        Frames of a pipe are yielded as they come. With `keep_going`, damaged and lost frames are
        left out and counted in `lost_frames`.
        """
        self._gops.check_open()
        batch = self.batch
        while (stop is None or start < stop) and start < self.wait_for(start + 1):
            stop_now = self._reader.frames if stop is None else min(stop, self._reader.frames)
            end = min(self._gops.run_end(start), start + batch, stop_now)
            try:
                if self._gops.run_end(start) < stop_now:
                    self._gops.prefetch(self._reader.gop_of_frame(start))
                frames = self.get_frames_at(range(start, end))
            except CorruptError as error:
                end = min(self._gops.run_end(start), stop_now)
                self._lose(end - start, f"frames {start} to {end - 1}", error)
            else:
                yield from frames
            start = end

    def _place(self, ticks: Fraction) -> tuple[int, bool]:
        """Return the position of the GOP at a time, and whether its last frame is over."""
        return self._gops.position_at(ticks), self._gops.is_between(ticks)

    def _lose(self, count: int, what: str, error: CorruptError) -> None:
        """With `keep_going`, count lost pictures and warn; otherwise raise `error`."""
        if not self._keep_going:
            raise error
        self.lost_frames += count
        _log.warning("%s are left out: %s", what, error)

    def _number(self, index: int) -> int:
        """Return the frame number, from 0, for an index that may be negative."""
        number = index + len(self) if index < 0 else index
        known = self.wait_for(number + 1)
        if not 0 <= number < known:
            raise IndexError(f"frame {index} of a video of {known} frames")
        return number

    def _played_at(self, seconds: float | Fraction) -> int:
        """Return the number of the frame shown at a time."""
        self._gops.check_open()
        return self._gops.frame_at(floor(self.metadata.shown(seconds)))


def open(
    source: Readable,
    *,
    size: RequestedSize | None = None,
    layers: Layers = "all",
    bit_depth: int | None = 8,
    threads: int = 0,
    device: str = "cpu",
    arrays: bool = False,
    tensors: bool = False,
    planar: bool = False,
    limits: Limits | None = None,
    keep_going: bool = False,
) -> Decoder:
    """Open a .gsvr file for decoding.

    Args:
        source: Path; "-" = the standard input; URL, by fsspec; bytes; or a binary file object,
            which stays open. What cannot be sought in, such as a pipe, is kept in a temporary file
            as it comes.
        size: Size of the pictures: width and height in pixels, where -1 keeps the aspect ratio and
            -2 also rounds to an even number; or a factor for both; None = as coded.
        layers: Gaussians to draw: "dynamic" = those that move against the median motion of their
            GOP, "static" = all others, or "all".
        bit_depth: Bits a sample, 8 to 16; None = 8, or 10 for a source of more than 8. Pictures
            are uint8, or uint16 for more than 8 bits.
        threads: Threads for rendering; 0 = GSVR_THREADS or all cores. Does not change the pictures.
            With 1, GOPs too are unpacked in the thread that asks for frames.
        device: Device for rendering: "cpu", "cuda", "cuda:N", or "auto" = the first usable GPU,
            else the CPU. A GPU renders to torch tensors in its memory.
        arrays: Copy the pictures of a GPU to NumPy arrays.
        tensors: Also give the pictures of the CPU as torch tensors, without a copy; this alone
            imports torch.
        planar: Keep each channel of an 8-bit picture of the CPU together in memory. Pictures have
            the same shape, (F, H, W, 3), and seen as (F, 3, H, W) they are contiguous.
        limits: Limits on the content; None = the defaults, or those of the environment.
        keep_going: Also open a file that is cut short, and leave out damaged GOPs when iterating.

    Returns:
        The decoder, to be closed, as by a `with` block.

    Raises:
        InputError: The file cannot be read.
        NotGsvrError: The file does not start with the signature.
        CorruptError: The file is damaged.
        UnsupportedError: The file needs a feature that this version does not have, or is over
            `limits`.
        UsageError: Size, bit depth, layers or device is invalid, or arguments exclude each other.
        DeviceError: The requested GPU is not usable.
    """
    if arrays and tensors:
        raise UsageError("`arrays` and `tensors` exclude each other; give one")
    device = choose_device(device)
    limits = limits or Limits.from_environment()
    reader = GsvrReader(source, limits)
    try:
        _check_whole(reader, keep_going=keep_going)
        header = reader.header
        coded = header.width, header.height
        if bit_depth is None:
            bit_depth = 8 if header.bit_depth <= 8 else 10
        maker = PictureMaker(
            coded_size=coded,
            size=picture_size(size, coded, limits),
            layers=layers,
            bit_depth=bit_depth,
            backend=backend_on(device, threads, header.blending),
            tensors=tensors or (device != "cpu" and not arrays),
            planar=planar,
        )
        gops = GopCache(reader, limits, maker.prepare, ahead=threads != 1)
        return Decoder(reader, gops, maker, limits, keep_going=keep_going)
    except BaseException:
        reader.close()
        raise


def _check_whole(reader: GsvrReader, *, keep_going: bool) -> None:
    """Raise a CorruptError for a file that is cut short, unless `keep_going` is set."""
    if reader.recovered and not keep_going:
        found = sum(entry.frames for entry in reader.gops)
        raise CorruptError(
            f"the file is cut short or damaged: {reader.warnings[0]}; "
            f"{found} frames were found, which `keep_going=True` decodes"
        )
