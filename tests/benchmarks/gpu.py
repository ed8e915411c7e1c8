"""All figures of a GPU in one run: `python -m tests.benchmarks.gpu [PART ...] [--json FILE]`.

Parts: "correctness" against the CPU, "render" (frames a second from parameters on the device to
samples on the device), "training" (steps a second), "encode" (PSNR against seconds a frame on the
benchmark clip). All but "encode" measure pictures that are means and such that are sums. Shares of
the peaks are of what a copy and a float32 matrix product reach here.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, get_args

import click
import numpy as np
import torch

import gsvrcodec
from gsvrcodec.errors import GsvrError
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.optimise import Effort, optimise
from gsvrcodec.fit.paper import PAPER
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.fit.recipe import MAIN
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render import backend_on, render_frames
from gsvrcodec.render.device import choose_device
from tests.benchmarks.machine import machine

#: The publication's clip and setting.
SOURCE = Path(__file__).parents[2] / "samples" / "bigbuckbunny.mp4"
COMMON: dict[str, Any] = {"params": 3_000_000, "crop": (1280, 640, None, None)}

SIZES = ((1280, 640), (1920, 960))
GAUSSIANS = (10_000, 20_000, 40_000, 80_000)
BUDGETS = (0.25, 0.5, 1.0)  # seconds a frame
FRAMES = 24  # of a GOP
TAUS = np.linspace(-1, 1, FRAMES, dtype=np.float32)
BLENDINGS: tuple[Blending, ...] = get_args(Blending)
#: Operations for one pixel of one Gaussian: offsets 3, exponent 6, power 1, cut-off 2, sums 6 or 8.
FLOPS_PER_PIXEL: dict[Blending, int] = {"mean": 20, "sum": 18}
#: Without a coarse stage and relocations.
RECIPES = {"mean": replace(MAIN, coarse=0.0, relocations=()), "sum": PAPER}

Row = dict[str, Any]


def typical_gop(gaussians: int, size: tuple[int, int], seed: int = 0) -> Gop:
    """Gaussians spread evenly, as large as their distances ask, a few much larger."""
    r = np.random.default_rng(seed)
    spacing = np.sqrt(size[0] * size[1] / gaussians)
    arrays = {
        "position": r.uniform(-1, 1, (gaussians, 2)),
        "log_scale": np.log(0.45 * spacing) + r.normal(0, 0.6, (gaussians, 2)),
        "rotation": r.uniform(0, np.pi, gaussians),
        "colour": r.uniform(0, 0.6, (gaussians, 3)),
        "log_opacity": r.normal(0, 1, gaussians),
        "indicator": r.uniform(0, 1, gaussians),
        "linear": r.normal(0, 0.02, (gaussians, 2)),
        "quadratic": r.normal(0, 0.01, (gaussians, 2)),
        "xy": r.normal(0, 0.02, (32, 64, 8)),
        "xt": r.normal(1, 0.1, (FRAMES, 64, 8)),
        "yt": r.normal(1, 0.1, (FRAMES, 32, 8)),
    }
    return Gop(**{name: np.ascontiguousarray(a, np.float32) for name, a in arrays.items()})


def _event() -> torch.cuda.Event:
    return torch.cuda.Event(enable_timing=True)  # type: ignore[no-untyped-call]


def seconds_of(call: Callable[[], object], device: str, repeats: int = 9) -> float:
    """Median time of a call on the device, after three for nothing."""
    for _ in range(3):
        call()
    times: list[float] = []
    for _ in range(repeats):
        start, end = _event(), _event()
        with torch.cuda.device(device):
            start.record()
            call()
            end.record()
        end.synchronize()
        times.append(start.elapsed_time(end) / 1000)
    return median(times)


def peaks(device: str) -> Row:
    """Bytes and float32 operations a second that simple programs reach."""
    source = torch.empty(2**28, device=device).normal_()
    target = torch.empty_like(source)
    copied = 2 * source.nbytes / seconds_of(lambda: target.copy_(source), device)
    side = 8192
    factor = source[: side * side].view(side, side)
    multiplied = 2 * side**3 / seconds_of(lambda: factor @ factor, device)
    return {"bytes_per_second": copied, "flops_per_second": multiplied}


def correctness(device: str) -> list[Row]:
    """Samples and gradients against the CPU."""
    rows = []
    sizes = (
        ((640, 360), (640, 360)),
        ((333, 201), (640, 360)),
        ((962, 541), (640, 360)),
    )
    for blending, (size, coded) in product(BLENDINGS, sizes):
        gop = typical_gop(6000, coded)
        how = partial(render_frames, gop, TAUS, size, coded, blending=blending)
        expected = how().astype(int)
        difference = np.abs(how(device=device) - expected)
        again = how(device=device)
        target = np.random.default_rng(1).integers(0, 256, (size[1], size[0], 3), np.uint8)
        gradients = []
        for place in "cpu", device:
            backend = backend_on(place, blending=blending)
            parameters = Parameters(gop, "hybrid", backend)
            found = parameters.gradients(parameters.tensors(), 0.3, backend.upload(target), coded)
            gradients.append({name: backend.fetch(each) for name, each in found.items()})
        on_cpu, on_gpu = gradients
        rows.append(
            {
                "blending": blending,
                "size": size,
                "coded_size": coded,
                "largest_difference": int(difference.max()),
                "share_different": float((difference > 0).mean()),
                "same_again": bool((np.abs(again - expected) == difference).all()),
                "gradient_error": max(
                    float(np.linalg.norm(on_gpu[k] - on_cpu[k]) / np.linalg.norm(on_cpu[k]))
                    for k in on_cpu
                ),
            }
        )
    return rows


def rendering(device: str, ceiling: Row) -> list[Row]:
    """Frames a second, all of a GOP in one pass, nothing copied to the host."""
    from gsvrcodec.render.triton import empty_codes, render, upload
    from gsvrcodec.render.triton.launch import Pass, sums_of

    rows = []
    for size, gaussians, blending in product(SIZES, GAUSSIANS, BLENDINGS):
        parameters = upload(typical_gop(gaussians, size), torch.device(device))
        taus = torch.from_numpy(TAUS).to(device)
        out = empty_codes((FRAMES, size[1], size[0], 3), 8, device)
        how = parameters, taus, size, size
        call = partial(render, *how, blending=blending, bit_depth=8, out=out)
        fps = FRAMES / seconds_of(call, device)
        pixels = Pass(*how, blending).pixels_drawn() / FRAMES
        flops = FLOPS_PER_PIXEL[blending] * pixels * fps
        # Sums of 4/3 of the frame's pixels written and read, and the codes.
        moved = size[0] * size[1] * (sums_of(blending) * 2 * 4 * 4 / 3 + 3)
        rows.append(
            {
                "size": size,
                "gaussians": gaussians,
                "blending": blending,
                "fps": fps,
                "pixels_per_frame": pixels,
                "share_of_arithmetic": flops / ceiling["flops_per_second"],
                "share_of_bandwidth": moved * fps / ceiling["bytes_per_second"],
            }
        )
    return rows


def training(device: str) -> list[Row]:
    """Steps a second of the whole loop: forward, backward and Adam, one frame a step."""
    steps = 400
    rows = []
    for size, gaussians, blending in product(SIZES, GAUSSIANS, BLENDINGS):
        goal, recipe = typical_gop(gaussians, size, 1), RECIPES[blending]
        frames = render_frames(goal, TAUS, size, size, device=device, blending=blending)
        footage = Footage(np.asarray(frames, np.uint8), TAUS)
        backend = backend_on(device, blending=blending)
        parameters = Parameters(typical_gop(gaussians, size), "hybrid", backend)
        rng = np.random.default_rng(0)
        optimise(parameters, footage, recipe, Effort(20), rng)
        torch.cuda.synchronize(device)
        start = time.perf_counter()
        optimise(parameters, footage, recipe, Effort(steps), rng)
        torch.cuda.synchronize(device)
        pace = steps / (time.perf_counter() - start)
        rows.append(
            {
                "size": size,
                "gaussians": gaussians,
                "blending": blending,
                "steps_per_second": pace,
            }
        )
    return rows


def encoding(device: str) -> list[Row]:
    """The benchmark clip at most 3M parameters: PSNR as decoded, against wall time."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for budget in BUDGETS:
            result = gsvrcodec.encode(
                SOURCE,
                Path(folder) / "out.gsvr",
                overwrite=True,
                time_budget=budget,
                device=device,
                **COMMON,
            )
            rows.append(
                {
                    "time_budget": budget,
                    "psnr": result.psnr,
                    "bpp": result.bpp,
                    "gaussians": result.gaussians,
                    "seconds_per_frame": result.seconds / result.frames,
                }
            )
    return rows


def describe(device: str) -> Row:
    """What was measured, with what."""
    import triton

    properties = torch.cuda.get_device_properties(device)
    return {
        "device": properties.name,
        "memory_bytes": properties.total_memory,
        "multiprocessors": properties.multi_processor_count,
        "torch": torch.__version__,
        "cuda": torch.version.cuda,
        "triton": triton.__version__,
        "machine": machine(),
    }


def show(title: str, rows: list[Row]) -> None:
    """Print rows as a table."""
    print(f"\n{title}\n" + "".join(f"{name:>21}" for name in rows[0]))
    for row in rows:
        cells = (
            f"{value:.5g}" if isinstance(value, float) else str(value) for value in row.values()
        )
        print("".join(f"{cell:>21}" for cell in cells), flush=True)


PARTS = ("correctness", "render", "training", "encode")


@click.command()
@click.argument("parts", nargs=-1, type=click.Choice(PARTS))
@click.option("--device", default="cuda", show_default=True)
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(parts: tuple[str, ...], device: str, output: Path | None) -> None:
    """Measure PARTS, or all of them."""
    try:
        place = choose_device(device)
    except GsvrError as error:
        sys.exit(f"nothing was measured: {error}")
    if place == "cpu":
        sys.exit("nothing was measured: this benchmark is of a GPU")
    document: Row = describe(place) | {"peaks": peaks(place)}
    print(json.dumps(document, indent=1))
    measures: dict[str, Callable[[], list[Row]]] = {
        "correctness": lambda: correctness(place),
        "render": lambda: rendering(place, document["peaks"]),
        "training": lambda: training(place),
        "encode": lambda: encoding(place),
    }
    for part in parts or PARTS:
        document[part] = measures[part]()
        show(part, document[part])
        if output is not None:
            output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
