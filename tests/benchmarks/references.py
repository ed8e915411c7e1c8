"""Curves of other encoders, which do not depend on ours: `python -m tests.benchmarks.references`.

By default of the benchmark clip (132 frames, cropped to 1280x640): the bits of the video stream
alone, and the metrics of gsvrreport on the same frames.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from pathlib import Path

import click

from gsvrcodec.cli.values import crop as crop_value
from gsvrcodec.report.reference import measure, parse_reference
from gsvrcodec.video import Crop, open_video
from gsvrcodec.video.versions import ffmpeg_version
from tests.benchmarks.machine import command, machine

BUNNY = Path(__file__).parents[2] / "samples" / "bigbuckbunny.mp4"
CROP = (1280, 640, None, None)

#: As people use them; with the random access of ours, and better; and where they are best.
NAMES = (
    *("x264", "x264:key=12", "x264:intra", "x264:tune=psnr", "x264:input=rgb"),
    *("x265", "x265:key=12", "x265:intra"),
    *("svtav1", "svtav1:key=12", "svtav1:intra", "svtav1:preset=4"),
)


@click.command()
@click.argument("source", type=click.Path(path_type=Path, exists=True), default=BUNNY)
@click.option("--crop", type=crop_value, help="Part of the picture; Bunny's is 1280:640.")
@click.option("--frames", type=click.IntRange(min=1), help="How many; all of them if not given.")
@click.option("--against", default=",".join(NAMES), help="As of gsvrreport.")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write the curves here.")
def main(
    source: Path, crop: Crop | None, frames: int | None, against: str, output: Path | None
) -> None:
    """Measure the curves of SOURCE, which is Bunny if not given."""
    described = machine()
    print(described)
    print(f"{'':32}{'CRF':>4}{'bpp':>9}{'PSNR':>7}{'worst':>7}{'SSIM':>8}{'enc fps':>9}{'dec':>7}")
    curves = []
    if source == BUNNY and crop is None:
        crop = CROP
    with open_video(source, crop, frames=frames) as video:
        count = sum(1 for _ in video)
        for name in against.split(","):
            curve = measure(parse_reference(name), video, count)
            curves.append(asdict(curve) | {"name": name})
            for point in curve.points:
                quality = point.quality
                print(
                    f"{curve.label:32}{point.crf:4}{point.bpp:9.4f}{quality.psnr_rgb:7.2f}"
                    f"{quality.psnr_rgb_min:7.2f}{quality.ssim or 0:8.4f}"
                    f"{point.encode_fps:9.1f}{point.decode_fps:7.0f}",
                    flush=True,
                )
        size = video.info.width, video.info.height
    if output is not None:
        document = {
            "machine": described,
            "libraries": f"FFmpeg {ffmpeg_version()}",
            "load": os.getloadavg()[0],
            "command": command("tests.benchmarks.references"),
            "source": source.name,
            "size": size,
            "frames": count,
            "curves": curves,
        }
        output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
