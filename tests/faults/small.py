"""The small file that the faults are made in, and how it is read."""

from __future__ import annotations

import io

from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.limits import Limits
from tests.gops import make_file, make_payloads
from tests.tampering import pieces

PAYLOADS = make_payloads(3, gaussians=4)
FILE = make_file(PAYLOADS, auxiliary=((b"sett", b"{}"),))
CHUNKS = pieces(FILE)
HEAD, FIRST, SECOND = CHUNKS[:3]


def opened(data: bytes, limits: Limits | None = None) -> GsvrReader:
    return GsvrReader(io.BytesIO(data), limits or Limits())
