"""What a fit can be told; light to import."""

from __future__ import annotations

from typing import Literal

Deform = Literal["hybrid", "triplane", "polynomial"]
Flow = Literal["dis", "raft"]
