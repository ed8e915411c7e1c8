"""The range coder of codecs 4 and 5 as the spec words it, for tests of the native one."""

from __future__ import annotations


class Corrupt(Exception):
    """The stream breaks a rule of the spec."""


def unzigzag(v: int) -> int:
    """0, -1, 1, -2, 2, ..."""
    return (v >> 1) ^ -(v & 1)


class Coder:
    """Reads head and words from the front, bits from the end."""

    def __init__(self, data: bytes):
        self._data = data
        self._front = 0
        self._position = 0
        self.state = 0

    def u8(self) -> int:
        """A byte of the head."""
        if self._front >= len(self._data):
            raise Corrupt
        self._front += 1
        return self._data[self._front - 1]

    def varint(self) -> int:
        """Seven bits a byte, the lowest first."""
        value = shift = 0
        while True:
            byte = self.u8()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7

    def begin(self) -> None:
        """Read the first state, after the head."""
        self.state = sum(self.u8() << shift for shift in (0, 8, 16, 24))
        if self.state < 2**16:
            raise Corrupt

    def slot(self, k: int) -> int:
        """Where the next interval lies among 2**k."""
        return self.state & ((1 << k) - 1)

    def advance(self, k: int, start: int, frequency: int) -> None:
        """Leave an interval."""
        self.state = frequency * (self.state >> k) + self.slot(k) - start
        if self.state < 2**16:
            self.state = self.state << 16 | self.u8() | self.u8() << 8

    def bits(self, n: int) -> int:
        """A number of n bits from the end."""
        value = 0
        for _ in range(n):
            index = len(self._data) - 1 - self._position // 8
            if index < self._front:
                raise Corrupt
            value = 2 * value + (self._data[index] >> (7 - self._position % 8) & 1)
            self._position += 1
        return value

    def finish(self) -> None:
        """Check that nothing is left."""
        if self.bits(-self._position % 8) or self.state != 2**16:
            raise Corrupt
        if self._front + self._position // 8 != len(self._data):
            raise Corrupt
