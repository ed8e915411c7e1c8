"""The part of the page of results on a GPU."""

from __future__ import annotations

from collections.abc import Iterator

from tests.benchmarks.markdown import number, table
from tests.benchmarks.results_read import Json


def gpu_section(result: Json) -> Iterator[str]:
    """Yield all that was measured of it."""
    largest = max(row["largest_difference"] for row in result["correctness"])
    share = max(row["share_different"] for row in result["correctness"])
    error = max(row["gradient_error"] for row in result["correctness"])
    yield "## On a GPU"
    yield ""
    yield f"{result['device']}. Against the CPU, samples of 8 bits differ by {largest} at most, in"
    yield f"one of {1 / share:,.0f}; gradients by {error:.1e} of their norm."
    yield ""
    yield from speeds(result)
    yield "Whole encodes of Bunny at most 3M parameters, by `--time-budget`; the shortest was the"
    yield "first of the process."
    yield ""
    yield from encodes(result)
    machine = f"{result['machine']}, torch {result['torch']}, Triton {result['triton']}"
    link = "[gpu.json](../../tests/benchmarks/results/gpu.json)"
    yield f"* `python -m tests.benchmarks.gpu` on {machine}; {link}."
    yield ""


def speeds(result: Json) -> Iterator[str]:
    """Yield frames rendered a second, and steps of a fit, of pictures that are means."""
    training = {_key(row): row["steps_per_second"] for row in result["training"]}
    yield from table(
        ["size", "Gaussians", "frames a second", "steps of a fit a second"],
        (
            [
                "x".join(map(str, row["size"])),
                str(row["gaussians"]),
                f"{row['fps']:.0f}",
                f"{training[_key(row)]:.0f}",
            ]
            for row in result["render"]
            if row["blending"] == "mean"
        ),
    )


def encodes(result: Json) -> Iterator[str]:
    """Yield quality by the time of an encode."""
    yield from table(
        ["seconds a frame", "PSNR", "bpp"],
        (
            [
                number(row["seconds_per_frame"], 2),
                number(row["psnr"], 2),
                number(row["bpp"], 3),
            ]
            for row in result["encode"]
        ),
    )


def _key(row: Json) -> tuple[int, int, int, str]:
    width, height = row["size"]
    return width, height, row["gaussians"], row["blending"]
