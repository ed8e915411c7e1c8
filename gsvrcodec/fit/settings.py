"""Everything that an encode can be told."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args, get_type_hints

from gsvrcodec.errors import UsageError
from gsvrcodec.limits import Limits

Preset = Literal["fastest", "fast", "medium", "slow", "slowest"]
Profile = Literal["main", "paper"]
Deform = Literal["hybrid", "triplane", "polynomial"]
Flow = Literal["dis", "raft"]
Pack = Literal["auto", "entropy", "jxl", "png", "deflate"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EncodeSettings:
    """What an encode is asked for; the same fields as the options of `gsvrenc`."""

    params: int | None = None  #: stored numbers in the whole file; None = by picture size
    gaussians: int | None = None  #: Gaussians in each GOP; excludes `params`
    preset: Preset = "medium"  #: optimisation effort; excludes `time_budget`
    time_budget: float | None = None  #: seconds a frame for the whole encode; None = by preset
    profile: Profile = "main"  #: "paper" = the publication as it stands, for comparison
    deform: Deform = "hybrid"  #: parts of the deformation field in use
    gop: int | Literal["adaptive"] = "adaptive"  #: frames in a GOP, or by motion
    gop_min: int = 12  #: shortest adaptive GOP between scene cuts, frames
    gop_max: int = 32  #: longest adaptive GOP, frames
    flow: Flow = "dis"  #: optical flow for slicing and motion start
    qat: bool = True  #: fine-tune under fake quantisation
    pack: Pack = "auto"  #: plane codecs to choose from; "auto" = smallest for each plane
    seed: int = 0  #: of every random choice
    threads: int = 0  #: native threads; 0 = GSVR_THREADS or all cores
    #: width, height, x, y in pixels; x and y None = centre
    crop: tuple[int, int, int | None, int | None] | None = None
    start_frame: int = 0  #: first frame to encode
    frames: int | None = None  #: frames to encode; None = to the end

    def __post_init__(self) -> None:
        """Check each value, and that they do not contradict each other.

        Raises:
            UsageError: naming the option, as `gsvrenc` spells it.
        """
        hints = get_type_hints(type(self))
        for name in ("preset", "profile", "deform", "flow", "pack"):
            if getattr(self, name) not in get_args(hints[name]):
                allowed = ", ".join(get_args(hints[name]))
                raise UsageError(f"--{name} must be one of {allowed}, not {getattr(self, name)!r}")
        if self.params is not None and self.gaussians is not None:
            raise UsageError("--params and --gaussians exclude each other; give one")
        if self.time_budget is not None and self.preset != _DEFAULT_PRESET:
            raise UsageError("--preset and --time-budget exclude each other; give one")
        for name, low in _LOWEST.items():
            value = getattr(self, name)
            if isinstance(value, int) and value < low:
                raise UsageError(f"--{name.replace('_', '-')} must be at least {low}, not {value}")
        for name, high in _HIGHEST.items():
            value = getattr(self, name)
            if isinstance(value, int) and value > high:
                raise UsageError(f"--{name.replace('_', '-')} must be at most {high}, not {value}")
        if self.time_budget is not None and not 0 < self.time_budget < float("inf"):
            raise UsageError(f"--time-budget must be above 0 seconds, not {self.time_budget}")
        if self.gop != "adaptive" and not isinstance(self.gop, int):
            raise UsageError(f"--gop must be 'adaptive' or a number of frames, not {self.gop!r}")
        if self.gop_min > self.gop_max:
            raise UsageError(
                f"--gop-min {self.gop_min} is more than --gop-max {self.gop_max}; lower it"
            )

    def recorded(self) -> dict[str, Any]:
        """What the file keeps: all that shapes its content."""
        kept = asdict(self)
        del kept["threads"]
        return kept


_DEFAULT_PRESET: Preset = "medium"
_LOWEST = {
    "params": 1,
    "gaussians": 1,
    "gop": 1,
    "gop_min": 1,
    "gop_max": 1,
    "seed": 0,
    "threads": 0,
    "start_frame": 0,
    "frames": 1,
}
#: What decoders take without being told otherwise.
_HIGHEST = {
    "gaussians": Limits().gaussians,
    "gop": Limits().gop_frames,
    "gop_max": Limits().gop_frames,
}
