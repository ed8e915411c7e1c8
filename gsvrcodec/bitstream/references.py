"""Chains of references: which GOP each GOP is predicted from (spec section "GOP head")."""

from __future__ import annotations

from collections.abc import Iterable

from gsvrcodec.bitstream.gop_head import GopEntry
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits


class References:
    """The references of GOPs, in file order; GOPs are added as they become known.

    Args:
        limits: Limits on the content.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._gops: list[GopEntry] = []
        self._positions: dict[int, int] = {}  # by first frame
        self._references: list[int | None] = []  # None = a key GOP, or the reference was lost
        self._lengths: list[int] = []  # of the chain that ends with the GOP

    def add(self, gops: Iterable[GopEntry]) -> None:
        """Add GOPs behind those known.

        Raises:
            LimitError: A chain of references is over the limit.
        """
        for gop in gops:
            reference = None if gop.is_key else self._positions.get(gop.reference_frame)
            length = 1 if reference is None else self._lengths[reference] + 1
            self._limits.check("chain", length, "the number of GOPs in a chain of references")
            self._positions[gop.first_frame] = len(self._gops)
            self._references.append(reference)
            self._lengths.append(length)
            self._gops.append(gop)

    def reference_of(self, position: int) -> int | None:
        """Position of the GOP that a GOP is predicted from; None = a key GOP.

        Raises:
            CorruptError: The reference was lost.
        """
        gop, reference = self._gops[position], self._references[position]
        if reference is None and not gop.is_key:
            raise CorruptError(
                f"the GOP at frame {gop.reference_frame} is lost, "
                f"which the GOP at frame {gop.first_frame} is predicted from",
                chunk=gop.chunk.name,
                offset=gop.offset,
                section="5.1",
            )
        return reference

    def chain_of(self, position: int) -> list[int]:
        """Positions of the GOPs that a GOP needs: from its key GOP up to itself.

        Raises:
            CorruptError: A GOP of the chain was lost.
        """
        chain = [position]
        while (reference := self.reference_of(chain[-1])) is not None:
            chain.append(reference)
        return chain[::-1]

    def warnings(self) -> list[str]:
        """A warning if references of GOPs were lost."""
        lost = [
            gop.first_frame
            for gop, reference in zip(self._gops, self._references, strict=True)
            if reference is None and not gop.is_key
        ]
        if not lost:
            return []
        return [f"{len(lost)} GOPs are predicted from lost ones, the first at frame {lost[0]}"]
