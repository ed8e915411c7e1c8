// The shapes that core.cpp and the kernels share, and the table of kernels of one instruction set.
// Equations: spec/gsvr.md, section "Reconstruction".
#pragma once

#include <cstdint>

namespace gsvr {

constexpr int kChannels = 8;        // dx, dy, dsx, dsy, dtheta, dr, dg, db
constexpr float kCutoff = 1.0f / 255.0f;
constexpr float kSupport = 5.541263545158426f;  // ln 255: a Gaussian ends at this exponent
constexpr float kMinScale = 0.1f;   // px of the coded frame
constexpr float kDilation = 0.1f;   // px^2 of the coded frame, added to each covariance
constexpr int kBandRows = 32;       // rows that one band of the accumulator holds
constexpr int kStripWidth = 16;     // columns of a strip
constexpr int kRowFloats = 3 * kStripWidth;

// Parameters of one GOP, or the gradients with respect to them: the arrays of model/gop.py.
struct Model {
    float *position, *log_scale, *rotation, *colour, *alpha, *linear, *quadratic;
    float *xy, *xt, *yt;
    int n, gx, gy, gt;  // gx = 0: no tri-plane
};

// One frame to render: its time and its size, with the size that scales are relative to.
struct Frame {
    float tau;
    int width, height, coded_width, coded_height;
    const float *xt_line;        // (gx, 8): the xt grid at tau
    const float *yt_line;        // (gy, 8)
};

// A deformed Gaussian on the frame: one cache line.
struct alignas(64) Splat {
    float cx, cy;          // centre, px
    float a, b, c;         // inverse covariance: exponent = (a dx^2 + 2 b dx dy + c dy^2) / 2
    float k;               // exp(-c)
    float half_width;      // of the ellipse where the exponent is kSupport, px
    float slope;           // of its conjugate diameter, -b / c
    float top;             // dx of its lowest point (largest y), px
    float bend;            // (half_height of a column)^2 = (half_width^2 - dx^2) * bend
    float colour[3];
    int row_begin, row_end;  // rows it touches, clipped to the frame; empty when it touches none
};

// Sums over pixels that the backward rasteriser leaves for one Gaussian.
struct Moments {
    float colour[3];
    float x, y, xx, xy, yy;
};

// Pixels are held in vertical strips of kStripWidth columns: [strip][row][channel][column], all
// rows of a strip together, so that a Gaussian's columns lie in few pages and cache lines. A buffer
// holds `strip_rows` rows in each strip; the columns beyond the frame's width are scratch.
struct Kernels {
    const char *isa;
    int lanes;
    // Deforms and projects Gaussians [begin, end).
    void (*project)(const Model &, const Frame &, int begin, int end, Splat *splats);
    // Adds the listed splats to rows [row_begin, row_end); pixels[0] is in row_begin.
    void (*rasterise)(const Splat *splats, const int *list, int count, const Frame &,
                      int row_begin, int row_end, float *pixels, int strip_rows);
    // One row to interleaved samples, and back.
    void (*row_to_rgb8)(const float *row, const Frame &, int strip_rows, std::uint8_t *out);
    void (*row_to_float)(const float *row, const Frame &, int strip_rows, float *out);
    void (*row_from_float)(const float *in, const Frame &, int strip_rows, float *row);
    // Replaces a row by (clamp(value) - target) * scale; returns the sum of squared residuals.
    double (*row_residual)(float *row, const Frame &, int strip_rows, const std::uint8_t *target,
                           float scale);
    // Gradients of Gaussians [begin, end) from the gradient of the whole frame's `pixels`. Plane
    // gradients are added to `xy` and to the lines; the rest is written to `gradient`.
    void (*backward)(const Model &, const Frame &, const Splat *splats, const float *pixels,
                     int begin, int end, const Model &gradient, float *xy, float *xt_line,
                     float *yt_line);
};

extern const Kernels kKernels_portable;
#ifdef GSVR_X86_64
extern const Kernels kKernels_avx2;
extern const Kernels kKernels_avx512;
#endif

}  // namespace gsvr
