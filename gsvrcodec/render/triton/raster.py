"""Rasterisation of splats onto the levels of the pyramid, and the moments that gradients need.

No lists are kept between kernels: a program finds its own splats through the bounds of their
blocks. So nothing is sorted, no memory depends on the content, and sums have a fixed order.
"""

import triton
import triton.language as tl

from gsvrcodec.render.triton.geometry import (
    BLOCK,
    CUTOFF,
    ELLIPSE,
    END,
    LEVELS,
    compact,
    level_size,
    locate,
    span,
)

#: Pixels of a tile, which one program rasterises.
TILE_WIDTH = tl.constexpr(32)
TILE_HEIGHT = tl.constexpr(16)

#: Pixels that a program of `gather` looks at together.
_PATCH_WIDTH = tl.constexpr(16)
_PATCH_HEIGHT = tl.constexpr(8)


def tiles_of(width: int, height: int) -> int:
    """Tiles of a level."""
    tiles: int = triton.cdiv(width, TILE_WIDTH.value) * triton.cdiv(height, TILE_HEIGHT.value)
    return tiles


@triton.jit
def rasterise(
    splat_ptr,
    level_ptr,
    bounds_ptr,
    picture_ptr,  # (F, picture): the levels, finest first, each (SUMS, height, width)
    list_ptr,  # (F, tiles, 2, CHUNK) int32: scratch
    n,
    blocks,
    picture,
    width,
    height,
    CHUNK: tl.constexpr,
    SUMS: tl.constexpr,
):
    """Sums over the splats of one level in one tile, CHUNK candidates at a time."""
    SPLAT: tl.constexpr = ELLIPSE + SUMS
    tiles = tl.num_programs(0)
    frame = tl.program_id(1).to(tl.int64)
    tile = tiles - 1 - tl.program_id(0)  # the coarsest, which have most to do, start first
    block_list = list_ptr + (frame * tiles + tile) * (2 * CHUNK)
    splat_list = block_list + CHUNK
    level = 0
    level_width, level_height = width, height
    for _ in tl.static_range(LEVELS - 1):
        columns = (level_width + TILE_WIDTH - 1) // TILE_WIDTH
        own = columns * ((level_height + TILE_HEIGHT - 1) // TILE_HEIGHT)
        coarser = tile >= own
        # Once a tile is on its level, no later one is taken: `own` is kept.
        level = tl.where(coarser, level + 1, level)
        tile = tl.where(coarser, tile - own, tile)
        level_width = tl.where(coarser, (level_width + 1) // 2, level_width)
        level_height = tl.where(coarser, (level_height + 1) // 2, level_height)
    level_width, level_height, before = level_size(level, width, height, SUMS)
    columns = (level_width + TILE_WIDTH - 1) // TILE_WIDTH
    first_x, first_y = tile % columns * TILE_WIDTH, tile // columns * TILE_HEIGHT
    # Of pixel centres.
    left, top = first_x + 0.5, first_y + 0.5
    right, bottom = left + (TILE_WIDTH - 1), top + (TILE_HEIGHT - 1)

    pixel = tl.arange(0, TILE_WIDTH * TILE_HEIGHT)
    x, y = first_x + pixel % TILE_WIDTH, first_y + pixel // TILE_WIDTH
    centre_x, centre_y = x + 0.5, y + 0.5
    red = tl.zeros([TILE_WIDTH * TILE_HEIGHT], tl.float32)
    green, blue, share = red, red, red
    lane = tl.arange(0, CHUNK)
    bounds_ptr += (frame * LEVELS + level) * 4 * blocks
    for first in range(0, blocks, CHUNK):
        block = first + lane
        mask = block < blocks
        bounds = bounds_ptr + block
        touch = mask & (tl.load(bounds, mask=mask, other=0.0) <= right)
        touch = touch & (tl.load(bounds + blocks, mask=mask, other=0.0) >= left)
        touch = touch & (tl.load(bounds + 2 * blocks, mask=mask, other=0.0) <= bottom)
        touch = touch & (tl.load(bounds + 3 * blocks, mask=mask, other=0.0) >= top)
        candidates = compact(block_list, block, touch) * BLOCK
        tl.debug_barrier()
        for second in range(0, candidates, CHUNK):
            candidate = second + lane
            mask = candidate < candidates
            block = tl.load(block_list + candidate // BLOCK, mask=mask, other=0)
            i = block * BLOCK + candidate % BLOCK
            mask = mask & (i < n)
            mask = mask & (tl.load(level_ptr + frame * n + i, mask=mask, other=-1) == level)
            splat = splat_ptr + (frame * n + i) * SPLAT
            cx = tl.load(splat, mask=mask, other=0.0)
            cy = tl.load(splat + 1, mask=mask, other=0.0)
            slope = tl.load(splat + 2, mask=mask, other=0.0)
            across = tl.load(splat + 3, mask=mask, other=1.0)
            down = tl.load(splat + 4, mask=mask, other=1.0)
            reach = tl.sqrt(1.0 / across * END)
            above, below = span(left - cx, right - cx, slope, across, down)
            touch = mask & (cx - reach <= right) & (cx + reach >= left)
            # Rounding must not lose a splat.
            touch = touch & (cy + above <= bottom + 0.01) & (cy + below >= top - 0.01)
            found = compact(splat_list, i, touch)
            tl.debug_barrier()
            for k in range(found):
                one = splat_ptr + (frame * n + tl.load(splat_list + k)) * SPLAT
                dx = centre_x - tl.load(one)
                u = centre_y - tl.load(one + 1) - tl.load(one + 2) * dx
                exponent = tl.load(one + 3) * dx * dx + tl.load(one + 4) * u * u
                weight = tl.maximum(tl.exp2(-exponent) - CUTOFF, 0.0)
                red += tl.load(one + 5) * weight
                green += tl.load(one + 6) * weight
                blue += tl.load(one + 7) * weight
                if SUMS == 4:
                    share += tl.load(one + 8) * weight
            tl.debug_barrier()
        tl.debug_barrier()

    inside = (x < level_width) & (y < level_height)
    plane = level_width * level_height
    out = picture_ptr + frame * picture + before + y * level_width + x
    tl.store(out, red, mask=inside)
    tl.store(out + plane, green, mask=inside)
    tl.store(out + 2 * plane, blue, mask=inside)
    if SUMS == 4:
        tl.store(out + 3 * plane, share, mask=inside)


@triton.jit
def gather(
    splat_ptr,
    level_ptr,
    gradient_ptr,  # (F, picture): of the levels
    moment_ptr,  # (F, N, SUMS + 5): written
    n,
    picture,
    width,
    height,
    SUMS: tl.constexpr,
):
    """Sum gradients over the pixels of one splat.

    Those of its factors of the weight (SUMS), and those of its exponent times dx, dy, dx^2, dx dy,
    dy^2, from its centre (px of the level).
    """
    SPLAT: tl.constexpr = ELLIPSE + SUMS
    i = tl.program_id(0)
    row = tl.program_id(1).to(tl.int64) * n + i
    level = tl.load(level_ptr + row)
    pixel = tl.arange(0, _PATCH_WIDTH * _PATCH_HEIGHT)
    zero = tl.zeros([_PATCH_WIDTH * _PATCH_HEIGHT], tl.float32)
    m_red, m_green, m_blue, m_share, m_x, m_y, m_xx, m_xy, m_yy = (
        zero, zero, zero, zero, zero, zero, zero, zero, zero,
    )  # fmt: skip
    if level >= 0:
        level_width, level_height, before = level_size(level, width, height, SUMS)
        plane = level_width * level_height
        gradient_ptr += tl.program_id(1).to(tl.int64) * picture + before
        splat = splat_ptr + row * SPLAT
        cx, cy, slope = tl.load(splat), tl.load(splat + 1), tl.load(splat + 2)
        across, down = tl.load(splat + 3), tl.load(splat + 4)
        red, green, blue = tl.load(splat + 5), tl.load(splat + 6), tl.load(splat + 7)
        if SUMS == 4:
            share = tl.load(splat + 8)
        # The same ellipse, by rows: its square completed the other way round.
        steep = across + down * slope * slope
        slope_y, across_y = down * slope / steep, down * across / steep
        reach = tl.sqrt(1.0 / across_y * END)
        end_y = locate(cy + reach + 1.0, level_height)
        for first_y in range(locate(cy - reach, level_height), end_y, _PATCH_HEIGHT):
            from_y = first_y + 0.5 - cy
            to_y = tl.minimum(first_y + _PATCH_HEIGHT, end_y) - 0.5 - cy
            left, right = span(from_y, to_y, slope_y, across_y, steep)
            end_x = locate(cx + right + 1.0, level_width)
            y = first_y + pixel // _PATCH_WIDTH
            dy = y + 0.5 - cy
            for first_x in range(locate(cx + left, level_width), end_x, _PATCH_WIDTH):
                x = first_x + pixel % _PATCH_WIDTH
                inside = (x < end_x) & (y < end_y)
                dx = x + 0.5 - cx
                u = dy - slope * dx
                e = tl.exp2(-(across * dx * dx + down * u * u))
                e = tl.where(e > CUTOFF, e, CUTOFF)
                at = gradient_ptr + y * level_width + x
                g_red = tl.load(at, mask=inside, other=0.0)
                g_green = tl.load(at + plane, mask=inside, other=0.0)
                g_blue = tl.load(at + 2 * plane, mask=inside, other=0.0)
                weight = e - CUTOFF
                m_red += weight * g_red
                m_green += weight * g_green
                m_blue += weight * g_blue
                p = tl.where(weight > 0.0, e, 0.0)
                if SUMS == 4:
                    g_share = tl.load(at + 3 * plane, mask=inside, other=0.0)
                    m_share += weight * g_share
                    p *= red * g_red + green * g_green + blue * g_blue + share * g_share
                else:
                    p *= red * g_red + green * g_green + blue * g_blue
                px, py = p * dx, p * dy
                m_x += px
                m_y += py
                m_xx += px * dx
                m_xy += px * dy
                m_yy += py * dy
    moment = moment_ptr + row * SPLAT
    tl.store(moment, tl.sum(m_red, 0))
    tl.store(moment + 1, tl.sum(m_green, 0))
    tl.store(moment + 2, tl.sum(m_blue, 0))
    if SUMS == 4:
        tl.store(moment + 3, tl.sum(m_share, 0))
    moment += SUMS
    tl.store(moment, tl.sum(m_x, 0))
    tl.store(moment + 1, tl.sum(m_y, 0))
    tl.store(moment + 2, tl.sum(m_xx, 0))
    tl.store(moment + 3, tl.sum(m_xy, 0))
    tl.store(moment + 4, tl.sum(m_yy, 0))
