"""A video codec whose picture is a weighted mean of moving 2D Gaussians.

    import gsvrcodec

    gsvrcodec.encode("in.mp4", "out.gsvr")
    with gsvrcodec.open("out.gsvr") as decoder:
        picture = decoder[17].data  # (H, W, 3) uint8
    gsvrcodec.decode("out.gsvr", "out.mp4")

Public names are imported at first use: importing the package is fast, and decoding on the CPU
never imports torch or OpenCV.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gsvrcodec import errors
    from gsvrcodec.dataset import ClipDataset
    from gsvrcodec.decoder.decoder import Decoder, open
    from gsvrcodec.decoder.export import decode
    from gsvrcodec.decoder.frames import Frame, FrameBatch, Metadata
    from gsvrcodec.encoder.cluster import Cluster
    from gsvrcodec.encoder.encode import encode
    from gsvrcodec.limits import Limits

__all__ = [
    "ClipDataset",
    "Cluster",
    "Decoder",
    "Frame",
    "FrameBatch",
    "Limits",
    "Metadata",
    "__version__",
    "decode",
    "encode",
    "errors",
    "open",
]

__version__ = "0.1.0"

#: Module of each public name.
_HOMES = {
    "ClipDataset": "gsvrcodec.dataset",
    "Cluster": "gsvrcodec.encoder.cluster",
    "Decoder": "gsvrcodec.decoder.decoder",
    "Frame": "gsvrcodec.decoder.frames",
    "FrameBatch": "gsvrcodec.decoder.frames",
    "Limits": "gsvrcodec.limits",
    "Metadata": "gsvrcodec.decoder.frames",
    "decode": "gsvrcodec.decoder.export",
    "encode": "gsvrcodec.encoder.encode",
    "open": "gsvrcodec.decoder.decoder",
}


def __getattr__(name: str) -> Any:
    """Import a public name at first use."""
    if name in _HOMES:
        value = getattr(importlib.import_module(_HOMES[name]), name)
    elif name == "errors":
        value = importlib.import_module("gsvrcodec.errors")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})
