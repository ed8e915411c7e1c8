"""The constants of reconstruction are the same in Python and in C++."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.model import reconstruction
from gsvrcodec.native import _core


def test_the_native_core_has_all() -> None:
    assert set(_core.constants()) == {name for name in vars(reconstruction) if name.isupper()}


@pytest.mark.parametrize("name", sorted(_core.constants()))
def test_the_native_core_has_the_same_value(name: str) -> None:
    assert _core.constants()[name] == np.float32(getattr(reconstruction, name))
