"""Rate and distortion of a .gsvr file, measured against its source video."""

from __future__ import annotations

import csv
import io
import json
import logging
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gsvrcodec.decoder.decoder import open as open_gsvr
from gsvrcodec.decoder.frames import Metadata
from gsvrcodec.errors import UsageError
from gsvrcodec.report.quality import PictureQuality, Quality
from gsvrcodec.video.read import Crop, VideoReader, open_video

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameQuality:
    """Quality of one decoded frame against the source frame."""

    frame: int  #: frame number, from 0
    pts: int  #: presentation timestamp, ticks of the file's time base
    seconds: float  #: presentation timestamp, seconds
    psnr_rgb: float  #: over the 8-bit RGB samples, dB
    ssim: float | None  #: of luma; None = the picture is too small
    ms_ssim: float | None  #: of luma; None = the picture is too small


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Rate and distortion of a .gsvr file."""

    source: str  #: path of the source video
    file: str  #: path of the .gsvr file
    width: int  #: pixels
    height: int  #: pixels
    gops: int  #: GOPs in the file
    bytes: int  #: size of the whole file
    bpp: float  #: bits a pixel and frame, without copied streams
    psnr_rgb: float  #: mean of the frames' PSNR, dB
    psnr_rgb_pooled: float  #: PSNR of the mean squared error of all frames, dB
    psnr_rgb_min: float  #: PSNR of the worst frame, dB
    ssim: float | None  #: mean of the frames; None = the frames are too small
    ms_ssim: float | None  #: mean of the frames; None = the frames are too small
    frames: tuple[FrameQuality, ...]

    def to_json(self) -> str:
        """Return the report as a JSON object with a key for each field."""
        return json.dumps(asdict(self), indent=2, ensure_ascii=False) + "\n"

    def to_csv(self) -> str:
        """Return the frames as CSV: column names, then one line a frame."""
        text = io.StringIO()
        rows = csv.DictWriter(text, FrameQuality.__slots__, lineterminator="\n")
        rows.writeheader()
        rows.writerows(asdict(frame) for frame in self.frames)
        return text.getvalue()


def report(
    src: str | os.PathLike[str],
    gsvr: str | os.PathLike[str],
    *,
    crop: Crop | None = None,
    start_frame: int | None = None,
    threads: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Report:
    """Decode a .gsvr file and compare every frame with the source video.

    Args:
        src: The source video.
        gsvr: The .gsvr file encoded from `src`.
        crop: Part of the picture that was encoded; None = from the settings in the file.
        start_frame: First frame that was encoded; None = from the settings in the file.
        threads: Threads for rendering; 0 = all cores.
        progress: Called with the number of frames done and the number of all frames.

    Raises:
        UsageError: Size or number of frames of source and file differ.
        InputError, NotAVideoError: As `open_video`; CorruptError: as `gsvrcodec.open`.
    """
    with open_gsvr(gsvr, threads=threads) as decoder:
        meta = decoder.metadata
        video = open_part(src, meta, crop, start_frame)
        pictures: list[PictureQuality] = []
        frames: list[FrameQuality] = []
        for source, frame in zip(video, decoder, strict=False):
            if source.pts * video.info.time_base != frame.pts * meta.time_base and not frames:
                _log.warning("the first frames have different times: is %s the source?", src)
            picture = PictureQuality.of(source.rgb, frame.data.astype(np.uint8, copy=False))
            pictures.append(picture)
            frames.append(
                FrameQuality(
                    frame=frame.index,
                    pts=frame.pts,
                    seconds=frame.pts_seconds,
                    psnr_rgb=picture.psnr_rgb,
                    ssim=picture.ssim,
                    ms_ssim=picture.ms_ssim,
                )
            )
            if progress is not None:
                progress(len(frames), meta.frames)
        if len(frames) < meta.frames:
            raise UsageError(
                f"{src} ends after {len(frames)} of the {meta.frames} frames of {gsvr}"
            )
        quality = Quality.of(pictures)
        return Report(
            source=os.fspath(src),
            file=os.fspath(gsvr),
            width=meta.width,
            height=meta.height,
            gops=meta.gops,
            bytes=meta.size_bytes,
            bpp=meta.bpp,
            psnr_rgb=quality.psnr_rgb,
            psnr_rgb_pooled=quality.psnr_rgb_pooled,
            psnr_rgb_min=quality.psnr_rgb_min,
            ssim=quality.ssim,
            ms_ssim=quality.ms_ssim,
            frames=tuple(frames),
        )


def open_part(
    src: str | os.PathLike[str], meta: Metadata, crop: Crop | None, start_frame: int | None
) -> VideoReader:
    """Open the part of a video that was encoded; arguments and errors as of `report`."""
    video = open_video(
        src,
        crop=_recorded_crop(meta) if crop is None else crop,
        start_frame=_recorded_start(meta) if start_frame is None else start_frame,
        frames=meta.frames,
        **_recorded_reading(meta, by_time=start_frame is None),
    )
    _check_size(video, meta)
    return video


def _check_size(video: VideoReader, meta: Metadata) -> None:
    """Raise a UsageError if source and file have pictures of different sizes."""
    info = video.info
    if (info.width, info.height) != (meta.width, meta.height):
        raise UsageError(
            f"{info.path} gives pictures of {info.width}x{info.height}, the file has "
            f"{meta.width}x{meta.height}; give the `crop` it was made with"
        )


def _recorded_crop(meta: Metadata) -> Crop | None:
    """Return the crop in the settings of the encode; None = the whole picture."""
    value: Any = meta.settings.get("crop")
    if not (isinstance(value, list) and len(value) == 4):
        return None
    width, height, x, y = value
    if not (_whole(width) and _whole(height)):
        return None
    return width, height, x if _whole(x) else None, y if _whole(y) else None


def _recorded_reading(meta: Metadata, *, by_time: bool) -> dict[str, Any]:
    """Return the other reading options of the encode; with `by_time` also the start time."""
    options: dict[str, Any] = {
        name: meta.settings.get(name) is True for name in ("bake_rotation", "deinterlace")
    }
    for name in ("rate", *(["start_seconds"] if by_time else [])):
        value = meta.settings.get(name)
        options[name] = value if isinstance(value, float) else None
    return options


def _recorded_start(meta: Metadata) -> int:
    """Return the first frame in the settings of the encode."""
    value: Any = meta.settings.get("start_frame")
    return value if _whole(value) else 0


def _whole(value: Any) -> bool:
    """Return whether a value of the settings is a whole number of at least 0."""
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
