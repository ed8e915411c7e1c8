// Renders one frame of a GOP, forward or backward: projects the Gaussians to splats, rasterises the
// splats on the pyramid levels, and adds up the levels.
#pragma once

#include <algorithm>

#include "core.hpp"
#include "isa.hpp"
#include "pool.hpp"
#include "workspace.hpp"

namespace gsvr {

// A pyramid level. A band is a number of consecutive rows that one thread rasterises at once.
struct PyramidLevel {
    Size size;
    int band_rows;

    int bands() const { return (size.height + band_rows - 1) / band_rows; }
    Tile band(int index) const;
    int strips() const { return (size.width + kStripWidth - 1) / kStripWidth; }
    int cells_across() const { return (size.width + kCellColumns - 1) / kCellColumns; }
    // Floats of one row of pixels, of one band and of the whole picture.
    std::size_t line_floats() const { return static_cast<std::size_t>(strips()) * kRowFloats; }
    std::size_t band_floats() const { return line_floats() * band_rows; }
    std::size_t floats() const { return band_floats() * bands(); }
};

// The inputs that all frames of one call share.
struct RenderCall {
    // mean: pictures are means, else sums. may_separate: if there are many, static splats are
    // rasterised before the dynamic ones, so that several frames can share their picture. Only the
    // GOP decides: a frame is the same whether it is rendered alone or with others.
    RenderCall(const GopArrays &, Size size, Size coded, bool mean, bool may_separate);

    const GopArrays &gop;
    const Size size, coded;
    const Kernels &kernels;
    const bool mean, separate_static;
    PyramidLevel levels[kLevels];
};

// What lies behind the splats of all frames of a call, and its static splats in front of that,
// which may be rasterised once for all frames.
struct StaticPyramid {
    static StaticPyramid in_front_of(const Backdrop *backdrop) {
        return {backdrop ? backdrop->base() : Base{}, nullptr, nullptr, 0, 0};
    }

    Base base;                  // behind level 0
    const float *pictures;      // with the static splats, of all levels, finest first; null: none
    const std::uint8_t *cells;  // of level 0: whether its picture is drawn, else it is the base
    int dynamic_blocks;         // all dynamic Gaussians are in the blocks [0, dynamic_blocks)
    int coarsest;               // the coarsest level with static splats; 0 without pictures
};

// Parts of the levels of a picture, kCellColumns wide and as high as a band.
class Cells {
   public:
    // `marks`: two for each cell.
    Cells(const RenderCall &call, std::uint8_t *marks) : call_(call), dynamic_(marks) {
        for (int level = 0; level <= kLevels; ++level) first_[level] = count(call, level);
    }

    // The cells of so many levels, finest first.
    static int count(const RenderCall &call, int levels) {
        int cells = 0;
        for (int level = 0; level < levels; ++level)
            cells += call.levels[level].bands() * call.levels[level].cells_across();
        return cells;
    }
    int count() const { return first_[kLevels]; }
    // The number of the cell at a pixel of a level.
    int at(int level, int row, int column) const {
        const PyramidLevel &own = call_.levels[level];
        return first_[level] + row / own.band_rows * own.cells_across() + column / kCellColumns;
    }
    // Sets the marks, one for each cell, of those that a box of a level touches.
    void mark(int level, Range rows, Range columns, std::uint8_t *marks) const;
    // Whether dynamic splats may show in a cell of this frame.
    std::uint8_t &dynamic(int cell) const { return dynamic_[cell]; }
    // Whether the picture of a coarser level in the workspace has the static splats alone there.
    std::uint8_t &drawn(int cell) const { return dynamic_[count() + cell]; }

   private:
    const RenderCall &call_;
    std::uint8_t *dynamic_;
    int first_[kLevels + 1];
};

// Calls body(run, key) for each run of the cells of a tile that have the same key(column).
template <class Key, class Body>
void for_runs(Tile tile, Key key, Body body) {
    int begin = tile.columns.begin, now = key(begin);
    for (int x = begin + kCellColumns; x < tile.columns.end; x += kCellColumns) {
        const int next = key(x);
        if (next == now) continue;
        body(Tile{tile.rows, {begin, x}}, now);
        begin = x;
        now = next;
    }
    body(Tile{tile.rows, {begin, tile.columns.end}}, now);
}

class FrameRenderer {
   public:
    // Reserves the memory that a frame needs when `bands` threads rasterise bands at the same time.
    static void reserve(const RenderCall &, int bands, Workspace &);

    // Projects the Gaussians at time `tau`; only the dynamic blocks if `static_pyramid` has
    // pictures. The workspace must have been reserved.
    FrameRenderer(const RenderCall &, float tau, int threads, Workspace &,
                  const StaticPyramid &static_pyramid);

    const Frame &frame() const { return frame_; }

    // Rasterises the static splats of all levels, which are separate, into the workspace.
    StaticPyramid draw_static_pyramid() const;

    // Rasterises the tiles of the frame, from the band `first_band` on. `cells` may be null: then
    // all of the frame is rasterised. Else copied_from(cell) says for each cell of level 0 whether
    // it is copied: 0 = no. Calls copy(tile, from) for each run of cells that are copied from the
    // same, and done(tile, pixels) for the others.
    template <class CopiedFrom, class Copy, class Done>
    void render(int first_band, const Cells *cells, CopiedFrom copied_from, Copy copy,
                Done done) const {
        render_levels(cells);
        for_tiles(first_band, 1, [&](int, Tile tile, const Pixels &pixels) {
            const auto draw = [&](Tile run, int from) {
                if (from) return copy(run, from);
                rasterise_tile(0, run, pixels);
                done(run, pixels);
            };
            if (!cells) return draw(tile, 0);
            for_runs(
                tile, [&](int x) { return copied_from(cells->at(0, tile.rows.begin, x)); }, draw);
        });
    }

    // Marks the cells in which dynamic splats may show.
    void find_dynamic(const Cells &) const;

    // Writes the gradients of all parameters. For each tile of each band, from left to right,
    // fill(band, tile, pixels) writes the gradient of the pixels to `pixels`, with zeros beyond the
    // frame. render_first: `pixels` holds the rasterised tile when `fill` is called. Where
    // looks(tile) is false, nothing is drawn, and the gradient is zero. Static splats must not be
    // separate.
    template <class Looks, class Fill>
    void backward(bool render_first, const GopArrays &gradient, Looks looks, Fill fill) const {
        reserve_backward();
        if (render_first) render_levels(nullptr);
        for_tiles(0, 2, [&](int band, Tile tile, const Pixels &pixels) {
            if (!looks(tile)) return skip_tile(tile, pixels);
            if (render_first) rasterise_tile(0, tile, pixels);
            fill(band, tile, pixels);
            backward_tile(0, tile, pixels);
        });
        backward_levels();
        backward_deformation(gradient);
    }

   private:
    static constexpr int kTileStrips = kTileColumns / kStripWidth;  // a power of two

    static std::size_t tile_floats(const RenderCall &call) {
        return static_cast<std::size_t>(kTileStrips) * kRowFloats * call.levels[0].band_rows;
    }

    // Calls body(band, tile, pixels) for each tile of level 0: bands from `first` on and around, or
    // some at the same time; the tiles of one from left to right. `pixels` holds the last `kept`
    // tiles, 1 or 2: `downsample` needs the tile on the left too.
    template <class Body>
    void for_tiles(int first, int kept, Body body) const {
        const PyramidLevel &frame = call_.levels[0];
        parallel_for(frame.bands(), threads_, [&](int job, int worker) {
            const int index = (first + job) % frame.bands();
            const Tile band = frame.band(index);
            const Pixels pixels{space_.pixels.get() + worker * 2 * tile_floats(call_),
                                band.rows.begin, frame.band_rows, kept * kTileStrips - 1};
            for (int x = 0; x < band.columns.end; x += kTileColumns) {
                const int end = std::min(x + kTileColumns, band.columns.end);
                body(index, Tile{band.rows, {x, end}}, pixels);
            }
        });
    }
    // The whole picture of a level above 0, and the gradient of that picture.
    Pixels picture(int level) const;
    Pixels picture_gradient(int level) const;
    // Gradients of the next coarser level: of the rows just above and just below each band of
    // `level`. They are added to the picture later, so that no two threads write the same row.
    float *edges(int level) const;
    // Adds the edges of the next finer level to rows of a level's picture gradient.
    void add_edges(int level, Range rows) const;
    // Rasterises the coarser levels, without the cells that have been drawn before and show the
    // same again; null: all.
    void render_levels(const Cells *) const;
    void backward_levels() const;
    // The pixels of a whole level in a buffer that holds the levels from `first` on.
    Pixels level_pixels(float *pictures, int first, int level) const;
    // A level of the picture of the static splats.
    Pixels static_picture(int level) const;
    // Sets a tile of a level to what lies behind it.
    void set_tile(int level, Tile, Base, const Pixels &) const;
    // Sets a tile of a level to all but its dynamic splats. is_drawn: its static splats are drawn.
    void set_static_tile(int level, Tile, bool is_drawn, const Pixels &) const;
    // Sets a tile of a level to the sum of its splats and of the coarser levels.
    void rasterise_tile(int level, Tile, const Pixels &) const;
    // From the gradient of a tile: moments of its splats, and gradient of the next coarser level.
    // The tiles of a band follow each other from left to right.
    void backward_tile(int level, Tile, const Pixels &) const;
    // The same for a tile of level 0 whose gradient is zero.
    void skip_tile(Tile, const Pixels &) const;
    // From the gradient of a tile, which is zero if `blank`: gradient of the next coarser level.
    void downsample_tile(int level, Tile, bool blank, const Pixels &) const;
    void reserve_backward() const;
    void backward_deformation(const GopArrays &gradient) const;

    const RenderCall &call_;
    Workspace &space_;
    const int threads_;
    Frame frame_;
    const StaticPyramid static_pyramid_;
    SplatLayer layers_[kLayers];
    int coarsest_;  // the coarsest level with any splat
};

}  // namespace gsvr
