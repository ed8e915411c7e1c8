"""Pictures as torch tensors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import gsvrcodec
from gsvrcodec import Frame
from gsvrcodec.errors import UsageError


@pytest.mark.parametrize(("bit_depth", "dtype"), [(8, torch.uint8), (10, torch.uint16)])
def test_equal_the_arrays(path: Path, bit_depth: int, dtype: torch.dtype) -> None:
    with (
        gsvrcodec.open(path, bit_depth=bit_depth) as arrays,
        gsvrcodec.open(path, bit_depth=bit_depth, tensors=True) as tensors,
    ):
        pairs: list[tuple[Any, Any]] = [
            (arrays[7].data, tensors[7].data),
            (arrays[3:12:4].data, tensors[3:12:4].data),
            (arrays.render(0.1, size=(20, 30)), tensors.render(0.1, size=(20, 30))),
            *((a.data, t.data) for a, t in zip(arrays, tensors, strict=True)),
        ]
        for array, tensor in pairs:
            assert isinstance(tensor, torch.Tensor)
            assert (tensor.dtype, tensor.device.type) == (dtype, "cpu")
            assert tensor.is_contiguous()
            np.testing.assert_array_equal(tensor.numpy(), array)


def test_a_frame_gives_a_tensor_of_its_memory(path: Path) -> None:
    with gsvrcodec.open(path) as arrays, gsvrcodec.open(path, tensors=True) as tensors:
        frame, batch = arrays[7], arrays[3:5]
        for tensor, data in ((frame.tensor, frame.data), (batch.tensor, batch.data)):
            assert tensor.numpy().ctypes.data == data.ctypes.data
        given = tensors[7]
        assert id(given.tensor) == id(given.data)


@pytest.mark.parametrize("size", [None, (45, 31)])
def test_planar(path: Path, size: tuple[int, int] | None) -> None:
    with (
        gsvrcodec.open(path, size=size) as arrays,
        gsvrcodec.open(path, size=size, planar=True) as planar,
        gsvrcodec.open(path, size=size, planar=True, tensors=True) as tensors,
    ):
        between = arrays.metadata.begin_seconds + arrays.metadata.duration_seconds * 2 / 7
        pictures = (
            (decoder[2:13].data, decoder.render_many([between, 0.1]))
            for decoder in (arrays, planar, tensors)
        )
        for expected, array, tensor in zip(*pictures, strict=True):
            seen: Any = tensor
            assert array.transpose(0, 3, 1, 2).flags.c_contiguous
            assert seen.permute(0, 3, 1, 2).is_contiguous()
            np.testing.assert_array_equal(array, expected)
            np.testing.assert_array_equal(seen.numpy(), expected)


def test_times_stay_arrays(path: Path, sequence: list[Frame]) -> None:
    with gsvrcodec.open(path, tensors=True) as decoder:
        batch = decoder[:]
    assert isinstance(batch.pts, np.ndarray)
    assert [frame.pts for frame in batch] == [frame.pts for frame in sequence]


def test_may_be_changed(path: Path, sequence: list[Frame]) -> None:
    with gsvrcodec.open(path, tensors=True) as decoder:
        changed: Any = decoder[4].data
        changed.zero_()
        again: Any = decoder[4].data
    np.testing.assert_array_equal(again.numpy(), sequence[4].data)


def test_and_arrays_fail(path: Path) -> None:
    with pytest.raises(UsageError, match="`arrays` and `tensors` exclude each other"):
        gsvrcodec.open(path, arrays=True, tensors=True)
