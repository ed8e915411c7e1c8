"""Kills encodes at random moments and resumes them: `python -m tests.faults.kills --times 20`."""

from __future__ import annotations

import argparse
import random
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from tests import making
from tests.cli.tools import start

#: Two chains of two GOPs, which take about as long as the libraries take to load.
OPTIONS = (
    *("-q", "--frames", "16", "--gop", "4", "--keyint", "0.5"),
    *("--gaussians", "200", "--preset", "fastest"),
    *("--pack", "deflate", "--threads", "2"),
)


def encode(target: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start an encode that goes on with what is there."""
    args = (*OPTIONS, *options, "-y", "--resume")
    return start("gsvrenc", making.NOISE, target, *args, stderr=subprocess.PIPE)


def finish(process: subprocess.Popen[bytes]) -> None:
    """Wait for an encode that must succeed."""
    message = process.communicate(timeout=300)[1].decode()
    assert process.returncode == 0, message


def children(process: subprocess.Popen[bytes]) -> list[int]:
    """The processes that a process has started."""
    tasks = Path(f"/proc/{process.pid}/task").glob("*/children")
    return [int(pid) for path in tasks for pid in path.read_text().split()]


def gone(pid: int) -> bool:
    """Whether a process has ended, though perhaps nobody has asked for its status yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def await_checkpoint(process: subprocess.Popen[bytes], state: Path) -> None:
    """Wait until an encode keeps a checkpoint, or has ended."""
    while not state.exists() and process.poll() is None:
        time.sleep(0.01)


def ended_within(process: subprocess.Popen[bytes], seconds: float) -> bool:
    """Whether a process ends before so many seconds have passed; waits for the earlier of both."""
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def kill_and_resume(directory: Path, times: int, seed: int = 0, *, often: int = 1) -> list[int]:
    """Kill encodes at random moments and compare the resumed files with an uninterrupted one.

    Args:
        directory: an empty one to work in.
        times: how many encodes to kill.
        seed: of the moments.
        often: how many times an encode is killed before it may finish.

    Returns:
        Bytes that each killed encode had kept.
    """
    whole, target = directory / "whole.gsvr", directory / "a.gsvr"
    state = directory / "a.gsvr.part"
    process = encode(whole, "--workers", "1")
    await_checkpoint(process, directory / "whole.gsvr.part")
    began = time.monotonic()
    finish(process)
    span = time.monotonic() - began  # of the encode proper: the libraries were loaded before
    draw = random.Random(seed)
    kept = []
    for number in range(times):
        workers = str(number % 2 + 1)
        ended = True
        while ended:
            process = encode(target, "--workers", workers)
            await_checkpoint(process, state)
            began = time.monotonic()
            ended = ended_within(process, draw.uniform(0, 0.9 * span))
            if ended:  # faster than the encode that was timed
                span = time.monotonic() - began
                finish(process)
                assert target.read_bytes() == whole.read_bytes(), f"round {number}: other bytes"
                target.unlink()
        started = children(process)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        kept.append(state.stat().st_size if state.exists() else 0)
        deadline = time.monotonic() + 20
        while not all(map(gone, started)):
            assert time.monotonic() < deadline, "a killed encoder's processes go on"
            time.sleep(0.02)
        if (number + 1) % often and number + 1 < times:
            continue
        finish(encode(target, "--workers", workers))
        assert target.read_bytes() == whole.read_bytes(), f"round {number}: other bytes"
        left = sorted(path.name for path in directory.iterdir())
        assert left == ["a.gsvr", "whole.gsvr"], left
        target.unlink()
    return kept


def main() -> None:
    """Print how it went."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        kept = kill_and_resume(Path(directory), options.times, options.seed)
    print(f"{len(kept)} kills, {len(kept)} files equal to the uninterrupted one")
    print(f"bytes kept at each kill: {', '.join(map(str, kept))}")


if __name__ == "__main__":
    main()
