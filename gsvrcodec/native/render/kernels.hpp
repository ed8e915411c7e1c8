// The shapes that the scene and the kernels share, and the table of kernels of one instruction set.
// Equations: spec/gsvr.md, section "Reconstruction".
#pragma once

#include <cstdint>

#include "reconstruction.hpp"

namespace gsvr {

constexpr int kChannels = 8;  // dx, dy, dsx, dsy, dtheta, dr, dg, db
constexpr float kLog2E = 1.44269504088896f;
constexpr int kStripWidth = 8;  // columns of a strip
constexpr int kRowFloats = 3 * kStripWidth;
constexpr int kBlock = 16;  // Gaussians whose splats lie together

constexpr int kLayers = 2 * kLevels;  // what moves on each level, then what stands still

// Parameters of one GOP, or the gradients with respect to them: the arrays of model/gop.py.
struct GopArrays {
    float *position, *log_scale, *rotation, *colour, *indicator, *linear, *quadratic;
    float *xy, *xt, *yt;
    int n, gx, gy, gt;  // gx = 0: no tri-plane
};

// One frame to render: its time and its size, with the size that scales are relative to.
struct Frame {
    float tau;
    int width, height, coded_width, coded_height;
    float zoom;                      // of its sides against the coded ones, the lesser
    float level_log_scale[kLevels];  // least log-scale of each level; that of level 0 is not used
    bool separate_static;                    // Gaussians that stand still are in layers of their own
    const float *xt_line;  // (gx, 8): the xt grid at tau
    const float *yt_line;  // (gy, 8)
};

// kBlock deformed Gaussians on the frame. With dx, dy from the centre and u = dy - slope dx, a
// weight is 2^-(across dx^2 + down u^2): a sum of squares, which does not cancel when thin.
struct alignas(64) Splats {
    float cx[kBlock], cy[kBlock];        // centre, px
    float slope[kBlock];                 // of the line that halves the ellipse's columns
    float across[kBlock], down[kBlock];  // px^-2
    float decay[kBlock];                 // 2^(-2 down r^2), r rows to a vector
    float lowest_dx[kBlock];                 // dx of the ellipse's lowest point (largest y), px
    float colour[3][kBlock];
    std::int32_t x_begin[kBlock], x_end[kBlock];      // columns it may touch, on the frame; the
                                                      // first one that begins a vector
    std::int32_t row_begin[kBlock], row_end[kBlock];  // rows; empty when it touches no pixel
    std::int32_t layer[kBlock];                       // these are in pixels of its level
};

// Rows [begin, end).
struct RowRange {
    int begin, end;
};

// Rows that any of a block's splats touches in one layer, and where its moments lie: kBlock for
// each band that it touches, from slot * kBlock on.
struct BlockRows {
    int begin, end, slot;
};

inline int blocks(const GopArrays &gop) { return (gop.n + kBlock - 1) / kBlock; }

inline int block_bands(const BlockRows &rows, int band_rows) {
    return rows.begin < rows.end ? (rows.end - 1) / band_rows - rows.begin / band_rows + 1 : 0;
}

// The splats of one layer: blocks [begin, end) hold some, among those of other layers.
struct SplatLayer {
    const Splats *splats;   // of all blocks
    const BlockRows *rows;  // of all blocks
    int index, begin, end;
    int band_rows;  // rows of a band of its level

    bool empty() const { return begin >= end; }
};

// Sums over pixels of one band that the gradient of one Gaussian is made of.
struct alignas(32) Moments {
    float colour[3];
    float x, y, xx, xy, yy;
};

// Rows [first_row, first_row + rows) of a picture, in vertical strips of kStripWidth columns:
// [strip][row / r][channel][row % r][column], r rows to a vector. All rows of a strip lie together,
// so that a Gaussian's columns lie in few pages and cache lines. first_row and rows are multiples
// of r. Rows and columns beyond the picture are scratch.
struct Pixels {
    float *data;
    int first_row, rows;
};

struct Kernels {
    const char *isa;
    int lanes;      // floats of a vector
    int band_rows;  // rows that are rasterised at once: bounds the recurrence's rounding
    // Deforms and projects the Gaussians of blocks [begin, end). `rows` holds all blocks of layer 0,
    // then those of layer 1 and so on; slots are left as they are.
    void (*project)(const GopArrays &, const Frame &, int begin, int end, Splats *, BlockRows *rows);
    // Adds the splats of one layer to the rows of one band of its level.
    void (*rasterise)(const SplatLayer &, RowRange band, Pixels);
    // Sets rows of a picture to the next level at twice its size, or adds that to them.
    void (*upsample)(Pixels coarse, int coarse_width, int coarse_height, Pixels fine,
                     int fine_width, RowRange rows, bool add);
    // The adjoint: sets rows of the next level's gradient from those of `fine`, which are zero
    // beyond the picture. What falls on the rows before and after them goes to `edges`, two lines
    // of kRowFloats for each strip of the next level.
    void (*downsample)(Pixels fine, int fine_width, int fine_height, RowRange rows, Pixels coarse,
                       int coarse_width, float *edges);
    // Rows to interleaved samples, and back; the samples' first row is the first of `rows`.
    void (*to_rgb8)(Pixels, const Frame &, RowRange rows, std::uint8_t *out);
    void (*to_float)(Pixels, const Frame &, RowRange rows, float *out);
    void (*from_float)(const float *in, const Frame &, RowRange rows, Pixels);
    // Replaces rows by (clamp(value + backdrop) - target) * scale; returns the sum of squared
    // residuals. `backdrop` may be null.
    double (*residual)(Pixels, const Frame &, RowRange rows, const std::uint8_t *target,
                       const float *backdrop, float scale);
    // Moments of the splats of one layer from the gradient `pixels` of one band of its level.
    void (*gather_moments)(const SplatLayer &, RowRange band, Pixels, Moments *);
    // Gradients of the Gaussians of blocks [begin, end) from the moments of all bands. Plane
    // gradients are added to `xy` and to the lines; the rest is written to `gradient`.
    void (*backward)(const GopArrays &, const Frame &, const SplatLayer (&)[kLayers], const Moments *,
                     int begin, int end, const GopArrays &gradient, float *xy, float *xt_line,
                     float *yt_line);
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
