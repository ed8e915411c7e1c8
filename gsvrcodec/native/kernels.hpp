// The shapes that the scene and the kernels share, and the table of kernels of one instruction set.
// Equations: spec/gsvr.md, section "Reconstruction".
#pragma once

#include <cstdint>

namespace gsvr {

constexpr int kChannels = 8;        // dx, dy, dsx, dsy, dtheta, dr, dg, db
constexpr float kCutoff = 1.0f / 255.0f;
constexpr float kSupport = 5.541263545158426f;  // ln 255: a Gaussian ends at this exponent
constexpr float kMinScale = 0.1f;   // px of the coded frame
constexpr float kDilation = 0.1f;   // px^2 of the coded frame, added to each covariance
constexpr int kStripWidth = 8;      // columns of a strip
constexpr int kRowFloats = 3 * kStripWidth;
constexpr int kBlock = 16;          // Gaussians whose splats lie together

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

// kBlock deformed Gaussians on the frame. With dx, dy from the centre and u = dy - slope dx, the
// exponent is across dx^2 + down u^2: a sum of squares, which does not cancel when they are thin.
struct alignas(64) Splats {
    float cx[kBlock], cy[kBlock];        // centre, px
    float slope[kBlock];                 // of the line that halves the ellipse's columns
    float across[kBlock], down[kBlock];  // px^-2
    float decay[kBlock];                 // exp(-2 down r^2), r = Kernels::rows
    float low_x[kBlock];                 // dx of the ellipse's lowest point (largest y), px
    float colour[3][kBlock];
    std::int32_t x_begin[kBlock], x_end[kBlock];      // columns it may touch, on the frame; the
                                                      // first a multiple of Kernels::columns
    std::int32_t row_begin[kBlock], row_end[kBlock];  // rows; empty when it touches no pixel
};

// Rows [begin, end) that any of a block's splats touches.
struct Extent {
    int begin, end;
};

// Sums over pixels that the backward rasteriser leaves for one Gaussian.
struct alignas(32) Moments {
    float colour[3];
    float x, y, xx, xy, yy;
};

// Rows [first_row, first_row + rows) of a frame, in vertical strips of kStripWidth columns:
// [strip][row / r][channel][row % r][column], r = Kernels::rows. All rows of a strip lie together,
// so that a Gaussian's columns lie in few pages and cache lines. first_row and rows are multiples
// of r. Rows and columns beyond the frame are scratch.
struct Pixels {
    float *data;
    int first_row, rows;
};

struct Kernels {
    const char *isa;
    int lanes;
    int columns, rows;  // neighbouring pixels of one vector; columns * rows = lanes
    int band_rows;      // rows that are rasterised at once: bounds the recurrence's rounding
    // Deforms and projects the Gaussians of blocks [begin, end).
    void (*project)(const Model &, const Frame &, int begin, int end, Splats *, Extent *);
    // Adds a model's splats to the rows of one band.
    void (*rasterise)(const Splats *, const Extent *, int blocks, Extent band, Pixels);
    // Rows [begin, end) to interleaved samples, and back; the samples' first row is `begin`.
    void (*to_rgb8)(Pixels, const Frame &, Extent rows, std::uint8_t *out);
    void (*to_float)(Pixels, const Frame &, Extent rows, float *out);
    void (*from_float)(const float *in, const Frame &, Extent rows, Pixels);
    // Replaces rows by (clamp(value) - target) * scale; returns the sum of squared residuals.
    double (*residual)(Pixels, const Frame &, Extent rows, const std::uint8_t *target, float scale);
    // Gradients of the Gaussians of blocks [begin, end) from the gradient of the whole frame's
    // pixels. Plane gradients are added to `xy` and to the lines; the rest goes to `gradient`.
    void (*backward)(const Model &, const Frame &, const Splats *, const Extent *, Pixels, int begin,
                     int end, const Model &gradient, float *xy, float *xt_line, float *yt_line);
    // One Adam step over n numbers. `rate` (bias correction included) has `period` entries and
    // repeats; the second moment is scaled by `correction` before its root.
    void (*adam)(float *value, const float *gradient, float *mean, float *square, std::int64_t n,
                 const float *rate, int period, float beta1, float beta2, float correction,
                 float epsilon);
};

extern const Kernels kKernels_portable;
#ifdef GSVR_X86_64
extern const Kernels kKernels_avx2;
extern const Kernels kKernels_avx512;
#endif

}  // namespace gsvr
