"""Entries of a plane table as they are coded."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.bitstream.plane_entries import ENTRY_START, CodedEntry, take_entries
from gsvrcodec.errors import CorruptError

ENTRIES = st.builds(
    CodedEntry,
    codec=st.integers(0, 15),
    bits=st.integers(1, 16),
    step=st.integers(0, 2**16 - 1),
    first=st.integers(-(2**31), 2**31 - 1),
    size=st.integers(0, 2**32 - 1),
)
#: 3 + 2 + 1 bytes.
ENTRY = CodedEntry(codec=4, bits=9, step=32768, first=-300, size=100)


@given(entries=st.lists(ENTRIES, max_size=5), before=st.binary(max_size=3))
def test_round_trip(entries: list[CodedEntry], before: bytes) -> None:
    data = before + b"".join(entry.to_bytes() for entry in entries)
    assert take_entries(data + b"more", len(before), len(entries)) == (entries, len(data))


def test_the_bytes_are_those_of_the_spec() -> None:
    """Codec and bits, the number of the step, zigzag, bytes of the plane."""
    assert ENTRY.to_bytes() == bytes([4 + 16 * 8, 0, 128, 0x80 | 599 & 0x7F, 599 >> 7, 100])


@pytest.mark.parametrize("first", [0, -1, 1, -64, 63])
def test_small_first_values_take_a_byte(first: int) -> None:
    assert len(ENTRY._replace(first=first).to_bytes()) == ENTRY_START.size + 2


def test_every_cut_fails() -> None:
    data = 2 * ENTRY.to_bytes()
    for size in range(len(data)):
        with pytest.raises(CorruptError, match="plane table of 2 planes cut short") as error:
            take_entries(data[:size], 0, 2)
        assert error.value.section == "5.3"


@pytest.mark.parametrize("name", ["first", "size"])
def test_more_than_32_bits_fail(name: str) -> None:
    with pytest.raises(CorruptError, match="more than 32 bits"):
        take_entries(ENTRY._replace(**{name: 2**32}).to_bytes(), 0, 1)


def test_an_overlong_number_fails() -> None:
    data = ENTRY.to_bytes()[: ENTRY_START.size] + b"\x80\0" + b"\0"
    with pytest.raises(CorruptError, match="overlong number"):
        take_entries(data, 0, 1)
