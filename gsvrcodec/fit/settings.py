"""Everything that an encode can be told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Preset = Literal["fastest", "fast", "medium", "slow", "slowest"]
Profile = Literal["main", "paper"]
Deform = Literal["hybrid", "triplane", "polynomial"]
Flow = Literal["dis", "raft"]
Pack = Literal["auto", "jxl", "png", "deflate"]


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
    gop_min: int = 8  #: shortest adaptive GOP between scene cuts, frames
    gop_max: int = 48  #: longest adaptive GOP, frames
    flow: Flow = "dis"  #: optical flow for slicing and motion start
    qat: bool = True  #: fine-tune under fake quantisation
    pack: Pack = "auto"  #: plane codecs to choose from; "auto" = smallest for each plane
    seed: int = 0  #: of every random choice
    threads: int = 0  #: native threads; 0 = GSVR_THREADS or all cores
    crop: tuple[int, int, int | None, int | None] | None = None  #: width, height, x, y; None = centre
    start_frame: int = 0  #: first frame to encode
    frames: int | None = None  #: frames to encode; None = to the end
