from typing import Any

# Arrays are C-contiguous float32 (images: uint8 or float32) on the CPU: NumPy or torch.
Array = Any

def isa() -> str: ...
def resolve_threads(requested: int) -> int: ...

class Parameters:
    def __init__(
        self,
        position: Array,
        log_scale: Array,
        rotation: Array,
        colour: Array,
        alpha: Array,
        linear: Array,
        quadratic: Array,
        xy: Array,
        xt: Array,
        yt: Array,
    ) -> None: ...

def render_rgb8(
    parameters: Parameters,
    taus: Array,
    out: Array,
    coded_width: int,
    coded_height: int,
    threads: int,
) -> None: ...
def render_float(
    parameters: Parameters,
    taus: Array,
    out: Array,
    coded_width: int,
    coded_height: int,
    threads: int,
) -> None: ...
def backward_float(
    parameters: Parameters,
    tau: float,
    weights: Array,
    coded_width: int,
    coded_height: int,
    gradient: Parameters,
    threads: int,
) -> float: ...
def squared_error(
    parameters: Parameters,
    tau: float,
    target: Array,
    coded_width: int,
    coded_height: int,
    gradient: Parameters,
    threads: int,
) -> float: ...
