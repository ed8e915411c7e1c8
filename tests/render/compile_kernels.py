"""Compile every Triton kernel; needs no GPU: `python -m tests.render.compile_kernels [90]`.

Prints registers and bytes of local memory of each kernel, for means (4 sums) and sums (3).
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, get_args

import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render.triton import adam, deform, deform_backward, planes, pyramid, raster
from gsvrcodec.render.triton.launch import CHUNK, sums_of

#: Kernel, warps, element types of pointers that are not fp32, compile-time values. Those whose SUMS
#: is left open are compiled for both blendings.
KERNELS: list[tuple[Any, int, dict[str, str], dict[str, Any]]] = [
    (deform.project, 2, {"level_ptr": "i32"}, {"PLANES": True}),
    (deform_backward.deform_backward, 2, {"level_ptr": "i32"}, {"PLANES": True}),
    (raster.rasterise, 4, {"level_ptr": "i32", "list_ptr": "i32"}, {"CHUNK": CHUNK}),
    (raster.gather, 1, {"level_ptr": "i32"}, {}),
    (planes.sum_cells, 2, {"list_ptr": "i32"}, {"CHUNK": CHUNK}),
    (pyramid.fold, 4, {}, {}),
    (pyramid.to_codes, 4, {"code_ptr": "u8"}, {}),
    (pyramid.to_floats, 4, {}, {}),
    (pyramid.to_sums, 4, {}, {}),
    (pyramid.weigh, 4, {}, {"BACKDROP": True}),
    (pyramid.residual, 4, {"target_ptr": "u8"}, {"BACKDROP": True}),
    (pyramid.spread, 4, {}, {}),
    (adam.adam_update, 4, {}, {"PACED": True}),
]

#: Scalar arguments that are not integers.
_FLOATS = {"zoom_x", "zoom_y", "level_1", "level_2", "level_3", "level_4", "z2", "blur"} | {
    *("white", "scale", "factor", "beta1", "beta2", "correction", "epsilon", "agreeing", "opposing")
}


def compile_kernel(
    kernel: Any, warps: int, pointers: dict[str, str], constants: dict[str, Any], capability: int
) -> bytes:
    """Machine code of a kernel for one compute capability."""

    def kind(name: str) -> str:
        if name in constants:
            return "constexpr"
        if name.endswith("_ptr"):
            return "*" + pointers.get(name, "fp32")
        return "fp32" if name in _FLOATS else "i32"

    signature = {name: kind(name) for name in kernel.arg_names}
    # Tensors begin at multiples of 16 bytes.
    aligned = {
        (index,): [["tt.divisibility", 16]]
        for index, name in enumerate(signature)
        if name.endswith("_ptr")
    }
    source = ASTSource(kernel, signature, constants, aligned)
    target = GPUTarget("cuda", capability, 32)
    code: bytes = triton.compile(source, target=target, options={"num_warps": warps}).asm["cubin"]
    return code


def resources(code: bytes) -> str:
    """Registers and bytes of local memory, as the assembler counts them."""
    tool = Path(triton.__file__).parent / "backends/nvidia/bin/cuobjdump"
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(code)
        file.flush()
        result = subprocess.run(
            [tool, "-res-usage", file.name], capture_output=True, text=True, check=True
        )
    return " ".join(re.findall(r"(?:REG|STACK|SHARED|LOCAL):\d+", result.stdout))


def main() -> None:
    """Compile all kernels for the capability given, or 9.0."""
    capability = int(sys.argv[1]) if len(sys.argv) > 1 else 90
    for kernel, warps, pointers, constants in KERNELS:
        choices: list[dict[str, Any]] = [{}]
        if "SUMS" in kernel.arg_names:
            choices = [{"SUMS": sums_of(blending)} for blending in get_args(Blending)]
        for choice in choices:
            code = compile_kernel(kernel, warps, pointers, constants | choice, capability)
            sums = "".join(f"{n} sums" for n in choice.values())
            print(f"{kernel.__name__:18}{warps} warps {sums:8}{resources(code)}", flush=True)


if __name__ == "__main__":
    main()
