"""Levels of the pyramid added up, to samples or to a gradient; and the adjoint of their enlarging.

A level is enlarged bilinearly: pixel x of the finer one lies in pixel x // 2 of the coarser, which
has weight 3/4, and nearest to its neighbour x // 2 - 1 (even x) or + 1 (odd x), with weight 1/4.
"""

import triton
import triton.language as tl

from gsvrcodec.render.triton.geometry import GROUND, level_size

#: Sums of a level that a program works on.
SAMPLES = tl.constexpr(1024)
#: Pixels of the whole frame that a program works on.
PIXELS = tl.constexpr(512)


@triton.jit
def _far(x, coarse):
    """The other pixel of a line of `coarse` pixels that pixel x of the finer line is made of."""
    return tl.minimum(tl.maximum(x // 2 + 2 * (x % 2) - 1, 0), coarse - 1)


@triton.jit
def _enlarged(plane_ptr, x, y, width, height, mask):
    """Samples x, y of a (height, width) plane enlarged to double its size."""
    far_x, far_y = _far(x, width), _far(y, height)
    near, far = plane_ptr + y // 2 * width, plane_ptr + far_y * width
    a = tl.load(near + x // 2, mask=mask, other=0.0)
    b = tl.load(near + far_x, mask=mask, other=0.0)
    c = tl.load(far + x // 2, mask=mask, other=0.0)
    d = tl.load(far + far_x, mask=mask, other=0.0)
    return 0.5625 * a + 0.1875 * (b + c) + 0.0625 * d


@triton.jit(do_not_specialize=["level"])
def fold(picture_ptr, picture, level, width, height, SUMS: tl.constexpr):
    """Add the next coarser level to `level`, in place."""
    frame = tl.program_id(1).to(tl.int64)
    own_width, own_height, before = level_size(level, width, height, SUMS)
    coarse_width, coarse_height, coarse_before = level_size(level + 1, width, height, SUMS)
    plane = own_width * own_height
    i = tl.program_id(0) * SAMPLES + tl.arange(0, SAMPLES)
    mask = i < SUMS * plane
    channel, x, y = i // plane, i % own_width, i % plane // own_width
    picture_ptr += frame * picture
    coarse = picture_ptr + coarse_before + channel * (coarse_width * coarse_height)
    value = tl.load(picture_ptr + before + i, mask=mask, other=0.0)
    value += _enlarged(coarse, x, y, coarse_width, coarse_height, mask)
    tl.store(picture_ptr + before + i, value, mask=mask)


@triton.jit
def _sum(picture_ptr, n: tl.constexpr, i, mask, width, height, SUMS: tl.constexpr):
    """Sum n (3 is that of the weights) of pixels i of the whole frame."""
    coarse_width, coarse_height, before = level_size(1, width, height, SUMS)
    fine = picture_ptr + n * (width * height)
    coarse = picture_ptr + before + n * (coarse_width * coarse_height)
    value = tl.load(fine + i, mask=mask, other=0.0)
    return value + _enlarged(coarse, i % width, i // width, coarse_width, coarse_height, mask)


@triton.jit
def _colours(
    picture_ptr, backdrop_ptr, i, mask, width, height, SUMS: tl.constexpr, BACKDROP: tl.constexpr
):
    """Red, green and blue of pixels i, and the factor that makes them of the sums.

    `backdrop_ptr` (H, W, 4) is added to the sums.
    """
    red = _sum(picture_ptr, 0, i, mask, width, height, SUMS)
    green = _sum(picture_ptr, 1, i, mask, width, height, SUMS)
    blue = _sum(picture_ptr, 2, i, mask, width, height, SUMS)
    if BACKDROP:
        red += tl.load(backdrop_ptr + 4 * i, mask=mask, other=0.0)
        green += tl.load(backdrop_ptr + 4 * i + 1, mask=mask, other=0.0)
        blue += tl.load(backdrop_ptr + 4 * i + 2, mask=mask, other=0.0)
    factor = tl.full(i.shape, 1.0, tl.float32)
    if SUMS == 4:
        weight = _sum(picture_ptr, 3, i, mask, width, height, SUMS)
        if BACKDROP:
            weight += tl.load(backdrop_ptr + 4 * i + 3, mask=mask, other=0.0)
        factor = 1.0 / (weight + GROUND)
    return red * factor, green * factor, blue * factor, factor


@triton.jit
def _clamped(x):
    return tl.minimum(tl.maximum(x, 0.0), 1.0)


@triton.jit
def to_codes(
    picture_ptr,
    code_ptr,
    backdrop_ptr,  # (H, W, 4)
    picture,
    width,
    height,
    white,
    SUMS: tl.constexpr,
    BACKDROP: tl.constexpr,
):
    """Clamp, scale to [0, white] and round: (F, H, W, 3) integers."""
    frame = tl.program_id(1).to(tl.int64)
    pixels = width * height
    i = tl.program_id(0) * PIXELS + tl.arange(0, PIXELS)
    mask = i < pixels
    picture_ptr += frame * picture
    red, green, blue, _ = _colours(
        picture_ptr, backdrop_ptr, i, mask, width, height, SUMS, BACKDROP
    )
    kind: tl.constexpr = code_ptr.dtype.element_ty
    out = code_ptr + frame * 3 * pixels + 3 * i
    tl.store(out, (_clamped(red) * white + 0.5).to(tl.int32).to(kind), mask=mask)
    tl.store(out + 1, (_clamped(green) * white + 0.5).to(tl.int32).to(kind), mask=mask)
    tl.store(out + 2, (_clamped(blue) * white + 0.5).to(tl.int32).to(kind), mask=mask)


@triton.jit
def to_floats(
    picture_ptr,
    value_ptr,
    backdrop_ptr,  # (H, W, 4)
    picture,
    width,
    height,
    SUMS: tl.constexpr,
    BACKDROP: tl.constexpr,
):
    """Neither clamped nor rounded: (F, H, W, 3)."""
    frame = tl.program_id(1).to(tl.int64)
    pixels = width * height
    i = tl.program_id(0) * PIXELS + tl.arange(0, PIXELS)
    mask = i < pixels
    picture_ptr += frame * picture
    red, green, blue, _ = _colours(
        picture_ptr, backdrop_ptr, i, mask, width, height, SUMS, BACKDROP
    )
    out = value_ptr + frame * 3 * pixels + 3 * i
    tl.store(out, red, mask=mask)
    tl.store(out + 1, green, mask=mask)
    tl.store(out + 2, blue, mask=mask)


@triton.jit
def to_sums(
    picture_ptr,
    value_ptr,
    backdrop_ptr,  # (H, W, 4)
    picture,
    width,
    height,
    SUMS: tl.constexpr,
    BACKDROP: tl.constexpr,
):
    """The sums themselves: the first SUMS of (F, H, W, 4)."""
    frame = tl.program_id(1).to(tl.int64)
    pixels = width * height
    i = tl.program_id(0) * PIXELS + tl.arange(0, PIXELS)
    mask = i < pixels
    picture_ptr += frame * picture
    out = value_ptr + frame * 4 * pixels + 4 * i
    for n in tl.static_range(SUMS):
        value = _sum(picture_ptr, n, i, mask, width, height, SUMS)
        if BACKDROP:
            value += tl.load(backdrop_ptr + 4 * i + n, mask=mask, other=0.0)
        tl.store(out + n, value, mask=mask)


@triton.jit
def _store_gradient(
    picture_ptr, plane, red, green, blue, g_red, g_green, g_blue, factor, mask, SUMS: tl.constexpr
):
    """Replace pixels of level 0 by the gradient of their sums, from that of their colours."""
    g_red, g_green, g_blue = g_red * factor, g_green * factor, g_blue * factor
    tl.store(picture_ptr, g_red, mask=mask)
    tl.store(picture_ptr + plane, g_green, mask=mask)
    tl.store(picture_ptr + 2 * plane, g_blue, mask=mask)
    if SUMS == 4:
        g_weight = -(g_red * red + g_green * green + g_blue * blue)
        tl.store(picture_ptr + 3 * plane, g_weight, mask=mask)


@triton.jit
def weigh(
    picture_ptr,
    weight_ptr,  # (F, H, W, 3)
    backdrop_ptr,  # (H, W, 4)
    picture,
    width,
    height,
    SUMS: tl.constexpr,
    BACKDROP: tl.constexpr,
):
    """Replace level 0 by the gradient of sum(weights * frame)."""
    frame = tl.program_id(1).to(tl.int64)
    pixels = width * height
    i = tl.program_id(0) * PIXELS + tl.arange(0, PIXELS)
    mask = i < pixels
    picture_ptr += frame * picture
    red, green, blue, factor = _colours(
        picture_ptr, backdrop_ptr, i, mask, width, height, SUMS, BACKDROP
    )
    weights = weight_ptr + frame * 3 * pixels + 3 * i
    g_red = tl.load(weights, mask=mask, other=0.0)
    g_green = tl.load(weights + 1, mask=mask, other=0.0)
    g_blue = tl.load(weights + 2, mask=mask, other=0.0)
    _store_gradient(
        picture_ptr + i, pixels, red, green, blue, g_red, g_green, g_blue, factor, mask, SUMS
    )


@triton.jit
def residual(
    picture_ptr,
    target_ptr,  # (F, H, W, 3)
    backdrop_ptr,  # (H, W, 4)
    sum_ptr,  # (F, programs): gets a part of the sum from each program
    picture,
    width,
    height,
    scale,
    white,
    SUMS: tl.constexpr,
    BACKDROP: tl.constexpr,
):
    """Sum the squares of clamp(frame) - target; replace level 0 by their gradient times scale / 2.

    That of the clamp counts as 1.
    """
    frame = tl.program_id(1).to(tl.int64)
    pixels = width * height
    i = tl.program_id(0) * PIXELS + tl.arange(0, PIXELS)
    mask = i < pixels
    picture_ptr += frame * picture
    red, green, blue, factor = _colours(
        picture_ptr, backdrop_ptr, i, mask, width, height, SUMS, BACKDROP
    )
    target = target_ptr + frame * 3 * pixels + 3 * i
    d_red = _clamped(red) - tl.load(target, mask=mask, other=0).to(tl.float32) / white
    d_green = _clamped(green) - tl.load(target + 1, mask=mask, other=0).to(tl.float32) / white
    d_blue = _clamped(blue) - tl.load(target + 2, mask=mask, other=0).to(tl.float32) / white
    squares = d_red * d_red + d_green * d_green + d_blue * d_blue
    total = tl.sum(tl.where(mask, squares, 0.0), 0)
    tl.store(sum_ptr + frame * tl.num_programs(0) + tl.program_id(0), total)
    g_red, g_green, g_blue = d_red * scale, d_green * scale, d_blue * scale
    _store_gradient(
        picture_ptr + i, pixels, red, green, blue, g_red, g_green, g_blue, factor, mask, SUMS
    )


@triton.jit(do_not_specialize=["level"])
def spread(picture_ptr, picture, level, width, height, SUMS: tl.constexpr):
    """The gradient of `level` from that of the next finer one: the adjoint of enlarging."""
    frame = tl.program_id(1).to(tl.int64)
    own_width, own_height, before = level_size(level, width, height, SUMS)
    fine_width, fine_height, fine_before = level_size(level - 1, width, height, SUMS)
    plane = own_width * own_height
    i = tl.program_id(0) * SAMPLES + tl.arange(0, SAMPLES)
    mask = i < SUMS * plane
    channel, x, y = i // plane, i % own_width, i % plane // own_width
    picture_ptr += frame * picture
    fine = picture_ptr + fine_before + channel * (fine_width * fine_height)
    total = tl.zeros([SAMPLES], tl.float32)
    for row in tl.static_range(4):
        fine_y = 2 * y + row - 1
        inside_y = mask & (fine_y >= 0) & (fine_y < fine_height)
        # At the edges a pixel is its own neighbour.
        edge_y = (fine_y == 0) | (fine_y == 2 * own_height - 1)
        weight_y = tl.where(edge_y, 1.0, 0.75 if row == 1 or row == 2 else 0.25)
        for column in tl.static_range(4):
            fine_x = 2 * x + column - 1
            inside = inside_y & (fine_x >= 0) & (fine_x < fine_width)
            edge_x = (fine_x == 0) | (fine_x == 2 * own_width - 1)
            weight = tl.where(edge_x, 1.0, 0.75 if column == 1 or column == 2 else 0.25)
            value = tl.load(fine + fine_y * fine_width + fine_x, mask=inside, other=0.0)
            total += value * (weight * weight_y)
    tl.store(picture_ptr + before + i, total, mask=mask)
