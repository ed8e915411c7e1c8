"""Speed of the native kernels: `python -m tests.benchmarks.kernels [--json FILE]`.

Prints milliseconds of a forward render (deformation, rasterisation, conversion to uint8 RGB) and of
a training step (forward, squared error, gradients of all parameters, Adam) by instruction set and
number of threads, for pictures that are means and for sums of as many Gaussians, against a plain
kernel (scalar source over 16x32 tiles, vectorised by the compiler; sums, without deformation) that
runs on the same threads in the same run. The two kinds take turns, and a table has the ratios of
their times. The plain kernel is built first, with g++, cmake and ninja.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import get_args

import numpy as np

from gsvrcodec.model.gop import Gop, parameters_of
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.reconstruction import CUTOFF, DILATION, Blending
from gsvrcodec.native import _core
from tests.benchmarks.machine import machine
from tests.benchmarks.native import Baseline

SIZE = (1280, 640)
GAUSSIANS = 40_000
HEIGHTS = (360, 720, 1080, 2160)
BLENDINGS: tuple[Blending, ...] = get_args(Blending)
#: Multiply-adds of one Gaussian at one pixel: two of the recurrence, one a colour, one of a weight.
MULTIPLY_ADDS: dict[Blending, int] = {"mean": 6, "sum": 5}


def background(n: int = GAUSSIANS) -> Gop:
    """N nearly still Gaussians of about 2.6 px, round and long ones, in storage order."""
    r = np.random.default_rng(0)
    position = r.uniform(-1, 1, (n, 2)).astype(np.float32)
    position = position[strip_order(position)]
    arrays = {
        "position": position,
        "log_scale": np.log(2.6) + r.normal(0, 0.5, (n, 2)),
        "rotation": r.uniform(0, np.pi, n),
        "colour": r.uniform(0, 0.2, (n, 3)),
        "log_opacity": np.zeros(n),
        "indicator": np.full(n, 0.88),
        "linear": r.normal(0, 0.01, (n, 2)),
        "quadratic": r.normal(0, 0.002, (n, 2)),
        "xy": r.normal(0, 0.01, (32, 64, 8)),
        "xt": np.ones((24, 64, 8)),
        "yt": np.ones((24, 32, 8)),
    }
    return Gop(**{name: np.ascontiguousarray(a, np.float32) for name, a in arrays.items()})


def evaluations(gop: Gop, zoom: float = 1.0) -> float:
    """Pixels inside the Gaussians, summed over them (those beyond the frame's edges counted)."""
    axes = np.exp(2 * gop.log_scale.astype(float)) + DILATION
    return float((-2 * np.pi * np.log(CUTOFF) * zoom**2 * np.sqrt(axes.prod(1))).sum())


@dataclass(frozen=True)
class Row:
    """One line of the table; times are medians in milliseconds."""

    isa: str
    blending: Blending
    threads: int
    gaussians: int
    width: int
    height: int
    forward: float
    batch: float  #: a frame of a batch of eight
    step: float
    plain: float | None  #: the plain kernel's forward render
    evaluations_per_s: float  #: of the batch, 10^9 a second
    peak_fraction: float  #: of the measured multiply-add peak
    step_ratio: float  #: step / forward
    speedup: float | None  #: plain / forward


Times = dict[Blending, list[float]]  #: milliseconds of each run


def times_ms(call: Callable[[bool], object], repeat: int) -> Times:
    """Times of a call that gets whether pictures are means, by turns."""
    times: Times = {blending: [] for blending in BLENDINGS}
    for warm in (True, *[False] * repeat):
        for blending, own in times.items():
            start = time.perf_counter()
            call(blending == "mean")
            if not warm:
                own.append((time.perf_counter() - start) * 1e3)
    return times


def ratio(times: Times) -> float:
    """Median of a mean's time over that of the sum beside it."""
    return statistics.median(m / s for m, s in zip(times["mean"], times["sum"], strict=True))


@dataclass(frozen=True)
class Ratios:
    """Times of means over those of sums of as many Gaussians."""

    forward: float
    batch: float
    step: float


def measure(
    baseline: Baseline,
    gop: Gop,
    size: tuple[int, int],
    coded: tuple[int, int],
    threads: int,
    repeat: int,
    plain: bool,
) -> tuple[list[Row], Ratios]:
    """Rows of both blendings."""
    width, height = size
    core = parameters_of(gop)
    gradient = Gop(**{name: np.zeros_like(getattr(gop, name)) for name in Gop.__slots__})
    gradient_core = parameters_of(gradient)
    low = np.full(1, 1e-12, np.float32)
    parts = [
        _core.AdamPart(a, np.zeros_like(a), np.zeros_like(a), low)
        for a in (getattr(gop, name) for name in Gop.__slots__)
    ]
    slopes = [getattr(gradient, name) for name in Gop.__slots__]
    target = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
    out = np.empty((8, height, width, 3), np.uint8)
    taus = np.linspace(-1, 1, 8, dtype=np.float32)
    steps = 0

    def step(mean: bool) -> None:
        nonlocal steps
        steps += 1
        _core.squared_error(core, 0.1, target, *coded, mean, gradient_core, threads)
        _core.adam_step(parts, slopes, 1.0, 0.9, 0.99, 1e-15, 1.0, 1.0, steps, threads)

    def render(mean: bool, frames: int) -> None:
        _core.render_rgb8(core, taus[:frames], out[:frames], *coded, mean, threads)

    forwards = times_ms(lambda mean: render(mean, 1), repeat)
    batches = times_ms(lambda mean: render(mean, 8), repeat)
    steps_ms = times_ms(step, repeat)
    isa = _core.isa()
    plain_ms = None
    if plain:
        runs = times_ms(lambda _: baseline.render(gop, isa, threads, out[0]), repeat)
        plain_ms = statistics.median([*runs["mean"], *runs["sum"]])
    peak = statistics.median(baseline.multiply_adds_per_second(isa, threads) for _ in range(5))
    rows = []
    for blending in BLENDINGS:
        forward, batch, step_ms = (
            statistics.median(times[blending]) for times in (forwards, batches, steps_ms)
        )
        batch /= 8
        rate = evaluations(gop, height / coded[1]) / batch * 1e3
        rows.append(
            Row(
                isa=isa,
                blending=blending,
                threads=threads,
                gaussians=len(gop),
                width=width,
                height=height,
                forward=forward,
                batch=batch,
                step=step_ms,
                plain=plain_ms,
                evaluations_per_s=rate / 1e9,
                peak_fraction=rate * MULTIPLY_ADDS[blending] / peak,
                step_ratio=step_ms / forward,
                speedup=plain_ms / forward if plain_ms else None,
            )
        )
    return rows, Ratios(ratio(forwards), ratio(batches), ratio(steps_ms))


HEADINGS = (
    *("isa", "pictures", "threads", "N", "W", "H", "forward", "batch", "step", "plain"),
    *("Geval/s", "of peak", "step/fwd", "plain/fwd"),
)


def show(row: Row) -> None:
    cells = []
    for field, heading in zip(fields(Row), HEADINGS, strict=True):
        value = getattr(row, field.name)
        text = "" if value is None else f"{value:.2f}" if isinstance(value, float) else str(value)
        cells.append(text.rjust(max(8, len(heading))))
    print(*cells, flush=True)


def show_ratios(ratios: list[tuple[Row, Ratios]]) -> None:
    """A table of what means cost over sums of as many Gaussians."""
    names = [field.name for field in fields(Ratios)]
    print("\nmean over sum, medians of the ratios")
    print(*(h.rjust(8) for h in ("isa", "threads", "N", "W", "H", *names)))
    for row, own in ratios:
        cells = (row.isa, row.threads, row.gaussians, row.width, row.height)
        print(
            *(str(cell).rjust(8) for cell in cells),
            *(f"{getattr(own, name):8.2f}" for name in names),
        )


def show_costs(title: str, costs: dict[str, float]) -> None:
    """Bars of a cost that is flat when the whole grows linearly."""
    print(f"\n{title}")
    for label, cost in costs.items():
        print(f"{label:>10} {cost:8.3f} {'#' * round(40 * cost / max(costs.values()))}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--repeat", type=int, default=9, help="runs of which the median is taken")
    parser.add_argument("--isa", action="append", help="instruction sets (default: all)")
    parser.add_argument("--threads", type=int, action="append", help="default: 1 and all cores")
    parser.add_argument(
        "--no-sweep", action="store_true", help="leave out the cost against N, pixels"
    )
    options = parser.parse_args()
    baseline = Baseline()
    about = {
        "machine": machine(),
        "command": "python -m tests.benchmarks.kernels " + " ".join(sys.argv[1:]),
    }
    print(about["machine"])
    print(about["command"])
    print(*(h.rjust(8) for h in HEADINGS))
    isas = options.isa or _core.isas()
    counts = options.threads or sorted({1, os.cpu_count() or 1})
    rows: list[Row] = []
    ratios: list[tuple[Row, Ratios]] = []

    def run(
        gop: Gop, size: tuple[int, int], coded: tuple[int, int], threads: int, plain: bool
    ) -> Row:
        both, of_both = measure(baseline, gop, size, coded, threads, options.repeat, plain)
        rows.extend(both)
        ratios.append((both[0], of_both))
        for row in both:
            show(row)
        return both[BLENDINGS.index("mean")]

    for isa in isas:
        _core.use_isa(isa)
        for threads in counts:
            run(background(), SIZE, SIZE, threads, plain=True)
    if not options.no_sweep:
        _core.use_isa(isas[0])
        by_n = {
            str(n): run(background(n), SIZE, SIZE, counts[-1], plain=False)
            for n in (5000, 10_000, 20_000, 40_000, 80_000)
        }
        by_height = {
            f"{height}p": run(
                background(), (height * 16 // 9, height), (1280, 720), counts[-1], plain=False
            )
            for height in HEIGHTS
        }
        show_costs(
            "ms a thousand Gaussians", {k: r.batch / r.gaussians * 1e3 for k, r in by_n.items()}
        )
        show_costs(
            "ms a megapixel, scales in proportion",
            {k: r.batch / (r.width * r.height) * 1e6 for k, r in by_height.items()},
        )
    show_ratios(ratios)
    if options.json:
        result = about | {"rows": [asdict(row) for row in rows]}
        options.json.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
