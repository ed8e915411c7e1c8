"""Executors and a cluster on this machine: `python -m tests.benchmarks.cluster WHAT`.

* same: local workers, Python's executor, Dask and, if installed, loky, Ray and MPI, with 2 workers
  each, give the same bytes; wall and CPU time of each, median of --runs, workers started anew for
  each run, but for a Dask that is running, also with a shared source. CPU time leaves out processes
  that Ray and MPI start by others.
* killed: three workers, one of which is killed with -9 half-way.
* lost: the scheduler is killed half-way; the encode is resumed.
* memory: most memory of client and scheduler while a film of 1280x720 goes to three workers. They
  unpack its frames and do not fit them: each GOP is that of one Gaussian.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import multiprocessing
import os
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import av
import click
import numpy as np

import gsvrcodec
from gsvrcodec.cli.values import size as picture_size
from gsvrcodec.encoder.encode import Progress
from gsvrcodec.errors import ClusterError
from gsvrcodec.video import open_video, open_writer
from tests import making
from tests.benchmarks.machine import machine
from tests.encoder.clusters import Machines, Process, example, machines

_KINDS = "local,ProcessPoolExecutor,Dask,Dask running,Dask shared,loky,Ray,MPI"

#: Ten chains of 20 frames, of two GOPs each.
SETTINGS: dict[str, Any] = {
    **{"preset": "fastest", "keyint": 0.8, "gop": 10, "overwrite": True},
}


def film(path: Path, frames: int, size: tuple[int, int]) -> Path:
    """Bunny's frames, again and again, in so many pixels of the middle."""
    with open_video(making.BUNNY, (*size, None, None)) as video:
        shots = [shot.rgb for shot in islice(video, 100)]
    info = making.output_info(shots)
    with open_writer(path, info) as writer:
        for number, rgb in enumerate(islice(cycle([*shots, *shots[::-1]]), frames)):
            writer.write(rgb, number, 1)
    return path


def repeated(path: Path, times: int) -> Path:
    """Bunny again and again, its packets as they are."""
    with av.open(path, "w") as target:
        stream, begin = None, 0
        for _ in range(times):
            with av.open(making.BUNNY) as source:
                own = source.streams.video[0]
                stream = stream or target.add_stream_from_template(own)
                for packet in source.demux(own):
                    if packet.dts is None or packet.pts is None:
                        continue
                    packet.pts, packet.dts = packet.pts + begin, packet.dts + begin
                    packet.stream = stream
                    target.mux(packet)
                begin += own.duration or 0
    return path


def joined(found: gsvrcodec.Cluster, count: int) -> gsvrcodec.Cluster:
    """Wait until so many workers have joined."""
    while found.workers < count:
        time.sleep(0.1)
    return found


def md5(path: Path) -> str:
    """What tells files apart."""
    return hashlib.md5(path.read_bytes()).hexdigest()


def timed(source: Path, target: Path, executor: Executor | None, **more: Any) -> float:
    """Encode, and return the wall time."""
    began = time.perf_counter()
    gsvrcodec.encode(source, target, executor=executor, **(SETTINGS | more))
    return time.perf_counter() - began


def cpu(running: Sequence[Process]) -> float:
    """CPU seconds of this process and of all that it started and that have ended, or are given."""
    found = os.times()
    ticks = 0
    for process in running:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    ended = found.user + found.system + found.children_user + found.children_system
    return ended + ticks / os.sysconf("SC_CLK_TCK")


def same(directory: Path, source: Path, runs: int, names: str) -> None:
    """Compare executors in bytes, wall time and CPU time."""
    target = directory / "a.gsvr"
    timed(source, target, None, workers=1)
    expected = md5(target)
    print(f"--workers 1: {expected}")

    running: list[Process] = []

    @contextmanager
    def dask() -> Iterator[Executor]:
        with machines(2) as two, gsvrcodec.Cluster(two.address) as found:
            yield joined(found, 2)

    @contextmanager
    def running_dask() -> Iterator[Executor]:
        with gsvrcodec.Cluster(always.address) as found:
            yield joined(found, 2)

    @contextmanager
    def ray() -> Iterator[Executor]:
        ray = importlib.import_module("ray")
        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
        names: dict[str, Any] = {"__name__": "example"}
        exec(example("ray"), names)
        yield names["RayExecutor"]()
        ray.shutdown()

    def mpi() -> AbstractContextManager[Executor]:
        os.environ.update(OMPI_MCA_rmaps_base_oversubscribe="1")  # more processes than cores
        pool: Executor = importlib.import_module("mpi4py.futures").MPIPoolExecutor(2)
        return pool

    spawn = multiprocessing.get_context("spawn")
    kinds: dict[str, Callable[[], AbstractContextManager[Executor | None]]] = {
        "local": lambda: nullcontext(),
        "ProcessPoolExecutor": lambda: ProcessPoolExecutor(2, mp_context=spawn),
        "Dask": dask,
        "Dask running": running_dask,
        "Dask shared": running_dask,
    }
    try:
        import loky

        kinds["loky"] = lambda: loky.ProcessPoolExecutor(2)
    except ImportError:
        print("loky is not installed")
    kinds |= {"Ray": ray, "MPI": mpi}
    for name, package in (("Ray", "ray"), ("MPI", "mpi4py")):
        if importlib.util.find_spec(package) is None:
            print(f"{package} is not installed")
            del kinds[name]
    kinds = {name: kind for name, kind in kinds.items() if name in names.split(",")}
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in kinds}
    with machines(2) as always:
        running += [always.scheduler, *always.workers]
        with running_dask() as found:
            timed(source, target, found, workers=2)  # loads what workers need
        for _ in range(runs):
            for name, kind in kinds.items():
                began = cpu(running)
                with kind() as executor:
                    # Local workers are started anew by every encode, so all others but one are too.
                    more = {"shared_source": True} if name == "Dask shared" else {}
                    wall = timed(source, target, executor, workers=2, **more)
                times[name].append((wall, cpu(running) - began))
                assert md5(target) == expected, name
                print(f"  {name:20} {wall:6.1f} s, {times[name][-1][1]:6.1f} s of CPU", flush=True)
    base, base_cpu = (statistics.median(each) for each in zip(*times["local"], strict=True))
    for name, rounds in times.items():
        wall, used = (statistics.median(each) for each in zip(*rounds, strict=True))
        print(
            f"{name:20} {wall:6.1f} s ({wall / base - 1:+.0%}), "
            f"{used:6.1f} s of CPU ({used / base_cpu - 1:+.0%}), same bytes"
        )


def half_way(action: Callable[[], None]) -> Callable[[Progress], None]:
    """Do something once, when half of the GOPs are done."""
    once = iter([action])

    def called(state: Progress) -> None:
        if 2 * state.gop >= state.gops:
            for do in once:
                do()

    return called


def killed(directory: Path, source: Path) -> None:
    """Kill a worker half-way."""
    target = directory / "a.gsvr"
    timed(source, target, None, workers=1)
    expected = md5(target)
    with machines(3) as three, gsvrcodec.Cluster(three.address) as found:
        joined(found, 3)
        seconds = timed(source, target, found, progress=half_way(three.workers[1].kill))
        print(f"a worker killed: {seconds:.1f} s, same bytes: {md5(target) == expected}")


def lost(directory: Path, source: Path) -> None:
    """Kill the scheduler half-way, and resume."""
    target = directory / "a.gsvr"
    timed(source, target, None, workers=1)
    expected = md5(target)
    target.unlink()
    with machines(3) as three, gsvrcodec.Cluster(three.address) as found:
        joined(found, 3)
        began = time.perf_counter()
        try:
            timed(source, target, found, progress=half_way(three.scheduler.kill))
        except ClusterError as error:
            print(f"{time.perf_counter() - began:.1f} s: {error}; {error.__notes__[0]}")
    timed(source, target, None, workers=1, resume=True)
    print(f"resumed, same bytes: {md5(target) == expected}")


def memory(directory: Path, frames: int) -> None:
    """Send frames of 1280x720 and let workers unpack them."""
    from gsvrcodec.encoder.run import dask as cluster

    source = repeated(directory / "large.mp4", -(-frames // 132))
    unpacking = eval(UNPACKING, {"__name__": "nowhere"})  # sent by value
    vars(cluster)["encoded"] = unpacking
    with machines(3) as three, gsvrcodec.Cluster(three.address) as found:
        joined(found, 3)
        with Memory(three) as watched:
            began = time.perf_counter()
            gsvrcodec.encode(
                source, directory / "a.gsvr", executor=found, overwrite=True, frames=frames
            )
            seconds = time.perf_counter() - began
    print(f"{frames} frames of 1280x720 in {seconds:.0f} s; most memory:")
    for name, most in watched.most.items():
        print(f"  {name:10} {most / 1e6:6.0f} MB, {watched.before[name] / 1e6:.0f} MB at first")


#: A worker's work: it unpacks all frames, and packs one black Gaussian for each GOP.
UNPACKING = """lambda data, threads: __import__(
    "tests.benchmarks.cluster", fromlist=["unpacked"]).unpacked(data)"""


def unpacked(data: bytes) -> Any:
    """Unpack the frames of a pickled chain, and return GOPs of one Gaussian."""
    import pickle

    from gsvrcodec.bitstream.gop_payload import pack_gop
    from gsvrcodec.encoder.chain import ChainTask
    from gsvrcodec.encoder.results import EncodedGop
    from gsvrcodec.model.attributes import ATTRIBUTES

    task: ChainTask = pickle.loads(data)
    bits = dict.fromkeys((attribute.name for attribute in ATTRIBUTES), 8)
    found = []
    for number, gop in enumerate(task.frames.gops):
        pictures = task.frames.take(number)
        assert len(pictures) == len(gop)
        assert pictures.any()
        one = making.random_gop(np.random.default_rng(0), 1)
        times = task.frames.pts[number], task.frames.durations[number]
        payload = pack_gop(one, *times, gop.start, bits)
        found.append(
            EncodedGop(frames=gop, psnr=30.0, float_psnr=30.0, seconds=1.0, payload=payload)
        )
    return found


class Memory:
    """Watches the resident memory of this process, the scheduler and a worker."""

    def __init__(self, machines: Machines) -> None:
        self._pids = {
            "client": "self",
            "scheduler": str(machines.scheduler.pid),
            "worker": str(machines.workers[0].pid),
        }
        self.before = self._now()
        self.most = dict(self.before)
        self._over = threading.Event()

    def _now(self) -> dict[str, int]:
        found = {}
        for name, pid in self._pids.items():
            found[name] = 4096 * int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return found

    def __enter__(self) -> Memory:
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def _watch(self) -> None:
        while not self._over.wait(0.05):
            for name, now in self._now().items():
                self.most[name] = max(self.most[name], now)

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()


@click.command()
@click.argument("what", type=click.Choice(["same", "killed", "lost", "memory"]))
@click.option("--runs", default=3, show_default=True, type=click.IntRange(min=1))
@click.option("--only", default=_KINDS, show_default=True)
@click.option("--size", default="160x96", show_default=True, type=picture_size, help="Of others.")
@click.option("--frames", default=2000, show_default=True, help="Of the film for memory.")
def main(what: str, runs: int, only: str, frames: int, size: tuple[int, int]) -> None:
    """Measure executors and clusters."""
    print(machine())
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        if what == "memory":
            memory(directory, frames)
            return
        source = film(directory / "small.mkv", 200, size)
        functions: dict[str, Any] = {
            "same": functools.partial(same, runs=runs, names=only),
            "killed": killed,
            "lost": lost,
        }
        functions[what](directory, source)


if __name__ == "__main__":
    sys.exit(main())
