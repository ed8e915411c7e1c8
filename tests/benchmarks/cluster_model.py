"""What an hour of 1080p takes on many machines: `python -m tests.benchmarks.cluster_model`.

A simulation, not a measurement. One thread of the client reads and analyses the film, section by
section. Another one reads, packs and sends one chain after another, as soon as it is known and a
worker is free, or one more than that; with a shared source workers read by themselves. Workers fit.
What it is fed with was measured on 2 cores of an AMD EPYC, and is in `Inputs`, with where it comes
from.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import click
import numpy as np

from gsvrcodec.encoder.run.executor import AHEAD
from tests.benchmarks.markdown import table


@dataclass(frozen=True, slots=True)
class Inputs:
    """Seconds are for one frame of 1920x1080, and of one core, unless they say otherwise."""

    frames: int = 90_000  #: an hour at 25 a second
    chain_frames: int = 100  #: the usual 4 s from key GOP to key GOP
    section_frames: int = 800  #: of a shot without end; twice as many are analysed before it
    #: of a drive with the default settings: 2.5 s on 2 cores (README)
    fit_seconds: float = 5.0
    #: wall time of the first pass over the drive on 2 cores, where it is read while it is analysed
    analyse_seconds: float = 0.0138
    #: CPU time of 50 frames of the drive: reading, packing
    read_seconds: float = 0.0127
    pack_seconds: float = 0.0126
    frame_bytes: float = 1920 * 1080 * 3 / 5.63  #: packed, of the same frames
    #: assumptions, not measured: what the client sends a second, standard deviation of the time of
    #: a chain over its mean, cores that pack side by side beside those that analyse, cores of a
    #: machine, frames that a worker decodes from a key frame to its chain
    link_bytes: float = 1.25e9 / 8
    spread: float = 0.3
    packing_cores: int = 2
    machine_cores: int = 2
    frames_before: int = 125


@dataclass(frozen=True, slots=True)
class Run:
    """One simulated encode; seconds."""

    analysis: float  #: when all of the film is analysed
    total: float
    busy: float  #: part of the time that workers fit

    def machine_hours(self, machines: int) -> float:
        """Hours of all machines together, also while they wait."""
        return machines * self.total / 3600


def simulate(inputs: Inputs, machines: int, *, shared: bool, seed: int = 0) -> Run:
    """Return what an encode takes on so many machines, besides the client."""
    chains, workers = inputs.frames // inputs.chain_frames, machines * inputs.machine_cores
    draw = np.random.default_rng(seed).gamma(1 / inputs.spread**2, inputs.spread**2, chains)
    fits = draw * inputs.chain_frames * inputs.fit_seconds
    numbers = np.arange(chains) * inputs.chain_frames
    sections = numbers // inputs.section_frames * inputs.section_frames
    seen = np.minimum(sections + 2 * inputs.section_frames, inputs.frames)
    known = seen * inputs.analyse_seconds
    reading, sending, again = 0.0, 0.0, 0.0
    if shared:
        again = (inputs.chain_frames + inputs.frames_before) * inputs.read_seconds
    else:
        reading = inputs.read_seconds + inputs.pack_seconds / inputs.packing_cores
        reading *= inputs.chain_frames
        sending = inputs.chain_frames * inputs.frame_bytes / inputs.link_bytes
    free = [0.0] * workers  # when each worker is
    ends: list[float] = []  # of chains in flight
    client = link = 0.0
    for fit, begin in zip(fits, known, strict=True):
        if len(ends) == workers + AHEAD:
            client = max(client, heapq.heappop(ends))
        client = max(client, float(begin)) + reading
        link = max(link, client, free[0]) + sending
        end = max(link, free[0]) + again + fit
        heapq.heapreplace(free, end)
        heapq.heappush(ends, end)
    total = max(free)
    return Run(float(known[-1]), total, float(fits.sum()) / (workers * total))


@click.command()
@click.option("--price", default=0.04, show_default=True, help="Of a core for an hour.")
@click.option("--link", default=1.25, show_default=True, help="What the client sends, Gbit/s.")
def main(price: float, link: float) -> None:
    """Print time and cost on 1 to 1000 machines."""
    inputs = Inputs(link_bytes=link * 1e9 / 8)
    rows = []
    for machines in (1, 10, 100, 1000):
        sent, shared = (simulate(inputs, machines, shared=shared) for shared in (False, True))
        hours = sent.machine_hours(machines)
        rows.append(
            [
                f"{machines}",
                *(f"{run.total / 3600:.1f} h" for run in (sent, shared)),
                *(f"{run.busy:.0%}" for run in (sent, shared)),
                f"{hours:.0f}",
                f"{hours * inputs.machine_cores * price:.0f}",
            ]
        )
    heads = ["machines", "time", "shared source", "workers busy", "shared source"]
    heads += ["machine hours", "cost"]
    print("\n".join(table(heads, rows)))


if __name__ == "__main__":
    main()
