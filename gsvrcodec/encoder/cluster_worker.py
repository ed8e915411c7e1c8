"""What runs on the workers of a cluster: their versions, and the fit of a chain."""

from __future__ import annotations

import logging
import os
import pickle
from collections.abc import Mapping
from typing import Any

from gsvrcodec.encoder.chain_task import ChainTask, FittedGop, one_by_one
from gsvrcodec.encoder.jobs import encode_gop
from gsvrcodec.encoder.workers import sendable
from gsvrcodec.versions import versions

#: Evaluated by workers, which may not have gsvrcodec at all.
VERSIONS = "__import__('gsvrcodec.versions', fromlist=['versions']).versions()"
#: Loads the libraries of a fit during the analysis of the film.
LOAD = "__import__('gsvrcodec.encoder.jobs') and None"
#: Versions that must be the same, and those without which files may differ.
_REQUIRED, _WANTED = ("gsvrcodec", "bitstream", "sources"), ("native core", "torch", "Triton")

_log = logging.getLogger(__name__)


def fault(address: str, told: Any) -> str | None:
    """Return why the versions of a worker forbid it; warn of versions that may change bytes."""
    if isinstance(told, ModuleNotFoundError):
        return f"the worker at {address} has no gsvrcodec ({told})"
    if not isinstance(told, Mapping):
        return f"the worker at {address} does not tell its version of gsvrcodec ({told})"
    own = versions()
    for name in (*_REQUIRED, *_WANTED):
        if told.get(name) == own[name]:
            continue
        what = f"has {name} {told.get(name)}, not {own[name]}"
        if name in _REQUIRED:
            return f"the worker at {address} {what}"
        _log.warning("a worker %s: the file may differ from one that is made here", what)
    return None


def encoded(data: bytes, threads: int) -> list[FittedGop] | Exception:
    """Encode a pickled chain on a worker, and return the GOPs or the error.

    Args:
        data: the chain.
        threads: native threads; 0 = GSVR_THREADS, or as many as the worker was started with.
    """
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()
    if not threads and "GSVR_THREADS" not in os.environ:
        threads = worker.state.nthreads
    done: list[FittedGop] = []
    try:
        task: ChainTask = pickle.loads(data)
        for gop in one_by_one(task.jobs(), encode_gop, threads):
            done.append(gop)
            known = worker.state.tasks.get(key)
            if known is None or known.state != "executing":
                break  # nobody wants it any more
    except Exception as error:
        return sendable(error)
    return done
