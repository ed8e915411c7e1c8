"""Deformation at one time and projection to a level of the pyramid."""

import triton
import triton.language as tl

from gsvrcodec.render.triton.geometry import (
    BLOCK,
    CHANNELS,
    DILATION,
    ELLIPSE,
    LEVELS,
    LOG2E,
    MIN_SCALE,
    MIN_VARIANCE,
    MOST_LOG_OPACITY,
    SUPPORT,
    UPSAMPLING,
)

_FAR = tl.constexpr(1e6)


@triton.jit
def cells(position, size):
    """The two cells of a line of `size` that a position in [-1, 1] lies between.

    Returns the lower, the higher, the higher one's weight, and whether the lookup moves with the
    position (it does not where it is clamped to the border).
    """
    last = size - 1
    u = (position + 1.0) * (0.5 * last)
    clamped = tl.where(u > 0.0, tl.minimum(u, 1.0 * last), 0.0)  # NaN goes to the border
    low = clamped.to(tl.int32)
    return low, tl.minimum(low + 1, last), clamped - low, u == clamped


@triton.jit
def corners(grid_ptr, row, next_row, column, next_column, columns, mask):
    """Four cells of a (rows, columns, 8) grid for each Gaussian: (B, 8) each."""
    channel = tl.arange(0, CHANNELS)[None, :]
    mask = mask[:, None]
    above = row * columns
    below = next_row * columns
    a = tl.load(grid_ptr + ((above + column) * CHANNELS)[:, None] + channel, mask=mask, other=0.0)
    b = tl.load(
        grid_ptr + ((above + next_column) * CHANNELS)[:, None] + channel, mask=mask, other=0.0
    )
    c = tl.load(grid_ptr + ((below + column) * CHANNELS)[:, None] + channel, mask=mask, other=0.0)
    d = tl.load(
        grid_ptr + ((below + next_column) * CHANNELS)[:, None] + channel, mask=mask, other=0.0
    )
    return a, b, c, d


@triton.jit
def mix(a, b, weight):
    """Linear interpolation, `weight` (B,) of `b`."""
    weight = weight[:, None]
    return a * (1.0 - weight) + b * weight


@triton.jit
def factors(xy_ptr, xt_ptr, yt_ptr, gx, gy, gt, x, y, tau, mask):
    """The tri-plane's three factors at canonical positions and time, and their slopes.

    Returns xy, xt, yt, (B, 8) each, then the derivatives of xy by x and y, of xt by x and of yt by
    y, for one unit of position.
    """
    x0, x1, fx, x_moves = cells(x, gx)
    y0, y1, fy, y_moves = cells(y, gy)
    t0, t1, ft, _ = cells(tau + tl.zeros_like(x), gt)
    x_rate = tl.where(x_moves, 0.5 * (gx - 1), 0.0)[:, None]
    y_rate = tl.where(y_moves, 0.5 * (gy - 1), 0.0)[:, None]

    a, b, c, d = corners(xy_ptr, y0, y1, x0, x1, gx, mask)
    top, bottom = mix(a, b, fx), mix(c, d, fx)
    xy = mix(top, bottom, fy)
    xy_x = mix(b - a, d - c, fy) * x_rate
    xy_y = (bottom - top) * y_rate

    a, b, c, d = corners(xt_ptr, t0, t1, x0, x1, gx, mask)
    low, high = mix(a, c, ft), mix(b, d, ft)
    xt = mix(low, high, fx)
    xt_x = (high - low) * x_rate

    a, b, c, d = corners(yt_ptr, t0, t1, y0, y1, gy, mask)
    low, high = mix(a, c, ft), mix(b, d, ft)
    yt = mix(low, high, fy)
    yt_y = (high - low) * y_rate
    return xy, xt, yt, xy_x, xy_y, xt_x, yt_y


@triton.jit
def channel_of(rows, channel: tl.constexpr):
    """One column of (B, 8)."""
    return tl.sum(tl.where(tl.arange(0, CHANNELS)[None, :] == channel, rows, 0.0), 1)


@triton.jit
def finite(x):
    """Neither infinite nor NaN."""
    return tl.abs(x) < float("inf")


@triton.jit
def shape(log_scale0, log_scale1, offset0, offset1, level_1, level_2, level_3, level_4, z2, blur):
    """Level and axes of Gaussians (spec section "Projection").

    `level_l` is the smallest log-scale of level l, z2 the squared zoom, `blur` what the variances
    of level 0 are raised by. Returns the level, then for both axes: exp(log_scale), the scale, the
    variance v, whether the scale moves with its sum and v with the scale.
    """
    smaller = tl.minimum(log_scale0, log_scale1)
    level = (smaller >= level_1).to(tl.int32) + (smaller >= level_2).to(tl.int32)
    level += (smaller >= level_3).to(tl.int32) + (smaller >= level_4).to(tl.int32)
    area = tl.exp2(2.0 * level) / z2
    raised = tl.where(level > 0, area * -UPSAMPLING, blur)
    least = tl.where(level > 0, area * MIN_VARIANCE, 0.0)
    base0 = tl.exp(tl.minimum(tl.maximum(log_scale0, -20.0), 20.0))
    base1 = tl.exp(tl.minimum(tl.maximum(log_scale1, -20.0), 20.0))
    s0 = tl.maximum(base0 + offset0, MIN_SCALE)
    s1 = tl.maximum(base1 + offset1, MIN_SCALE)
    v0, v1 = s0 * s0 + raised, s1 * s1 + raised
    v0_moves, v1_moves = v0 > least, v1 > least
    s0_moves = base0 + offset0 >= MIN_SCALE
    s1_moves = base1 + offset1 >= MIN_SCALE
    v0, v1 = tl.maximum(v0, least), tl.maximum(v1, least)
    return level, base0, base1, s0, s1, v0, v1, s0_moves, s1_moves, v0_moves, v1_moves


@triton.jit
def amplitude_of(s0, s1, v0, v1):
    """What keeps the integral of a Gaussian when its variances change."""
    return tl.sqrt(((s0 * s0 + DILATION) / v0) * ((s1 * s1 + DILATION) / v1))


@triton.jit
def project(
    position_ptr,
    log_scale_ptr,
    rotation_ptr,
    colour_ptr,
    log_opacity_ptr,
    indicator_ptr,
    linear_ptr,
    quadratic_ptr,
    xy_ptr,
    xt_ptr,
    yt_ptr,
    tau_ptr,
    splat_ptr,  # (F, N, 8)
    level_ptr,  # (F, N) int32; -1 = not drawn
    bounds_ptr,  # (F, levels, 4, blocks): left, right, top, bottom in px of the level
    place_ptr,  # (4, blocks): the same of canonical positions, in cells of the xy grid
    n,
    gx,
    gy,
    gt,
    width,
    height,
    zoom_x,
    zoom_y,
    level_1,
    level_2,
    level_3,
    level_4,
    z2,
    blur,
    PLANES: tl.constexpr,
    SUMS: tl.constexpr,
):
    """Splats of one block of Gaussians in one frame."""
    SPLAT: tl.constexpr = ELLIPSE + SUMS
    block, blocks = tl.program_id(0), tl.num_programs(0)
    frame = tl.program_id(1).to(tl.int64)
    lane = tl.arange(0, BLOCK)
    i = block * BLOCK + lane
    mask = i < n
    tau = tl.load(tau_ptr + frame)
    x = tl.load(position_ptr + 2 * i, mask=mask, other=0.0)
    y = tl.load(position_ptr + 2 * i + 1, mask=mask, other=0.0)
    ls0 = tl.load(log_scale_ptr + 2 * i, mask=mask, other=0.0)
    ls1 = tl.load(log_scale_ptr + 2 * i + 1, mask=mask, other=0.0)
    theta = tl.load(rotation_ptr + i, mask=mask, other=0.0)
    gate = 1.0 - tl.load(indicator_ptr + i, mask=mask, other=0.0)
    linear_x = tl.load(linear_ptr + 2 * i, mask=mask, other=0.0)
    linear_y = tl.load(linear_ptr + 2 * i + 1, mask=mask, other=0.0)
    quadratic_x = tl.load(quadratic_ptr + 2 * i, mask=mask, other=0.0)
    quadratic_y = tl.load(quadratic_ptr + 2 * i + 1, mask=mask, other=0.0)
    red = tl.load(colour_ptr + 3 * i, mask=mask, other=0.0)
    green = tl.load(colour_ptr + 3 * i + 1, mask=mask, other=0.0)
    blue = tl.load(colour_ptr + 3 * i + 2, mask=mask, other=0.0)
    if SUMS == 4:
        log_opacity = tl.load(log_opacity_ptr + i, mask=mask, other=0.0)

    offset_x = tl.zeros_like(x)
    offset_y = tl.zeros_like(x)
    offset0 = tl.zeros_like(x)
    offset1 = tl.zeros_like(x)
    if PLANES:
        xy, xt, yt, _, _, _, _ = factors(xy_ptr, xt_ptr, yt_ptr, gx, gy, gt, x, y, tau, mask)
        offsets = gate[:, None] * (xy * xt * yt)
        offset_x = channel_of(offsets, 0)
        offset_y = channel_of(offsets, 1)
        offset0 = channel_of(offsets, 2)
        offset1 = channel_of(offsets, 3)
        theta += channel_of(offsets, 4)
        if SUMS == 4:
            log_opacity += channel_of(offsets, 5)
        else:
            red += channel_of(offsets, 5)
            green += channel_of(offsets, 6)
            blue += channel_of(offsets, 7)

    level, _, _, s0, s1, v0, v1, _, _, _, _ = shape(
        ls0, ls1, offset0, offset1, level_1, level_2, level_3, level_4, z2, blur
    )
    share = amplitude_of(s0, s1, v0, v1)
    if SUMS == 4:
        share *= tl.exp(tl.minimum(tl.maximum(log_opacity, -MOST_LOG_OPACITY), MOST_LOG_OPACITY))
    shrink = tl.exp2(-level.to(tl.float32))
    level_x, level_y = zoom_x * shrink, zoom_y * shrink
    level_width, level_height = width * shrink, height * shrink
    mu_x = x + linear_x * tau + quadratic_x * (tau * tau) + offset_x
    mu_y = y + linear_y * tau + quadratic_y * (tau * tau) + offset_y
    cx = (mu_x + 1.0) * (0.5 * level_width)
    cy = (mu_y + 1.0) * (0.5 * level_height)
    cosine, sine = tl.cos(2.0 * theta), tl.sin(2.0 * theta)
    mean, spread = 0.5 * (v0 + v1), 0.5 * (v0 - v1)
    xx = (mean + spread * cosine) * (level_x * level_x)
    yy = (mean - spread * cosine) * (level_y * level_y)
    slope = spread * sine * (level_x * level_y) / xx
    across = 0.5 / xx * LOG2E
    # The determinant from the axes: the products of a thin Gaussian's entries would cancel.
    down = 0.5 * xx / (v0 * v1 * (level_x * level_x) * (level_y * level_y)) * LOG2E
    reach_x = tl.sqrt(2.0 * xx * SUPPORT)
    reach_y = tl.sqrt(2.0 * yy * SUPPORT)
    red, green, blue = red * share, green * share, blue * share

    # Written so that NaN and infinity anywhere make an empty splat.
    drawn = mask & finite(ls0) & finite(ls1) & finite(offset0) & finite(offset1)
    drawn = drawn & (reach_x < _FAR) & (reach_y < _FAR) & (tl.abs(slope) < _FAR)
    drawn = drawn & (tl.abs(cx) < _FAR) & (tl.abs(cy) < _FAR)
    drawn = drawn & (across < _FAR * _FAR) & (down < _FAR * _FAR)
    drawn = drawn & finite(red) & finite(green) & finite(blue)
    if SUMS == 4:
        drawn = drawn & finite(log_opacity)
    left, right, top, bottom = cx - reach_x, cx + reach_x, cy - reach_y, cy + reach_y
    drawn = drawn & (right >= 0.0) & (bottom >= 0.0)
    drawn = drawn & (left <= level_width + 1.0) & (top <= level_height + 1.0)

    splat = splat_ptr + (frame * n + i) * SPLAT
    tl.store(splat, cx, mask=mask)
    tl.store(splat + 1, cy, mask=mask)
    tl.store(splat + 2, slope, mask=mask)
    tl.store(splat + 3, across, mask=mask)
    tl.store(splat + 4, down, mask=mask)
    tl.store(splat + 5, red, mask=mask)
    tl.store(splat + 6, green, mask=mask)
    tl.store(splat + 7, blue, mask=mask)
    if SUMS == 4:
        tl.store(splat + 8, share, mask=mask)
    tl.store(level_ptr + frame * n + i, tl.where(drawn, level, -1), mask=mask)

    infinity = float("inf")
    for n_level in tl.static_range(LEVELS):
        own = drawn & (level == n_level)
        bounds = bounds_ptr + ((frame * LEVELS + n_level) * 4) * blocks + block
        tl.store(bounds, tl.min(tl.where(own, left, infinity), 0))
        tl.store(bounds + blocks, tl.max(tl.where(own, right, -infinity), 0))
        tl.store(bounds + 2 * blocks, tl.min(tl.where(own, top, infinity), 0))
        tl.store(bounds + 3 * blocks, tl.max(tl.where(own, bottom, -infinity), 0))
    if PLANES:
        x0, _, fx, _ = cells(x, gx)
        y0, _, fy, _ = cells(y, gy)
        u, v = x0 + fx, y0 + fy
        tl.store(place_ptr + block, tl.min(tl.where(mask, u, infinity), 0))
        tl.store(place_ptr + blocks + block, tl.max(tl.where(mask, u, -infinity), 0))
        tl.store(place_ptr + 2 * blocks + block, tl.min(tl.where(mask, v, infinity), 0))
        tl.store(place_ptr + 3 * blocks + block, tl.max(tl.where(mask, v, -infinity), 0))
