"""A video codec whose picture is a weighted mean of moving 2D Gaussians.

    import gsvrcodec

    gsvrcodec.encode("in.mp4", "out.gsvr")
    with gsvrcodec.open("out.gsvr") as decoder:
        picture = decoder[17].data  # (H, W, 3) uint8
    gsvrcodec.decode("out.gsvr", "out.mp4")

Public names are imported at first use: importing the package is fast. On a CPU neither encoding nor
decoding imports torch, and decoding no OpenCV.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gsvrcodec import errors
    from gsvrcodec.dataset import ClipDataset
    from gsvrcodec.decoder.decoder import Decoder, open
    from gsvrcodec.decoder.export import DecodeResult, decode
    from gsvrcodec.decoder.frames import Frame, FrameBatch, Metadata
    from gsvrcodec.encoder.encode import encode
    from gsvrcodec.encoder.progress import Progress
    from gsvrcodec.encoder.results import EncodeResult, GopStats
    from gsvrcodec.encoder.run.dask import Cluster
    from gsvrcodec.encoder.settings import EncodeSettings
    from gsvrcodec.limits import Limits

__all__ = [
    "ClipDataset",
    "Cluster",
    "DecodeResult",
    "Decoder",
    "EncodeResult",
    "EncodeSettings",
    "Frame",
    "FrameBatch",
    "GopStats",
    "Limits",
    "Metadata",
    "Progress",
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
    "Cluster": "gsvrcodec.encoder.run.dask",
    "DecodeResult": "gsvrcodec.decoder.export",
    "Decoder": "gsvrcodec.decoder.decoder",
    "EncodeResult": "gsvrcodec.encoder.results",
    "EncodeSettings": "gsvrcodec.encoder.settings",
    "Frame": "gsvrcodec.decoder.frames",
    "FrameBatch": "gsvrcodec.decoder.frames",
    "GopStats": "gsvrcodec.encoder.results",
    "Limits": "gsvrcodec.limits",
    "Metadata": "gsvrcodec.decoder.frames",
    "Progress": "gsvrcodec.encoder.progress",
    "decode": "gsvrcodec.decoder.export",
    "encode": "gsvrcodec.encoder.encode",
    "open": "gsvrcodec.decoder.decoder",
}


def __getattr__(name: str) -> Any:
    """Import a public name at first use."""
    if name in _HOMES:
        try:
            value = getattr(importlib.import_module(_HOMES[name]), name)
        except ModuleNotFoundError as error:
            where = (
                "pip install torch"
                if error.name == "torch"
                else "which gsvrcodec-decoder comes without: install gsvrcodec in its place"
            )
            message = f"`gsvrcodec.{name}` needs {error.name}, {where}"
            raise ModuleNotFoundError(message, name=error.name) from error
    elif name == "errors":
        value = importlib.import_module("gsvrcodec.errors")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})
