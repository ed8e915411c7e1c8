// The data that the frame renderer and the kernels share, and the table of one instruction set's
// kernels.
// Equations: spec/gsvr.md, section "Reconstruction".
#pragma once

#include <cstddef>
#include <cstdint>

#include "reconstruction.hpp"

namespace gsvr {

constexpr int kChannels = 8;  // dx, dy, dsx, dsy, dtheta; dr, dg, db of a sum, or the log-opacity
                              // of a mean and two without effect
constexpr float kLog2E = 1.44269504088896f;
constexpr int kStripWidth = 8;  // pixel columns of a strip
// Red, green, blue, and the weight that a mean divides them by; a sum has no use for it.
constexpr int kSums = 4;
constexpr int kRowFloats = kSums * kStripWidth;
constexpr int kBlock = 16;  // Gaussians of a block; the splats of a block are stored together

// A layer is the dynamic or the static splats of one pyramid level: layer l < kLevels has the
// dynamic splats of level l, layer kLevels + l the static ones.
constexpr int kLayers = 2 * kLevels;

// The parameters of one GOP, or the gradients of the parameters: the arrays of model/gop.py.
struct GopArrays {
    float *position, *log_scale, *rotation, *colour, *log_opacity, *indicator, *linear, *quadratic;
    float *xy, *xt, *yt;
    int n, gx, gy, gt;  // gx = 0: no tri-plane
};

// One frame to render: its time, its size, and the size of the coded frame, in whose pixels the
// Gaussians have their scales.
struct Frame {
    float tau;
    int width, height, coded_width, coded_height;
    float zoom;                      // the lesser of width / coded_width, height / coded_height
    float level_log_scale[kLevels];  // smallest log-scale of each level; [0] is not used
    bool mean;                       // the picture is a mean, else a sum
    bool separate_static;  // static splats have their own layers, else they count as dynamic
    const float *xt_line;  // (gx, 8): the xt grid interpolated at tau
    const float *yt_line;  // (gy, 8): the yt grid interpolated at tau
};

// The splats of a block: kBlock Gaussians, deformed and projected to the frame. With the offset
// (dx, dy) of a pixel from the centre and u = dy - slope dx, the weight of the pixel, before the
// cut-off, is 2^-(across dx^2 + down u^2). A sum of squares loses no precision on thin Gaussians.
struct alignas(64) Splats {
    float cx[kBlock], cy[kBlock];        // centre, px
    float slope[kBlock];                 // of the line through the middles of the ellipse's columns
    float across[kBlock], down[kBlock];  // px^-2
    float decay[kBlock];                 // 2^(-2 down r^2), r the pixel rows of a vector
    float lowest_dx[kBlock];             // dx of the ellipse's point with the largest y, px
    float colour[kSums][kBlock];         // factors of the weight: of the colours, and of itself
    // The bounding box, in pixels of the splat's level, clipped to the picture. x_begin is rounded
    // down to the start of a vector. The box of a splat that touches no pixel has no rows.
    std::int32_t x_begin[kBlock], x_end[kBlock], row_begin[kBlock], row_end[kBlock];
    std::int32_t layer[kBlock];
};

// Rows or columns [begin, end).
struct Range {
    int begin, end;
};

// Some rows of a picture, or all, and some columns. The columns begin at the first of a strip; they
// end there too, or with the picture.
struct Tile {
    Range rows, columns;
};

// Pixels of a tile of level 0: a tile stays in the second cache of most processors. Its rows are a
// whole number of bands of every instruction set.
constexpr int kTileColumns = 256, kTileRows = 64;
// A cell is a part of a tile: so many columns of a band.
constexpr int kCellColumns = 32;

// The box that the splats of one block touch in one layer. The moments of the block start at
// `slot`: one for each band that the block touches.
struct BlockBox {
    Range rows, columns;
    int slot;

    bool empty() const { return rows.begin >= rows.end; }
    bool touches(Tile tile) const {
        return rows.begin < tile.rows.end && rows.end > tile.rows.begin &&
               columns.begin < tile.columns.end && columns.end > tile.columns.begin;
    }
};

inline int blocks(const GopArrays &gop) { return (gop.n + kBlock - 1) / kBlock; }

// The number of bands that a block touches.
inline int block_bands(const BlockBox &box, int band_rows) {
    const Range rows = box.rows;
    return box.empty() ? 0 : (rows.end - 1) / band_rows - rows.begin / band_rows + 1;
}

// The splats of one layer. The blocks [begin, end) contain all of them, mixed with the splats of
// other layers.
struct SplatLayer {
    const Splats *splats;   // of all blocks, all layers
    const BlockBox *boxes;  // of all blocks, this layer
    int index, begin, end;
    int band_rows;  // rows of a band of the layer's level

    bool empty() const { return begin >= end; }
    // Where the moments of a block in a band that it touches are, and whether a tile of that band
    // is the first that the block touches; tiles come from left to right.
    int slot(int block, Range band) const {
        const BlockBox &box = boxes[block];
        return box.slot + band.begin / band_rows - box.rows.begin / band_rows;
    }
    bool first(int block, Tile tile) const {
        return boxes[block].columns.begin >= tile.columns.begin;
    }
};

// Sums over the pixels of a band from which the gradients of a block's Gaussians are computed:
// moments of the weighted gradient of the pixels, about the centre of each Gaussian.
struct alignas(64) Moments {
    float of[kBlock][8];   // red, green, blue, x, y, xx, xy, yy
    float weight[kBlock];  // as red, of the weight
};

// The rows [first_row, first_row + rows) of a picture, stored in vertical strips of kStripWidth
// columns: [place][row / r][channel][row % r][column], with r the pixel rows of a vector. All rows
// of a strip are stored together, so that a splat touches few pages and cache lines. first_row and
// rows are multiples of r. Rows and columns beyond the picture hold arbitrary values.
struct Pixels {
    float *data;
    int first_row, rows;
    // The place of a strip is `strip & place_mask`: kAllStrips if each strip of the picture has its
    // own, 2^n - 1 if the strips take 2^n places in turn.
    int place_mask;

    static constexpr int kAllStrips = ~0;
    // The floats before those of a strip.
    std::ptrdiff_t strip_offset(int strip) const {
        return static_cast<std::ptrdiff_t>(strip & place_mask) * rows * kRowFloats;
    }
};

// The codes of a plate: planes of Y, Cb and Cr of full range. All rows and columns of whole strips
// and of whole pairs of rows may be read.
struct PlateCodes {
    const std::uint8_t *y;
    std::ptrdiff_t line, plane;  // bytes from one row to the next, and from one plane to the next
};

// What lies behind the splats of a tile: pixels, or a plate; or nothing, if both are null.
struct Base {
    const Pixels *pixels;
    const PlateCodes *plate;
};

// How Adam steps; see `Adam`.
struct AdamRule {
    float beta1, beta2, epsilon, agreeing, opposing;
};

struct Kernels {
    const char *isa;
    int lanes;      // floats of a vector
    int band_rows;  // rows of a band on level 0; bounds the rounding errors of the recurrence
    // The share of the static Gaussians in the area of all, about that in pixels of their levels.
    double (*static_share)(const GopArrays &);
    // Deforms and projects the Gaussians of the blocks [begin, end). `boxes` is (kLayers, blocks);
    // the slots are not written.
    void (*project)(const GopArrays &, const Frame &, int begin, int end, Splats *,
                    BlockBox *boxes);
    // Adds the splats of one layer to the pixels of a tile.
    void (*rasterise)(const SplatLayer &, Tile, Pixels);
    // Sets the pixels of a tile to the sums of a plate.
    void (*from_plate)(const PlateCodes &, Tile, Pixels);
    // Upsamples the next coarser level to a tile of a level, and adds the tile of the base, whose
    // pixels may be `fine`.
    void (*upsample)(Pixels coarse, int coarse_width, int coarse_height, Pixels fine, Tile, Base);
    // The adjoint of upsample: writes the gradient of the next coarser level from a tile of `fine`,
    // the gradient of a level, which must be zero beyond the picture. The tiles of a band come from
    // left to right, each of whole coarse strips. The last coarse strip of a tile is written with
    // the next tile, whose first pixels it needs: `fine` must still hold the last three strips of
    // the tile then. The parts of the coarse rows just above and just below the written rows go to
    // `edges`: two rows, each of kRowFloats for each strip of the coarse level. blank: the tile is
    // zero; only its first and last three strips are read.
    void (*downsample)(Pixels fine, int fine_width, int fine_height, Tile, bool blank,
                       Pixels coarse, int coarse_width, float *edges);
    // Convert the pixels of a tile to interleaved samples of the frame, which begins at `out`.
    // to_planes8 writes three planes instead. to_sums writes all four sums as they are.
    void (*to_rgb8)(Pixels, const Frame &, Tile, std::uint8_t *out);
    void (*to_planes8)(Pixels, const Frame &, Tile, std::uint8_t *out);
    void (*to_float)(Pixels, const Frame &, Tile, float *out);
    void (*to_sums)(Pixels, const Frame &, Tile, float *out);
    // Replaces the pixels of a tile by the gradient of sum(weights * picture); `weights` are of the
    // frame.
    void (*from_float)(const float *weights, const Frame &, Tile, Pixels);
    // Replaces the pixels of a tile by the gradient of sum(scale / 2 * square(clamp(picture) -
    // target)), in which that of the clamp counts as 1, and returns the sum of the squares;
    // `target` is the frame.
    double (*residual)(Pixels, const Frame &, Tile, const std::uint8_t *target, float scale);
    // Adds to the moments of the splats of one layer, from the gradient of the pixels of a tile.
    // The tiles of a band come from left to right: the first that a block touches clears the
    // block's moments in the band.
    void (*gather_moments)(const SplatLayer &, Tile, Pixels, Moments *);
    // Computes the gradients of the Gaussians of the blocks [begin, end) from the moments of all
    // bands. The gradients of the tri-plane are added to `xy` and to the two lines; the others are
    // written to `gradient`.
    void (*backward)(const GopArrays &, const Frame &, const SplatLayer (&)[kLayers],
                     const Moments *, int begin, int end, const GopArrays &gradient, float *xy,
                     float *xt_line, float *yt_line);
    // One Adam step for n parameters. `rate` has `period` vectors of learning rates, which include
    // the bias correction of the first moment; `pace` has a factor of each rate, null = 1;
    // `correction` is the factor of the second moment.
    void (*adam)(float *value, const float *gradient, float *mean, float *square, const float *pace,
                 std::int64_t n, const float *rate, int period, const AdamRule &, float correction);
    // Replaces n values, whole vectors, by the slopes of their prices; see `Priced`.
    void (*price)(float *value, const float *usual, const float *step, const float *change,
                  const float *fresh, std::int64_t n);
    // Writes n sums, whole vectors: of values[i], values[i + shift] and so on, so many.
    void (*sum_shifted)(const float *values, int shift, int times, float *sums, std::int64_t n);
};

extern const Kernels kKernels_portable;
#ifdef GSVR_X86_64
extern const Kernels kKernels_avx2;
extern const Kernels kKernels_avx512;
#endif

}  // namespace gsvr
