"""Levels of the pyramid added up, to samples or to a residual; and the adjoint of their enlarging.

A level is enlarged bilinearly: pixel x of the finer one lies in pixel x // 2 of the coarser, which
has weight 3/4, and nearest to its neighbour x // 2 - 1 (even x) or + 1 (odd x), with weight 1/4.
"""

import triton
import triton.language as tl

from gsvrcodec.render.triton.geometry import level_size

#: Samples that a program works on.
SAMPLES = tl.constexpr(1024)


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
def fold(picture_ptr, picture, level, width, height):
    """Add the next coarser level to `level`, in place."""
    frame = tl.program_id(1).to(tl.int64)
    own_width, own_height, before = level_size(level, width, height)
    coarse_width, coarse_height, coarse_before = level_size(level + 1, width, height)
    plane = own_width * own_height
    i = tl.program_id(0) * SAMPLES + tl.arange(0, SAMPLES)
    mask = i < 3 * plane
    channel, x, y = i // plane, i % own_width, i % plane // own_width
    picture_ptr += frame * picture
    coarse = picture_ptr + coarse_before + channel * (coarse_width * coarse_height)
    value = tl.load(picture_ptr + before + i, mask=mask, other=0.0)
    value += _enlarged(coarse, x, y, coarse_width, coarse_height, mask)
    tl.store(picture_ptr + before + i, value, mask=mask)


@triton.jit
def _finest(picture_ptr, i, mask, width, height):
    """Interleaved samples i of the whole frame, and where they lie on level 0."""
    coarse_width, coarse_height, coarse_before = level_size(1, width, height)
    channel, x, y = i % 3, i // 3 % width, i // 3 // width
    at = (channel * height + y) * width + x
    coarse = picture_ptr + coarse_before + channel * (coarse_width * coarse_height)
    value = tl.load(picture_ptr + at, mask=mask, other=0.0)
    return value + _enlarged(coarse, x, y, coarse_width, coarse_height, mask), at


@triton.jit
def to_codes(picture_ptr, code_ptr, picture, width, height, white):
    """Clamp, scale to [0, white] and round: (F, H, W, 3) integers."""
    frame = tl.program_id(1).to(tl.int64)
    samples = 3 * width * height
    i = tl.program_id(0) * SAMPLES + tl.arange(0, SAMPLES)
    mask = i < samples
    value, _ = _finest(picture_ptr + frame * picture, i, mask, width, height)
    value = tl.minimum(tl.maximum(value, 0.0), 1.0) * white + 0.5
    code = value.to(tl.int32).to(code_ptr.dtype.element_ty)
    tl.store(code_ptr + frame * samples + i, code, mask=mask)


@triton.jit
def to_floats(picture_ptr, value_ptr, picture, width, height):
    """Neither clamped nor rounded: (F, H, W, 3)."""
    frame = tl.program_id(1).to(tl.int64)
    samples = 3 * width * height
    i = tl.program_id(0) * SAMPLES + tl.arange(0, SAMPLES)
    mask = i < samples
    value, _ = _finest(picture_ptr + frame * picture, i, mask, width, height)
    tl.store(value_ptr + frame * samples + i, value, mask=mask)


@triton.jit
def residual(
    picture_ptr,
    target_ptr,
    backdrop_ptr,
    sum_ptr,
    picture,
    width,
    height,
    scale,
    white,
    BACKDROP: tl.constexpr,
):
    """Replace level 0 by (clamp(frame + backdrop) - target) * scale; sum the squared differences.

    `sum_ptr` (F, programs) gets a part of the sum from each program.
    """
    frame = tl.program_id(1).to(tl.int64)
    samples = 3 * width * height
    i = tl.program_id(0) * SAMPLES + tl.arange(0, SAMPLES)
    mask = i < samples
    picture_ptr += frame * picture
    value, at = _finest(picture_ptr, i, mask, width, height)
    target = tl.load(target_ptr + frame * samples + i, mask=mask, other=0).to(tl.float32) / white
    if BACKDROP:
        value += tl.load(backdrop_ptr + i, mask=mask, other=0.0)
    difference = tl.minimum(tl.maximum(value, 0.0), 1.0) - target
    tl.store(picture_ptr + at, difference * scale, mask=mask)
    difference = tl.where(mask, difference, 0.0)
    total = tl.sum(difference * difference, 0)
    tl.store(sum_ptr + frame * tl.num_programs(0) + tl.program_id(0), total)


@triton.jit(do_not_specialize=["level"])
def spread(picture_ptr, picture, level, width, height):
    """The gradient of `level` from that of the next finer one: the adjoint of enlarging."""
    frame = tl.program_id(1).to(tl.int64)
    own_width, own_height, before = level_size(level, width, height)
    fine_width, fine_height, fine_before = level_size(level - 1, width, height)
    plane = own_width * own_height
    i = tl.program_id(0) * SAMPLES + tl.arange(0, SAMPLES)
    mask = i < 3 * plane
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
