"""The native core: `_core` renders and takes GOPs over, `_entropy` codes planes."""

from pathlib import Path

try:
    from gsvrcodec.native import _core, _entropy
except ImportError as error:
    raise ImportError(
        f"the native core of gsvrcodec is not built in {Path(__file__).parent}: in a clone run "
        "pip install -e . or start Python elsewhere to use the gsvrcodec that is installed"
    ) from error

__all__ = ["_core", "_entropy"]
