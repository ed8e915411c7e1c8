"""Rate and distortion of several .gsvr files of one source, against reference encoders."""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from typing import Any

from gsvrcodec.decoder.decoder import open as open_gsvr
from gsvrcodec.errors import UsageError
from gsvrcodec.metrics import ms_ssim_db
from gsvrcodec.report.compare import Report, open_part, report
from gsvrcodec.report.curve import BdRate, RateCurve
from gsvrcodec.report.machine import cores, processor
from gsvrcodec.report.reference import Curve, Reference, measure
from gsvrcodec.video.read import Crop
from gsvrcodec.video.versions import ffmpeg_version


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """Measurements of .gsvr files and of reference encoders on the same frames."""

    reports: tuple[Report, ...]  #: one report a file
    decode_fps: tuple[float, ...]  #: decoded frames a second of each file, from file to RGB
    curves: tuple[Curve, ...]  #: one curve a reference
    machine: str  #: processor and cores
    libraries: str  #: version of FFmpeg, which runs the references

    @property
    def rate_curve(self) -> RateCurve:
        """Bits a pixel and frame of the files over their mean PSNR."""
        return RateCurve((report.psnr_rgb, report.bpp) for report in self.reports)

    @property
    def ms_ssim_curve(self) -> RateCurve | None:
        """Bits a pixel and frame over mean MS-SSIM in dB; None = the frames are too small."""
        known = [(ms_ssim_db(r.ms_ssim), r.bpp) for r in self.reports if r.ms_ssim is not None]
        return RateCurve(known) if len(known) == len(self.reports) else None

    def bd_rate(self, curve: Curve) -> BdRate | None:
        """Return the BD-rate of the files against a reference; None = no overlap."""
        return self.rate_curve.bd_rate(curve.rate_curve)

    def bd_rate_ms_ssim(self, curve: Curve) -> BdRate | None:
        """Return the BD-rate by MS-SSIM in dB; None = no overlap, or the frames are too small."""
        ours, theirs = self.ms_ssim_curve, curve.ms_ssim_curve
        return None if ours is None or theirs is None else ours.bd_rate(theirs)

    def to_json(self) -> str:
        """Return a JSON object: fields of the first report, then the other files and references."""
        files: list[dict[str, Any]] = [
            asdict(report) | {"decode_fps": fps}
            for report, fps in zip(self.reports, self.decode_fps, strict=True)
        ]
        return (
            json.dumps(
                files[0]
                | {
                    "machine": self.machine,
                    "libraries": self.libraries,
                    "more": files[1:],
                    "against": [self._against(curve) for curve in self.curves],
                },
                indent=2,
                ensure_ascii=False,
            )
            + "\n"
        )

    def _against(self, curve: Curve) -> dict[str, Any]:
        """Return the fields of a reference's curve, BD-rate, and rates at the PSNR of each file."""
        bd_rate = self.bd_rate(curve)
        return asdict(curve) | {
            "bd_rate": None if bd_rate is None else asdict(bd_rate),
            "bpp_at_equal_psnr": [curve.rate_curve.rate(r.psnr_rgb) for r in self.reports],
        }


def study(
    src: str | os.PathLike[str],
    files: Sequence[str | os.PathLike[str]],
    references: Sequence[Reference] = (),
    *,
    crop: Crop | None = None,
    start_frame: int | None = None,
    threads: int = 0,
    progress: Callable[[int, int], None] | None = None,
    about: Callable[[str | os.PathLike[str]], AbstractContextManager[object]] = nullcontext,
) -> Study:
    """Measure .gsvr files and reference encoders on the same frames of one source.

    Args:
        src: The source video.
        files: .gsvr files encoded from `src`, at least one; all of the same frames.
        references: Reference encoders.
        crop: Part of the picture that was encoded; None = from the settings in each file.
        start_frame: First frame that was encoded; None = from the settings in each file.
        threads: Threads for decoding and encoding; 0 = all cores.
        progress: Called with the frames done and all frames, of a file or of all encodes of a
            reference.
        about: Context manager around the work on each file, for naming the file in errors.

    Raises:
        UsageError: Source and files have different frames, or an encoder rejects the frames.
        InputError, NotAVideoError: As `open_video`; CorruptError: as `gsvrcodec.open`.
    """
    reports, speeds, curves = [], [], []
    for file in files:
        with about(file):
            reports.append(
                report(
                    src,
                    file,
                    crop=crop,
                    start_frame=start_frame,
                    threads=threads,
                    progress=progress,
                )
            )
            speeds.append(_decode_fps(file, threads))
    with open_gsvr(files[0]) as decoder:
        meta = decoder.metadata
    _check_same(reports)
    video = open_part(src, meta, crop, start_frame)
    gop = max(1, round(meta.frames / meta.gops))
    for reference in references:
        chosen = replace(reference, key=gop) if reference.key == "same" else reference
        curves.append(measure(chosen, video, meta.frames, threads=threads, progress=progress))
    return Study(
        reports=tuple(reports),
        decode_fps=tuple(speeds),
        curves=tuple(curves),
        machine=f"{processor()}, {cores()} cores",
        libraries=f"FFmpeg {ffmpeg_version()}",
    )


def _decode_fps(file: str | os.PathLike[str], threads: int) -> float:
    """Return the decoding speed of a file, frames a second."""
    with open_gsvr(file, threads=threads) as decoder:
        began = time.perf_counter()
        deque(decoder, maxlen=0)
        return len(decoder) / (time.perf_counter() - began)


def _check_same(reports: Sequence[Report]) -> None:
    """Raise a UsageError if the files differ in size or number of frames."""
    first = reports[0]
    for other in reports[1:]:
        mine, its = (f"{len(r.frames)} frames of {r.width}x{r.height}" for r in (first, other))
        if mine != its:
            raise UsageError(
                f"{first.file} has {mine}, {other.file} {its}; only files of the same frames "
                "can be compared"
            )
