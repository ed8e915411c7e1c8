"""The choice of the device that renders."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import torch

import gsvrcodec
from gsvrcodec.errors import DeviceError, UsageError
from gsvrcodec.render.device import choose_device

VECTOR = min((Path(__file__).parents[1] / "vectors" / "valid").glob("*.gsvr"))

no_gpu = pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
with_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


@pytest.mark.parametrize("device", ["gpu", "cuda:", "cuda:-1", "cuda:1234", "", "CPU"])
def test_unknown_fails(device: str) -> None:
    with pytest.raises(UsageError, match="`device` must be auto, cpu, cuda or cuda:N"):
        choose_device(device)


def test_cpu() -> None:
    assert choose_device("cpu") == "cpu"


@no_gpu
def test_auto_is_the_cpu_where_no_gpu_is() -> None:
    assert choose_device("auto") == "cpu"


@no_gpu
@pytest.mark.parametrize("device", ["cuda", "cuda:3"])
def test_missing_gpu_fails(device: str) -> None:
    with pytest.raises(DeviceError, match=rf"`device='{device}'`: .*; or choose `device='cpu'`$"):
        choose_device(device)
    with pytest.raises(DeviceError):
        gsvrcodec.open(VECTOR, device=device)


@no_gpu
def test_auto_loads_nothing() -> None:
    """Where there is no driver, it is known without torch."""
    code = (
        "import sys; from gsvrcodec.render.device import choose_device; choose_device('auto'); "
        "assert not {'torch', 'triton'} & set(sys.modules)"
    )
    if not Path("/dev/kfd").exists():
        subprocess.run([sys.executable, "-c", code], check=True)


def test_without_pytorch_or_triton(monkeypatch: pytest.MonkeyPatch) -> None:
    for missing, said in ({"torch", "triton"}, "torch triton"), ({"triton"}, "triton"):
        monkeypatch.setattr(
            gsvrcodec.render.device, "find_spec", lambda name, no=missing: None if name in no else 1
        )
        with pytest.raises(DeviceError, match=f"pip install {said};"):
            choose_device("cuda")


@with_gpu
def test_gpu() -> None:
    assert choose_device("auto") == choose_device("cuda") == "cuda:0"
    with pytest.raises(DeviceError, match="the GPUs here are cuda:0 to"):
        choose_device("cuda:900")
    with gsvrcodec.open(VECTOR, device="cuda") as decoder, gsvrcodec.open(VECTOR) as other:
        picture = decoder[0].data
        assert isinstance(picture, torch.Tensor)
        assert picture.is_cuda
        difference = (picture.cpu().int() - torch.from_numpy(other[0].data).int()).abs()
        assert difference.max() <= 1
