from typing import Any

# Arrays are C-contiguous float32 (images: uint8 or float32) on the CPU: NumPy or torch.
Array = Any

def isa() -> str: ...  # the instruction set in use
def isas() -> list[str]: ...  # those that this machine has, best first
def use_isa(name: str) -> None: ...
def constants() -> dict[str, float]: ...  # of reconstruction, by their Python names
def resolve_threads(requested: int) -> int: ...

class Parameters:
    def __init__(
        self,
        position: Array,
        log_scale: Array,
        rotation: Array,
        colour: Array,
        indicator: Array,
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
) -> None: ...
def squared_error(
    parameters: Parameters,
    tau: float,
    target: Array,
    coded_width: int,
    coded_height: int,
    gradient: Parameters,
    threads: int,
    backdrop: Array | None = None,
) -> float:
    """`backdrop` (height, width, 3) float32 is added to the frame."""

def adam_step(
    param: Array,
    grad: Array,
    m: Array,
    v: Array,
    lr: Array,
    beta1: float,
    beta2: float,
    eps: float,
    step: int,
    threads: int = 0,
) -> None:
    """One step of Adam in place; `lr` has one entry, or one for each column of the last axis."""
