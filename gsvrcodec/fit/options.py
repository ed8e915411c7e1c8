"""What a fit can be told; light to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Deform = Literal["hybrid", "triplane", "polynomial"]
Flow = Literal["dis", "raft"]
Profile = Literal["main", "paper"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """How GOPs are fitted."""

    profile: Profile = "main"  #: "paper" = start, rates and quantisation of the publication
    deform: Deform = "hybrid"  #: parts of the deformation field in use
    flow: Flow = "dis"  #: optical flow that the Gaussians' motion starts from
    tune: bool = True  #: fine-tune under quantisation
