"""Encodes on a real cluster on the loopback: the same bytes, and clear ends whatever dies."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import gsvrcodec
from gsvrcodec.encoder.progress import Progress
from gsvrcodec.encoder.run import dask as cluster
from gsvrcodec.errors import ClusterError, UsageError, WorkerError
from gsvrcodec.versions import versions
from tests import making
from tests.cli.tools import start
from tests.encoder.clusters import Machines, machines

pytest.importorskip("distributed", reason="needs gsvrcodec[cluster]")
# Dask's clients leave their event loops and sockets to the garbage collector.
pytestmark = [pytest.mark.filterwarnings("ignore::ResourceWarning"), pytest.mark.slow]

#: Seven chains of one or two GOPs.
SETTINGS: dict[str, Any] = {
    **{"gop": 2, "keyint": 0.2, "frames": 20, "preset": "fastest"},
    **{"gaussians": 40, "pack": "deflate"},
}
OPTIONS = (
    *("--gop", "2", "--keyint", "0.2", "--frames", "20", "--preset", "fastest"),
    *("--gaussians", "40", "--pack", "deflate"),
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file of an encode without cluster."""
    target = tmp_path_factory.mktemp("whole") / "a.gsvr"
    gsvrcodec.encode(making.NOISE, target, workers=1, **SETTINGS)
    return target.read_bytes()


@pytest.fixture(scope="module")
def three() -> Iterator[Machines]:
    """A cluster of three workers; one test after another takes some of it away."""
    with machines(3) as found:
        yield found


def joined(found: gsvrcodec.Cluster, count: int) -> None:
    """Wait until so many workers have joined."""
    late = time.monotonic() + 20
    while found.workers < count:
        assert time.monotonic() < late
        time.sleep(0.05)


class TestWhatDies:
    """In this order: the cluster becomes smaller."""

    def test_nothing(self, three: Machines, whole: bytes, tmp_path: Path) -> None:
        calls: list[Progress] = []
        with gsvrcodec.Cluster(three.address) as found:
            joined(found, 3)
            gsvrcodec.encode(
                making.NOISE,
                tmp_path / "a.gsvr",
                executor=found,
                progress=calls.append,
                **SETTINGS,
            )
        assert (tmp_path / "a.gsvr").read_bytes() == whole
        fitting = [call for call in calls if call.phase == "fitting"]
        assert {call.workers for call in fitting} == {3}
        assert (fitting[0].chains_done, fitting[-1].chains_done) == (0, fitting[0].chains)

    def test_a_worker(self, three: Machines, whole: bytes, tmp_path: Path) -> None:
        killed: list[int] = []

        def kill(state: Progress) -> None:
            if state.gop and not killed:
                killed.append(three.workers[0].pid)
                three.workers[0].kill()

        with gsvrcodec.Cluster(str(three.file)) as found:
            joined(found, 3)
            gsvrcodec.encode(
                making.NOISE, tmp_path / "a.gsvr", executor=found, progress=kill, **SETTINGS
            )
        assert killed
        assert (tmp_path / "a.gsvr").read_bytes() == whole

    def test_the_command_line_says_who_works(
        self, three: Machines, whole: bytes, tmp_path: Path
    ) -> None:
        process = start(
            *("gsvrenc", making.NOISE, tmp_path / "a.gsvr", "--cluster", "auto"),
            *("--shared-source", *OPTIONS),
            environment={"DASK_SCHEDULER_ADDRESS": three.address},
            stderr=subprocess.PIPE,
        )
        err = process.communicate(timeout=120)[1].decode()
        assert process.returncode == 0, err
        assert f"chains, {len(three.workers) - 1} workers" in err
        assert (tmp_path / "a.gsvr").read_bytes() == whole

    def test_the_scheduler(self, three: Machines, whole: bytes, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        process = start(
            *("gsvrenc", making.NOISE, target, "--cluster", three.address, *OPTIONS),
            stderr=subprocess.PIPE,
        )
        assert process.stderr is not None
        for line in process.stderr:
            if b"GOP 1/" in line:
                three.scheduler.kill()
                break
        err = process.communicate(timeout=60)[1].decode()
        assert process.returncode == 1
        lines = [line for line in err.splitlines() if "GOP " not in line or "error" in line]
        assert re.fullmatch(
            r"gsvrenc: error: the scheduler at tcp://\S+ was lost; \d+ finished GOPs? (is|are) "
            r"kept in .*\.part, --resume goes on from there",
            "\n".join(lines),
        )
        gsvrcodec.encode(making.NOISE, target, resume=True, **SETTINGS)
        assert target.read_bytes() == whole

    def test_all_workers_of_one_chain(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        deadly = eval("lambda data, threads: __import__('os')._exit(1)", {"__name__": "nowhere"})
        monkeypatch.setattr(cluster, "encoded", deadly)
        with machines(3) as three, gsvrcodec.Cluster(three.address) as found:
            joined(found, 3)
            with pytest.raises(WorkerError, match="3 workers died of the chain of GOPs at frame 0"):
                gsvrcodec.encode(
                    making.NOISE,
                    tmp_path / "a.gsvr",
                    executor=found,
                    **(SETTINGS | {"frames": 4, "keyint": 4}),
                )
        assert not list(tmp_path.iterdir())


class TestRefused:
    def test_nothing_listens(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(cluster, "_CONNECT_SECONDS", 1.0)
        with pytest.raises(ClusterError, match=r"no scheduler .* answers at tcp://127.0.0.1:9 "):
            gsvrcodec.Cluster("tcp://127.0.0.1:9")

    def test_no_such_file(self) -> None:
        with pytest.raises(ClusterError, match="no such scheduler file"):
            gsvrcodec.Cluster("not-here.json")

    def test_no_address(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(_dask_settings(), "scheduler-address", None)
        with pytest.raises(UsageError, match="DASK_SCHEDULER_ADDRESS, which is not set"):
            gsvrcodec.Cluster("auto")

    def test_no_workers(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(cluster, "_PATIENCE_SECONDS", 0.0)
        with machines(0) as none, pytest.raises(ClusterError, match="has had no worker for 0 s"):
            gsvrcodec.Cluster(none.address)

    def test_another_version(self, tmp_path: Path) -> None:
        own = versions() | {"gsvrcodec": "0.0.9"}
        self.fails(tmp_path, f"def versions(): return {own}", r"has gsvrcodec 0\.0\.9, not \d")

    def test_other_code_of_the_same_version(self, tmp_path: Path) -> None:
        own = versions() | {"sources": "0123"}
        self.fails(tmp_path, f"def versions(): return {own}", "has sources 0123, not ")

    def test_no_gsvrcodec(self, tmp_path: Path) -> None:
        self.fails(
            tmp_path,
            "raise ModuleNotFoundError(\"No module named 'gsvrcodec'\")",
            r"has no gsvrcodec \(No module",
        )

    def fails(self, directory: Path, code: str, message: str) -> None:
        """Join a worker whose gsvrcodec is this code."""
        (directory / "gsvrcodec").mkdir()
        (directory / "gsvrcodec" / "__init__.py").write_text("")
        (directory / "gsvrcodec" / "versions.py").write_text(code)
        (directory / "sitecustomize.py").write_text(_PATH_FIRST)
        with (
            machines(1, environment={"PYTHONPATH": str(directory)}) as one,
            pytest.raises(ClusterError, match=rf"the worker at tcp://\S+ {message}"),
        ):
            gsvrcodec.Cluster(one.address)

    def test_other_kernels_are_a_warning(self, caplog: pytest.LogCaptureFixture) -> None:
        assert cluster.fault("x", versions()) is None
        assert not caplog.records
        assert cluster.fault("x", versions() | {"native core": "none"}) is None
        assert "a worker has native core none, not" in caplog.text
        assert cluster.fault("x", OSError("why")) is not None

    def test_other_work(self) -> None:
        found = gsvrcodec.Cluster.__new__(gsvrcodec.Cluster)
        with pytest.raises(TypeError, match="chains and nothing else"):
            found.submit(print)


#: What a process runs at its start, to find packages by the path before editable installs.
_PATH_FIRST = """
import sys
from importlib.machinery import PathFinder
sys.meta_path.remove(PathFinder)
sys.meta_path.insert(0, PathFinder)
"""


def _dask_settings() -> dict[str, Any]:
    import dask

    settings: dict[str, Any] = dask.config.config
    return settings
