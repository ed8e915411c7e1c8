"""Gradients of the Gaussians from the moments of their splats."""

import triton
import triton.language as tl

from gsvrcodec.render.triton.deform import amplitude_of, channel_of, factors, shape
from gsvrcodec.render.triton.geometry import (
    BLOCK,
    CHANNELS,
    DILATION,
    ELLIPSE,
    MOST_LOG_OPACITY,
)


@triton.jit
def deform_backward(
    position_ptr,
    log_scale_ptr,
    rotation_ptr,
    log_opacity_ptr,
    indicator_ptr,
    xy_ptr,
    xt_ptr,
    yt_ptr,
    tau_ptr,
    splat_ptr,
    level_ptr,
    moment_ptr,  # (F, N, SUMS + 5): see raster.gather
    position_gradient_ptr,
    log_scale_gradient_ptr,
    rotation_gradient_ptr,
    colour_gradient_ptr,
    log_opacity_gradient_ptr,
    indicator_gradient_ptr,
    linear_gradient_ptr,
    quadratic_gradient_ptr,
    factor_gradient_ptr,  # (F, 3, N, 8): of the values looked up in xy, xt and yt
    frames,
    n,
    gx,
    gy,
    gt,
    coded_width,
    coded_height,
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
    """Gradients of one block of Gaussians, summed over all frames."""
    SPLAT: tl.constexpr = ELLIPSE + SUMS
    lane = tl.arange(0, BLOCK)
    i = tl.program_id(0) * BLOCK + lane
    mask = i < n
    channel = tl.arange(0, CHANNELS)[None, :]
    x = tl.load(position_ptr + 2 * i, mask=mask, other=0.0)
    y = tl.load(position_ptr + 2 * i + 1, mask=mask, other=0.0)
    ls0 = tl.load(log_scale_ptr + 2 * i, mask=mask, other=0.0)
    ls1 = tl.load(log_scale_ptr + 2 * i + 1, mask=mask, other=0.0)
    rotation = tl.load(rotation_ptr + i, mask=mask, other=0.0)
    gate = 1.0 - tl.load(indicator_ptr + i, mask=mask, other=0.0)
    if SUMS == 4:
        log_opacity = tl.load(log_opacity_ptr + i, mask=mask, other=0.0)

    zero = tl.zeros_like(x)
    g_x, g_y, g_ls0, g_ls1, g_rotation, g_indicator = zero, zero, zero, zero, zero, zero
    g_red, g_green, g_blue, g_log_opacity = zero, zero, zero, zero
    g_linear_x, g_linear_y, g_quadratic_x, g_quadratic_y = zero, zero, zero, zero
    for frame in range(frames):
        row = tl.cast(frame, tl.int64) * n + i
        tau = tl.load(tau_ptr + frame)
        drawn = mask & (tl.load(level_ptr + row, mask=mask, other=-1) >= 0)
        offset0, offset1, offset_opacity, theta = zero, zero, zero, rotation
        if PLANES:
            xy, xt, yt, xy_x, xy_y, xt_x, yt_y = factors(
                xy_ptr, xt_ptr, yt_ptr, gx, gy, gt, x, y, tau, drawn
            )
            offsets = gate[:, None] * (xy * xt * yt)
            offset0 = channel_of(offsets, 2)
            offset1 = channel_of(offsets, 3)
            theta = rotation + channel_of(offsets, 4)
            if SUMS == 4:
                offset_opacity = channel_of(offsets, 5)
        level, base0, base1, s0, s1, v0, v1, s0_moves, s1_moves, v0_moves, v1_moves = shape(
            ls0, ls1, offset0, offset1, level_1, level_2, level_3, level_4, z2, blur
        )
        cosine, sine = tl.cos(2.0 * theta), tl.sin(2.0 * theta)

        # Moments, from pixels of the level to those of the coded frame.
        moment = moment_ptr + row * SPLAT
        to_x = tl.exp2(level.to(tl.float32)) / zoom_x
        to_y = tl.exp2(level.to(tl.float32)) / zoom_y
        red = tl.load(moment, mask=drawn, other=0.0)
        green = tl.load(moment + 1, mask=drawn, other=0.0)
        blue = tl.load(moment + 2, mask=drawn, other=0.0)
        m_x = tl.load(moment + SUMS, mask=drawn, other=0.0) * to_x
        m_y = tl.load(moment + SUMS + 1, mask=drawn, other=0.0) * to_y
        m_xx = tl.load(moment + SUMS + 2, mask=drawn, other=0.0) * (to_x * to_x)
        m_xy = tl.load(moment + SUMS + 3, mask=drawn, other=0.0) * (to_x * to_y)
        m_yy = tl.load(moment + SUMS + 4, mask=drawn, other=0.0) * (to_y * to_y)

        # Centre.
        mean, spread = 0.5 * (v0 + v1), 0.5 * (v0 - v1)
        inverse = 1.0 / (v0 * v1)
        xx, xy_covariance = mean + spread * cosine, spread * sine
        yy = mean - spread * cosine
        g_mu_x = (yy * m_x - xy_covariance * m_y) * inverse * (0.5 * coded_width)
        g_mu_y = (xx * m_y - xy_covariance * m_x) * inverse * (0.5 * coded_height)
        g_mu_x = tl.where(drawn, g_mu_x, 0.0)
        g_mu_y = tl.where(drawn, g_mu_y, 0.0)
        g_x += g_mu_x
        g_y += g_mu_y
        g_linear_x += g_mu_x * tau
        g_linear_y += g_mu_y * tau
        g_quadratic_x += g_mu_x * (tau * tau)
        g_quadratic_y += g_mu_y * (tau * tau)

        # Covariance, along its own axes: m_ij / (2 v_i v_j).
        half = 0.5 * (m_xx - m_yy)
        along = half * cosine + m_xy * sine
        aslant = m_xy * cosine - half * sine
        g_theta = tl.where(drawn, 2.0 * spread * aslant * inverse, 0.0)
        g_rotation += g_theta
        # The gradient by the logarithm of the amplitude, and of the opacity.
        splat = splat_ptr + row * SPLAT
        gain = tl.load(splat + 5, mask=drawn, other=0.0) * red
        gain += tl.load(splat + 6, mask=drawn, other=0.0) * green
        gain += tl.load(splat + 7, mask=drawn, other=0.0) * blue
        if SUMS == 4:
            share = tl.load(splat + 8, mask=drawn, other=0.0)
            gain += share * tl.load(moment + 3, mask=drawn, other=0.0)
            free = drawn & (tl.abs(log_opacity + offset_opacity) <= MOST_LOG_OPACITY)
            g_opacity = tl.where(free, gain, 0.0)
            g_log_opacity += g_opacity
        else:
            share = amplitude_of(s0, s1, v0, v1)
        middle = 0.5 * (m_xx + m_yy)
        v_rate0 = tl.where(v0_moves, (middle + along) / (v0 * v0) - gain / v0, 0.0)
        v_rate1 = tl.where(v1_moves, (middle - along) / (v1 * v1) - gain / v1, 0.0)
        g_s0 = s0 * (v_rate0 + gain / (s0 * s0 + DILATION))
        g_s1 = s1 * (v_rate1 + gain / (s1 * s1 + DILATION))
        g_s0 = tl.where(drawn & s0_moves, g_s0, 0.0)
        g_s1 = tl.where(drawn & s1_moves, g_s1, 0.0)
        g_ls0 += tl.where(drawn, g_s0 * base0, 0.0)
        g_ls1 += tl.where(drawn, g_s1 * base1, 0.0)
        red = tl.where(drawn, red * share, 0.0)
        green = tl.where(drawn, green * share, 0.0)
        blue = tl.where(drawn, blue * share, 0.0)
        g_red += red
        g_green += green
        g_blue += blue

        if PLANES:
            g = tl.where(channel == 0, g_mu_x[:, None], 0.0)
            g = tl.where(channel == 1, g_mu_y[:, None], g)
            g = tl.where(channel == 2, g_s0[:, None], g)
            g = tl.where(channel == 3, g_s1[:, None], g)
            g = tl.where(channel == 4, g_theta[:, None], g)
            if SUMS == 4:
                g = tl.where(channel == 5, g_opacity[:, None], g)
            else:
                g = tl.where(channel == 5, red[:, None], g)
                g = tl.where(channel == 6, green[:, None], g)
                g = tl.where(channel == 7, blue[:, None], g)
            g = tl.where(drawn[:, None], g, 0.0)
            g_indicator -= tl.where(drawn, tl.sum(g * (xy * xt * yt), 1), 0.0)
            g *= tl.where(drawn, gate, 0.0)[:, None]
            g_xy, g_xt, g_yt = g * (xt * yt), g * (xy * yt), g * (xy * xt)
            g_x += tl.where(drawn, tl.sum(g_xy * xy_x + g_xt * xt_x, 1), 0.0)
            g_y += tl.where(drawn, tl.sum(g_xy * xy_y + g_yt * yt_y, 1), 0.0)
            size = n * CHANNELS
            out = factor_gradient_ptr + tl.cast(frame, tl.int64) * (3 * size)
            out = out + (i * CHANNELS)[:, None] + channel
            tl.store(out, g_xy, mask=mask[:, None])
            tl.store(out + size, g_xt, mask=mask[:, None])
            tl.store(out + 2 * size, g_yt, mask=mask[:, None])

    tl.store(position_gradient_ptr + 2 * i, g_x, mask=mask)
    tl.store(position_gradient_ptr + 2 * i + 1, g_y, mask=mask)
    tl.store(log_scale_gradient_ptr + 2 * i, g_ls0, mask=mask)
    tl.store(log_scale_gradient_ptr + 2 * i + 1, g_ls1, mask=mask)
    tl.store(rotation_gradient_ptr + i, g_rotation, mask=mask)
    tl.store(indicator_gradient_ptr + i, g_indicator, mask=mask)
    tl.store(linear_gradient_ptr + 2 * i, g_linear_x, mask=mask)
    tl.store(linear_gradient_ptr + 2 * i + 1, g_linear_y, mask=mask)
    tl.store(quadratic_gradient_ptr + 2 * i, g_quadratic_x, mask=mask)
    tl.store(quadratic_gradient_ptr + 2 * i + 1, g_quadratic_y, mask=mask)
    tl.store(colour_gradient_ptr + 3 * i, g_red, mask=mask)
    tl.store(colour_gradient_ptr + 3 * i + 1, g_green, mask=mask)
    tl.store(colour_gradient_ptr + 3 * i + 2, g_blue, mask=mask)
    if SUMS == 4:
        tl.store(log_opacity_gradient_ptr + i, g_log_opacity, mask=mask)
