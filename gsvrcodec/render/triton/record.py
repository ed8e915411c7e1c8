"""Steps whose launches are recorded: a graph of CUDA is launched in the time of a few kernels."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import torch
from torch import Tensor
from torch.cuda import CUDAGraph

from gsvrcodec.render.backend import Samples, Scalar


class Recorder:
    """Records steps on one device.

    Memory that a step takes and gives back is shared by all recorded steps: they are repeated one
    after another.
    """

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self._stream: torch.cuda.Stream | None = None
        # It keeps the memory, which would be lost with the last graph.
        self._latest: CUDAGraph | None = None

    def record(self, step: Callable[..., None], arguments: Sequence[Tensor]) -> CUDAGraph:
        """Return what `step` launches, which is not done yet."""
        graph = CUDAGraph()
        # Blocks of memory belong to the stream that they are first used on: it is always the same.
        self._stream = self._stream or torch.cuda.Stream(self.device)
        self._stream.wait_stream(torch.cuda.current_stream(self.device))
        pool = None if self._latest is None else self._latest.pool()
        with torch.cuda.stream(self._stream), _no_garbage_collection():
            # Other threads may use the device meanwhile.
            graph.capture_begin(pool, capture_error_mode="thread_local")
            step(*arguments)
            graph.capture_end()
        self._latest = graph
        return graph


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Collect no garbage: a graph that is destroyed while another one is recorded ends that."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class Recorded:
    """A step that is recorded in its second call, and repeated from then on.

    Kernels are compiled in the first call, which no recording survives.

    Args:
        step: as `Backend.recorded` takes it.
        recorder: of the device.
    """

    def __init__(self, step: Callable[..., None], recorder: Recorder) -> None:
        self._step, self._recorder = step, recorder
        self._arguments: list[Tensor] = []
        self._graph: CUDAGraph | None = None

    def __call__(self, *arguments: Scalar | Samples) -> None:
        """Take the step."""
        device = self._recorder.device
        first = not self._arguments
        if first:
            self._arguments = [
                torch.empty_like(a) if isinstance(a, Tensor) else torch.empty(1, device=device)
                for a in arguments
            ]
        for own, value in zip(self._arguments, arguments, strict=True):
            if isinstance(value, Tensor):
                own.copy_(value)
            else:
                own.fill_(value)
        if first or device.type != "cuda":
            self._step(*self._arguments)
            return
        if self._graph is None:
            self._graph = self._recorder.record(self._step, self._arguments)
        self._graph.replay()
