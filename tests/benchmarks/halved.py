"""A film at half its size, without loss: `python -m tests.benchmarks.halved FILM OUT.mkv`.

Most video to be had was compressed before. An encoder of the same kind finds the blocks of that
compression again, and at high rates codes them for next to nothing. Scaling removes most of their
marks: what others compare at this size is nearer to what a camera gives.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import islice
from pathlib import Path

import av
import click


@click.command()
@click.argument("film", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--frames", default=96, show_default=True, type=click.IntRange(min=1))
def main(film: Path, out: Path, frames: int) -> None:
    """Write the first frames of FILM to OUT, scaled by areas."""
    with av.open(str(film)) as source, av.open(str(out), "w") as target:
        old = source.streams.video[0]
        rate = old.average_rate or Fraction(25)
        stream = target.add_stream("ffv1", rate=rate)
        stream.width, stream.height = old.width // 2, old.height // 2
        stream.pix_fmt = "yuv420p"
        for number, frame in enumerate(islice(source.decode(old), frames)):
            own = frame.reformat(
                stream.width, stream.height, format="yuv420p", interpolation="AREA"
            )
            if number == 0:
                context = stream.codec_context
                context.colorspace, context.color_range = frame.colorspace, frame.color_range
            own.pts, own.time_base = number, 1 / rate
            target.mux(stream.encode(own))
        target.mux(stream.encode(None))


if __name__ == "__main__":
    main()
