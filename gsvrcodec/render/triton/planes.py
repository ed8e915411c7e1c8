"""Gradient of the tri-plane: what all Gaussians around a cell add to it."""

import triton
import triton.language as tl

from gsvrcodec.render.triton.deform import cells
from gsvrcodec.render.triton.geometry import BLOCK, CHANNELS, compact


@triton.jit
def sum_cells(
    position_ptr,
    place_ptr,  # (4, blocks): see deform.project
    factor_gradient_ptr,  # (F, 3, N, 8): of the values looked up in xy, xt and yt
    cell_ptr,  # (F, Gy, Gx, 24): written
    list_ptr,  # (F, Gy * Gx, CHUNK) int32: scratch
    n,
    blocks,
    gx,
    gy,
    CHUNK: tl.constexpr,
):
    """Sums over the Gaussians next to one cell of the xy grid, by their weights there.

    The weights of all cells of a column add up to that of the column: summed over rows, the
    second 8 sums are the gradient of a line of xt; over columns, the third are of one of yt.
    """
    cell, frame = tl.program_id(0), tl.program_id(1).to(tl.int64)
    column, row = cell % gx, cell // gx
    block_list = list_ptr + (frame * (gx * gy) + cell) * CHUNK
    channel = tl.arange(0, CHANNELS)
    size = n * CHANNELS
    factor_gradient_ptr += frame * (3 * size)
    xy = tl.zeros([CHANNELS], tl.float32)
    xt, yt = xy, xy
    for first in range(0, blocks, CHUNK):
        block = first + tl.arange(0, CHUNK)
        mask = block < blocks
        place = place_ptr + block
        touch = mask & (tl.load(place, mask=mask, other=0.0) < column + 1)
        touch = touch & (tl.load(place + blocks, mask=mask, other=0.0) > column - 1)
        touch = touch & (tl.load(place + 2 * blocks, mask=mask, other=0.0) < row + 1)
        touch = touch & (tl.load(place + 3 * blocks, mask=mask, other=0.0) > row - 1)
        found = compact(block_list, block, touch)
        tl.debug_barrier()
        for k in range(found):
            i = tl.load(block_list + k) * BLOCK + tl.arange(0, BLOCK)
            real = i < n
            x0, _, fx, _ = cells(tl.load(position_ptr + 2 * i, mask=real, other=0.0), gx)
            y0, _, fy, _ = cells(tl.load(position_ptr + 2 * i + 1, mask=real, other=0.0), gy)
            weight = tl.maximum(1.0 - tl.abs(x0 + fx - column), 0.0)
            weight *= tl.maximum(1.0 - tl.abs(y0 + fy - row), 0.0)
            weight = tl.where(real, weight, 0.0)[:, None]
            near = weight > 0.0
            gradient = factor_gradient_ptr + (i * CHANNELS)[:, None] + channel[None, :]
            xy += tl.sum(weight * tl.load(gradient, mask=near, other=0.0), 0)
            xt += tl.sum(weight * tl.load(gradient + size, mask=near, other=0.0), 0)
            yt += tl.sum(weight * tl.load(gradient + 2 * size, mask=near, other=0.0), 0)
        tl.debug_barrier()
    out = cell_ptr + (frame * (gx * gy) + cell) * (3 * CHANNELS) + channel
    tl.store(out, xy)
    tl.store(out + CHANNELS, xt)
    tl.store(out + 2 * CHANNELS, yt)
