"""The examples of docs/cluster.md, run as they are: the bytes of a local encode."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.video import open_video, open_writer
from tests import making
from tests.encoder.clusters import ROOT, example

pytestmark = pytest.mark.slow

PYTHON = [sys.executable, "encode.py"]
#: How the example that imports each package is run.
COMMANDS = {
    "multiprocessing": PYTHON,
    "loky": PYTHON,
    "ray": PYTHON,
    "mpi4py": ["mpiexec", "-n", "3", sys.executable, "-m", "mpi4py.futures", "encode.py"],
}
#: More processes than cores, also for root; nothing is reported to Ray's makers.
VARIABLES = {
    "PYTHONPATH": str(ROOT),
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "RAY_USAGE_STATS_ENABLED": "0",
}


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two chains: a cut after six frames."""
    path = tmp_path_factory.mktemp("film") / "in.mkv"
    with open_video(making.NOISE, (96, 64, None, None)) as video:
        shots = [shot.rgb for shot in islice(video, 6)]
    shots += [255 - np.rot90(rgb, 2) for rgb in shots]
    with open_writer(path, making.output_info(shots)) as writer:
        for number, rgb in enumerate(shots):
            writer.write(np.ascontiguousarray(rgb), number, 1)
    return path


@pytest.fixture(scope="module")
def whole(film: Path) -> bytes:
    """The file of an encode without executor."""
    result = gsvrcodec.encode(film, workers=1)
    assert result.key_gops == 2
    assert result.data is not None
    return result.data


@pytest.mark.parametrize("package", COMMANDS)
def test_an_example_gives_the_same_bytes(
    package: str, film: Path, whole: bytes, tmp_path: Path
) -> None:
    pytest.importorskip(package)
    if shutil.which(COMMANDS[package][0]) is None:
        pytest.skip(f"there is no {COMMANDS[package][0]}")
    shutil.copy(film, tmp_path / "in.mp4")
    (tmp_path / "encode.py").write_text(example(package))
    variables = {**os.environ, **VARIABLES}
    subprocess.run(COMMANDS[package], cwd=tmp_path, env=variables, check=True, timeout=120)
    assert (tmp_path / "out.gsvr").read_bytes() == whole
