"""Encodes are as good and as small as the committed figures say; see `tests.encoder.quality`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.encoder import quality

pytestmark = pytest.mark.slow


def test_every_encode_has_figures() -> None:
    assert quality.committed().keys() == quality.ENCODES.keys()


@pytest.mark.parametrize("name", quality.ENCODES)
def test_figures_hold(name: str, tmp_path: Path) -> None:
    expected, found = quality.committed()[name], quality.encoded(name, tmp_path)
    hint = "if the change is meant, run python -m tests.encoder.quality --why '...'"
    assert abs(found.psnr - expected.psnr) <= quality.PSNR_BOUND, hint
    assert abs(found.bytes / expected.bytes - 1) <= quality.BYTES_BOUND[name], hint
