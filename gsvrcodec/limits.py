"""Limits of a decoder on the size of a file's content (spec section "Limits").

The program or the environment sets the limits, never the file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields

from gsvrcodec.errors import LimitError, UsageError

#: Prefix of the environment variables; the field's name in capitals follows: GSVR_LIMIT_WIDTH.
ENVIRONMENT_PREFIX = "GSVR_LIMIT_"


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Upper bounds, inclusive; a file over one raises `LimitError` before anything is allocated."""

    width: int = 32768  #: coded width, pixels
    height: int = 32768  #: coded height, pixels
    pixels: int = 2**28  #: width * height
    gaussians: int = 2**24  #: Gaussians in one GOP, those carried over included
    gop_frames: int = 2**16  #: frames in one GOP
    chain: int = 1024  #: GOPs in a chain of references, its key GOP included
    chunks: int = 2**16  #: chunks in a file, GOPs among them
    plane_samples: int = 2**26  #: samples of one plane
    chunk_bytes: int = 2**31 - 1  #: bytes of one payload
    metadata_bytes: int = 2**20  #: bytes of one payload of JSON
    expansion_base: int = 2**26  #: bytes that every payload may expand to
    expansion_ratio: int = 4096  #: additional bytes for each byte of the payload

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> Limits:
        """The defaults, overridden by variables such as GSVR_LIMIT_WIDTH=8192.

        Args:
            environment: Variables by name; None = those of the process.

        Returns:
            The limits.

        Raises:
            UsageError: A variable is not a whole number of at least 1.
        """
        variables = os.environ if environment is None else environment
        values: dict[str, int] = {}
        for field in fields(cls):
            name = ENVIRONMENT_PREFIX + field.name.upper()
            text = variables.get(name)
            if text is None:
                continue
            if not (text.isascii() and text.isdigit() and len(text) <= 19 and int(text) >= 1):
                raise UsageError(f"{name} must be a whole number of at least 1, not {text!r}")
            values[field.name] = int(text)
        return cls(**values)

    def check(self, field: str, value: int, what: str) -> None:
        """Raise a LimitError if `value`, called `what` in the message, is over limit `field`."""
        limit: int = getattr(self, field)
        if value > limit:
            raise LimitError(
                f"{what} is {value}, over the limit of {limit} "
                f"(raise it with {ENVIRONMENT_PREFIX}{field.upper()})"
            )

    def check_expansion(self, expanded: int, payload: int) -> None:
        """Raise a LimitError if `payload` bytes would expand to too many bytes, `expanded`."""
        limit = self.expansion_base + self.expansion_ratio * payload
        if expanded > limit:
            raise LimitError(
                f"{payload} bytes would expand to {expanded} bytes, over the limit of {limit}"
            )
