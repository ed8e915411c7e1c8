"""The Triton kernels beyond `test_backends`; without a GPU, interpreted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import torch

if not torch.cuda.is_available():
    os.environ["TRITON_INTERPRET"] = "1"  # before Triton is loaded

from gsvrcodec.bitstream.gop_chain import WholeGop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.decoder.gop_cache import ReadyGop
from gsvrcodec.decoder.pictures import PictureMaker
from gsvrcodec.errors import DeviceError
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.optimise import Effort, optimise
from gsvrcodec.fit.paper import PAPER
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.fit.recipe import MAIN
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.time import Ticks
from gsvrcodec.render import backend_on
from gsvrcodec.render import triton as gpu
from gsvrcodec.render.triton import launch
from gsvrcodec.render.triton.launch import Pass
from tests.render import examples
from tests.render.examples import TAU, Example, Gradients
from tests.vectors import check
from tests.vectors.description import Picture, render
from tests.vectors.make import VALID

#: Not "cpu", which would be the native backend.
PLACE = "cuda:0" if torch.cuda.is_available() else "cpu:0"
DEVICE = torch.device(PLACE)
SIZE = (48, 32)
TAUS = np.array([TAU], np.float32)

each_blending = pytest.mark.parametrize("blending", ["mean", "sum"])


def _pass(example: Example, taus: Float32Array = TAUS) -> Pass:
    parameters = {
        name: torch.from_numpy(getattr(example.gop, name)).to(DEVICE) for name in Gop.__slots__
    }
    times = torch.from_numpy(taus).to(DEVICE)
    return Pass(parameters, times, example.size, example.coded_size, example.blending)


def _floats(example: Example, taus: Float32Array = TAUS) -> Float32Array:
    """Frames (F, H, W, 3) before the clamp."""
    return _pass(example, taus).floats().numpy(force=True)


def _gradients(example: Example, weights: Float32Array, taus: Float32Array = TAUS) -> Gradients:
    """Gradients of sum(frames * weights)."""
    run = _pass(example, taus)
    run.set_gradient(torch.from_numpy(weights).to(DEVICE))
    return {name: value.numpy(force=True) for name, value in run.gradients().items()}


def _weights(example: Example, frames: int = 1) -> Float32Array:
    width, height = example.size
    return np.random.default_rng(1).normal(size=(frames, height, width, 3)).astype(np.float32)


@each_blending
def test_frames_together(blending: Blending) -> None:
    """A batch is its frames one by one, and its gradient the sum of theirs."""
    example, taus = (
        Example(examples.all_levels(5, 1.0), (17, 9), (17, 9), blending),
        np.array([-1, 0.2], np.float32),
    )
    batch = _floats(example, taus)
    weights = _weights(example, len(taus))
    total = {name: np.zeros_like(getattr(example.gop, name)) for name in Gop.__slots__}
    for k in range(len(taus)):
        np.testing.assert_array_equal(_floats(example, taus[k : k + 1])[0], batch[k])
        part = _gradients(example, weights[k : k + 1], taus[k : k + 1])
        for name, gradient in part.items():
            total[name] += gradient
    examples.assert_gradients_close(_gradients(example, weights, taus), total)


@each_blending
@pytest.mark.parametrize("bit_depth", [8, 10])
def test_codes(bit_depth: int, blending: Blending) -> None:
    gop = examples.all_levels(40, 1.5)
    gop.colour[:] = np.abs(gop.colour) * 0.5
    taus = np.array([-0.7, 0.4], np.float32)
    backend = gpu.TritonBackend(PLACE, blending)
    prepared = backend.prepare(gop)
    actual = backend.render(prepared, taus, SIZE, SIZE, bit_depth=bit_depth)
    assert actual.dtype == (np.uint8 if bit_depth == 8 else np.uint16)
    white = 2**bit_depth - 1
    example = Example(gop, SIZE, SIZE, blending)
    frames = [examples.reference_render(example, tau=float(tau))[0] for tau in taus]
    expected = np.floor(np.clip(frames, 0, 1) * white + 0.5)
    difference = np.abs(actual.astype(int) - expected)
    assert difference.max() <= 1
    assert (difference > 0).mean() <= 1e-3
    tensor = gpu.empty_codes(actual.shape, bit_depth, PLACE)
    again = backend.render(prepared, taus, SIZE, SIZE, bit_depth=bit_depth, out=tensor)
    assert again is tensor
    np.testing.assert_array_equal(tensor.numpy(force=True), actual)


@pytest.mark.parametrize(
    "name", ["minimal", "black-triplane", "levels-1x1", "predicted", "opacities-hidden", "sum"]
)
def test_conformance(name: str) -> None:
    """The vectors that the interpreter renders in time; a GPU renders them all in seconds."""
    described = json.loads((VALID / f"{name}.json").read_text())
    with GsvrReader(VALID / f"{name}.gsvr") as reader:
        for fields in described["pictures"]:
            picture = Picture(**fields)
            backend = gpu.TritonBackend(PLACE, reader.header.blending)
            found = render(reader, picture, backend)
            wanted = check.read_picture(picture.file)
            assert not list(check.picture_differences(picture.file, found, wanted))


@each_blending
def test_more_than_one_chunk(monkeypatch: pytest.MonkeyPatch, blending: Blending) -> None:
    """More blocks in a tile, and more candidates, than a program looks at together."""
    monkeypatch.setattr(launch, "CHUNK", 2)
    example = Example(examples.random_gop(64 * 2 + 7, grid=(1, 2, 2)), (9, 7), (9, 7), blending)
    example.gop.log_scale[:] = -2.0
    weights = _weights(example)
    expected, gradients = examples.reference_render(example, weights[0])
    run = _pass(example)
    assert np.abs(run.floats().numpy(force=True) - expected).max() <= 1e-4 * expected.max()
    run.set_gradient(torch.from_numpy(weights).to(DEVICE))
    actual = {name: value.numpy(force=True) for name, value in run.gradients().items()}
    examples.assert_gradients_close(actual, gradients)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of NumPy, in the interpreter
@each_blending
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_not_finite_is_not_drawn(value: float, blending: Blending) -> None:
    """One broken Gaussian for each attribute, and what is left without them."""
    gop = examples.random_gop(24)
    names = [name for name in Gop.__slots__ if name not in ("xy", "xt", "yt")]
    broken = [name for name in names if name != "log_opacity" or blending == "mean"]
    for index, name in enumerate(broken):
        getattr(gop, name)[3 * index] = value
    kept = np.setdiff1d(np.arange(24), 3 * np.arange(len(broken)))
    rest = replace(gop, **{name: getattr(gop, name)[kept] for name in names})
    example = Example(gop, (20, 15), (20, 15), blending)
    expected = examples.reference_render(replace(example, gop=rest))[0]
    np.testing.assert_allclose(_floats(example)[0], expected, atol=1e-5)
    gradients = _gradients(example, _weights(example))
    for name, gradient in gradients.items():
        assert np.isfinite(gradient).all(), name
    for name in names:
        assert not gradients[name][: 3 * len(broken) : 3].any(), name


@each_blending
def test_pictures_are_tensors(blending: Blending) -> None:
    """What the decoder makes on a GPU, also where one GOP fades into the next or goes on in it."""
    options: dict[str, Any] = {
        "coded_size": (9, 7),
        "size": (9, 7),
        "layers": "all",
        "bit_depth": 8,
    }
    arrays = PictureMaker(**options, backend=backend_on("cpu", 1, blending))
    tensors = PictureMaker(**options, backend=backend_on(PLACE, 0, blending), tensors=True)
    gops = [examples.random_gop(3, grid=(0, 0, 0), seed=seed) for seed in range(3)]
    wholes: list[tuple[Gop, int, Ticks, tuple[Any, ...]]] = [
        (gops[0], 0, np.array([0, 1]), ()),
        (gops[1], 2, np.array([4, 5]), ()),
        (gops[2], 4, np.array([7, 9]), (1, np.array([True, False, True]))),
    ]
    made = []
    for maker in arrays, tensors:
        first, second, predicted = (
            ReadyGop(position, WholeGop(gop, start, pts, np.ones_like(pts), *before), maker.prepare)
            for position, (gop, start, pts, before) in enumerate(wholes)
        )
        pictures = maker.empty(4, (9, 7))
        assert pictures.shape == (4, 7, 9, 3)
        maker.frames(first, np.array([1, 0]), (9, 7), pictures[:2])
        maker.between(first, second, [Fraction(2)], (9, 7), pictures[2:3])
        maker.between(second, predicted, [Fraction(6)], (9, 7), pictures[3:])
        made.append(pictures)
    assert isinstance(made[1], torch.Tensor)
    np.testing.assert_allclose(made[1].numpy(force=True).astype(int), made[0], atol=1)


@each_blending
def test_fit(blending: Blending) -> None:
    """A fit is the same on both backends, but for rounding."""
    pictures = np.random.default_rng(3).integers(0, 256, (2, 6, 8, 3), np.uint8)
    footage = Footage(pictures, np.array([-1, 1], np.float32))
    fitted = []
    for device in "cpu", PLACE:
        backend = backend_on(device, threads=1, blending=blending)
        parameters = Parameters(examples.all_levels(6, 0.0), "hybrid", backend)
        recipe = replace(MAIN, relocations=(0.5,)) if blending == "mean" else PAPER
        rng = np.random.default_rng(0)
        optimise(parameters, footage, recipe, Effort(4), rng)
        fitted.append(parameters.gop())
    for name in Gop.__slots__:
        actual, expected = (getattr(gop, name) for gop in reversed(fitted))
        np.testing.assert_allclose(actual, expected, rtol=2e-3, atol=2e-3, err_msg=name)


def test_memory_that_does_not_suffice() -> None:
    with (
        pytest.raises(DeviceError, match=r"does not suffice to dance; .* or choose `device='cpu'`"),
        gpu.memory_checked("dance"),
    ):
        raise torch.OutOfMemoryError


@pytest.mark.slow
def test_kernels_compile_for_gpus() -> None:
    """The interpreter takes more than the compiler does; which needs no GPU."""
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    result = subprocess.run(
        [sys.executable, "-m", "tests.render.compile_kernels"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
