"""What an hour of 1080p takes on many machines: `python -m tests.benchmarks.cluster_model`.

A simulation, not a measurement: the client analyses the film, then reads, packs and sends one chain
after another while a worker is free, or one more than that; workers fit them. What it is fed with
was measured on 2 cores of an AMD EPYC, and is in `Inputs`, with where it comes from.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import click
import numpy as np

from gsvrcodec.encoder.executors import AHEAD
from tests.benchmarks.markdown import table


@dataclass(frozen=True, slots=True)
class Inputs:
    """Seconds are of one core and for one frame of 1920x1080, unless they say otherwise."""

    frames: int = 90_000  #: an hour at 25 a second
    chain_frames: int = 100  #: the usual 4 s from key GOP to key GOP
    #: of a drive with the default settings: 2.5 s on 2 cores (README)
    fit_seconds: float = 5.0
    #: CPU time of 50 frames of the drive: reading, in each pass; analysing; packing
    read_seconds: float = 0.0127
    analyse_seconds: float = 0.0083
    pack_seconds: float = 0.0126
    frame_bytes: float = 1920 * 1080 * 3 / 5.63  #: packed, of the same frames
    #: assumptions, not measured: what the client sends a second, standard deviation of the time of
    #: a chain over its mean, cores that pack side by side, cores of a machine
    link_bytes: float = 1.25e9 / 8
    spread: float = 0.3
    packing_cores: int = 2
    machine_cores: int = 2


@dataclass(frozen=True, slots=True)
class Run:
    """One simulated encode; seconds."""

    analysis: float
    total: float
    busy: float  #: part of the time after the analysis that workers fit

    def machine_hours(self, machines: int) -> float:
        """Hours of all machines together, also while they wait."""
        return machines * self.total / 3600


def simulate(inputs: Inputs, machines: int, seed: int = 0) -> Run:
    """Return what an encode takes on so many machines, besides the client."""
    chains, workers = inputs.frames // inputs.chain_frames, machines * inputs.machine_cores
    draw = np.random.default_rng(seed).gamma(1 / inputs.spread**2, inputs.spread**2, chains)
    fits = draw * inputs.chain_frames * inputs.fit_seconds
    analysis = inputs.frames * (inputs.read_seconds + inputs.analyse_seconds)
    reading = inputs.read_seconds + inputs.pack_seconds / inputs.packing_cores
    reading *= inputs.chain_frames
    sending = inputs.chain_frames * inputs.frame_bytes / inputs.link_bytes
    free = [analysis] * workers  # when each worker is
    ends: list[float] = []  # of chains in flight
    client = link = analysis
    for fit in fits:
        if len(ends) == workers + AHEAD:
            client = max(client, heapq.heappop(ends))
        client += reading
        link = max(link, client, free[0]) + sending
        end = link + fit
        heapq.heapreplace(free, end)
        heapq.heappush(ends, end)
    total = max(free)
    return Run(analysis, total, float(fits.sum()) / (workers * (total - analysis)))


@click.command()
@click.option("--price", default=0.04, show_default=True, help="Of a core for an hour.")
@click.option("--link", default=1.25, show_default=True, help="What the client sends, Gbit/s.")
def main(price: float, link: float) -> None:
    """Print time and cost on 1 to 1000 machines."""
    inputs = Inputs(link_bytes=link * 1e9 / 8)
    rows = []
    for machines in (1, 10, 100, 1000):
        run = simulate(inputs, machines)
        hours = run.machine_hours(machines)
        rows.append(
            [
                f"{machines}",
                f"{run.total / 3600:.1f} h",
                f"{run.analysis / run.total:.0%}",
                f"{run.busy:.0%}",
                f"{hours:.0f}",
                f"{hours * inputs.machine_cores * price:.0f}",
            ]
        )
    heads = ["machines", "time", "of it analysis", "workers busy", "machine hours", "cost"]
    print("\n".join(table(heads, rows)))


if __name__ == "__main__":
    main()
