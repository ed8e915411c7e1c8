// The plain rasteriser and the multiply-add loop, compiled for one instruction set. The source is
// scalar: the compiler vectorises it, as it would a renderer that was not written for SIMD.
#include "baseline.hpp"

#include <cstddef>

#include "kernels.hpp"

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#define GSVR_JOIN_(a, b) a##b
#define GSVR_JOIN(a, b) GSVR_JOIN_(a, b)
#define GSVR_NAME_(a) #a
#define GSVR_NAME(a) GSVR_NAME_(a)

namespace gsvr {
namespace GSVR_ISA {
namespace {

#include "simd.hpp"

// exp(x) for x in [-87, 0]; relative error below 2e-7.
static inline float plain_exp(float x) {
    const float t = x * 1.44269504088896f;
    const int whole = static_cast<int>(t - 0.5f);
    const float f = t - static_cast<float>(whole);
    float p = 1.327646680e-3f * f + 9.675541293e-3f;
    p = p * f + 5.550713290e-2f;
    p = p * f + 2.402211972e-1f;
    p = p * f + 6.931469671e-1f;
    p = p * f + 1.0f;
    return __builtin_bit_cast(float, __builtin_bit_cast(int, p) + whole * (1 << 23));
}

void plain_project(const PlainGaussians &m, PlainFrame frame, int begin, int end,
                   PlainSplat *splats) {
    const float width = static_cast<float>(frame.width);
    const float height = static_cast<float>(frame.height);
    for (int i = begin; i < end; ++i) {
        const float s0 = __builtin_expf(2.0f * m.log_scale[2 * i]);
        const float s1 = __builtin_expf(2.0f * m.log_scale[2 * i + 1]);
        const float cosine = __builtin_cosf(m.rotation[i]), sine = __builtin_sinf(m.rotation[i]);
        const float xx = cosine * cosine * s0 + sine * sine * s1 + kDilation;
        const float yy = sine * sine * s0 + cosine * cosine * s1 + kDilation;
        const float xy = cosine * sine * (s0 - s1);
        const float inverse = 1.0f / (xx * yy - xy * xy);
        const float cx = (m.position[2 * i] + 1.0f) * 0.5f * width;
        const float cy = (m.position[2 * i + 1] + 1.0f) * 0.5f * height;
        const float rx = __builtin_sqrtf(2.0f * kSupport * xx),
                    ry = __builtin_sqrtf(2.0f * kSupport * yy);
        splats[i] = {cx,
                     cy,
                     yy * inverse,
                     -xy * inverse,
                     xx * inverse,
                     m.colour[3 * i],
                     m.colour[3 * i + 1],
                     m.colour[3 * i + 2],
                     static_cast<int>(max(cx - rx, 0.0f)),
                     static_cast<int>(min(cx + rx + 1.0f, width)),
                     static_cast<int>(max(cy - ry, 0.0f)),
                     static_cast<int>(min(cy + ry + 1.0f, height))};
    }
}

void plain_tile(const PlainSplat *splats, const int *list, int count, int x, int y,
                PlainFrame frame, std::uint8_t *out) {
    float sum[3][kTileHeight][kTileWidth] = {};
    for (int n = 0; n < count; ++n) {
        const PlainSplat s = splats[list[n]];
        const int begin = max(s.row_begin - y, 0), end = min(s.row_end - y, kTileHeight);
        for (int row = begin; row < end; ++row) {
            const float dy = static_cast<float>(y + row) + 0.5f - s.cy;
            float *red = sum[0][row], *green = sum[1][row], *blue = sum[2][row];
            for (int i = 0; i < kTileWidth; ++i) {
                const float dx = static_cast<float>(x + i) + 0.5f - s.cx;
                const float exponent = 0.5f * (s.a * dx * dx + s.c * dy * dy) + s.b * dx * dy;
                const float w = max(plain_exp(-min(exponent, 80.0f)) - kCutoff, 0.0f);
                red[i] += w * s.red;
                green[i] += w * s.green;
                blue[i] += w * s.blue;
            }
        }
    }
    for (int row = 0; row < min(kTileHeight, frame.height - y); ++row)
        for (int i = 0; i < min(kTileWidth, frame.width - x); ++i)
            for (int c = 0; c < 3; ++c)
                out[(static_cast<std::ptrdiff_t>(y + row) * frame.width + x + i) * 3 + c] =
                    static_cast<std::uint8_t>(min(max(sum[c][row][i], 0.0f), 1.0f) * 255.0f + 0.5f);
}

double multiply_add(std::int64_t rounds, float *sink) {
    constexpr int kChains = 10;
    vf v[kChains];
    for (int i = 0; i < kChains; ++i) v[i] = broadcast(static_cast<float>(i));
    const vf factor = broadcast(sink[0]), term = broadcast(sink[1]);
    for (std::int64_t round = 0; round < rounds; ++round)
        for (vf &chain : v) chain = chain * factor + term;
    for (const vf &chain : v) sink[0] += chain[0];
    return static_cast<double>(rounds) * kChains * kLanes;
}

}  // namespace
}  // namespace GSVR_ISA

extern const BaselineKernels GSVR_JOIN(kBaseline_, GSVR_ISA);
const BaselineKernels GSVR_JOIN(kBaseline_, GSVR_ISA) = {
    GSVR_NAME(GSVR_ISA),
    GSVR_ISA::plain_project,
    GSVR_ISA::plain_tile,
    GSVR_ISA::multiply_add,
};

}  // namespace gsvr
