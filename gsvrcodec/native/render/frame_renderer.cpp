#include "frame_renderer.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace gsvr {
namespace {

constexpr int kProjectBlocks = 128;  // blocks of Gaussians that a job projects
// Static splats have layers of their own if they have at least this share of the area of all.
// Below it, the pictures of these layers cost more than rasterisation.
constexpr double kLeastStaticShare = 0.4;
// The backward pass sums the gradients of the tri-plane in this many groups of blocks. The number
// is fixed, so that the order of the sums does not depend on the number of threads.
constexpr int kGradientGroups = 16;

// The two of a grid's gt time slices that a time lies between, and the weight of the later slice.
struct TimeSlices {
    int low, high;
    float weight;
};

TimeSlices time_slices(float tau, int gt) {
    const float last = static_cast<float>(gt - 1);
    // With the operands in this order, NaN becomes the first slice.
    const float t = std::min(std::max(0.0f, (tau + 1.0f) * 0.5f * last), last);
    const int low = static_cast<int>(t);
    return {low, std::min(low + 1, gt - 1), t - static_cast<float>(low)};
}

// Interpolates a (gt, cells, 8) grid at one time; `line` is (cells, 8).
void interpolate_slices(const float *grid, int cells, TimeSlices at, float *line) {
    const std::size_t width = static_cast<std::size_t>(cells) * kChannels;
    const float *a = grid + at.low * width, *b = grid + at.high * width;
    for (std::size_t i = 0; i < width; ++i) line[i] = a[i] + (b[i] - a[i]) * at.weight;
}

// The adjoint: writes the gradient of the (gt, cells, 8) grid from the gradient of the line.
void scatter_slices(const float *line, int gt, int cells, TimeSlices at, float *grid) {
    const std::size_t width = static_cast<std::size_t>(cells) * kChannels;
    std::memset(grid, 0, gt * width * sizeof(float));
    for (std::size_t i = 0; i < width; ++i) {
        grid[at.low * width + i] += line[i] * (1.0f - at.weight);
        grid[at.high * width + i] += line[i] * at.weight;
    }
}

// Floats of the gradients of the xy grid and of the two interpolated lines.
std::size_t plane_floats(const GopArrays &gop) {
    return (static_cast<std::size_t>(gop.gx) * gop.gy + gop.gx + gop.gy) * kChannels;
}

// Adds one row of edge gradients to a row of a picture whose vectors have `lanes` pixels.
void add_line(const float *line, const PyramidLevel &level, int row, int lanes,
              const Pixels &pixels) {
    const int rows = std::max(lanes / kStripWidth, 1);
    float *p = pixels.data + static_cast<std::size_t>(row / rows) * rows * kRowFloats +
               row % rows * kStripWidth;
    for (int strip = 0; strip < level.strips(); ++strip)
        for (int c = 0; c < kSums; ++c)
            for (int i = 0; i < kStripWidth; ++i)
                p[(static_cast<std::size_t>(strip) * pixels.rows * kSums + c * rows) * kStripWidth +
                  i] += line[(strip * kSums + c) * kStripWidth + i];
}

// Calls body(rows, columns) for the box of each splat of a layer.
template <class Body>
void for_boxes(const SplatLayer &layer, Body body) {
    for (int block = layer.begin; block < layer.end; ++block) {
        const Splats &s = layer.splats[block];
        for (int l = 0; l < kBlock; ++l) {
            const Range rows{s.row_begin[l], s.row_end[l]}, columns{s.x_begin[l], s.x_end[l]};
            if (s.layer[l] == layer.index && rows.begin < rows.end && columns.begin < columns.end)
                body(rows, columns);
        }
    }
}

// Floats of the pictures of the levels [first, end).
std::size_t picture_floats(const RenderCall &call, int first = 1, int end = kLevels) {
    std::size_t floats = 0;
    for (int level = first; level < end; ++level) floats += call.levels[level].floats();
    return floats;
}

// Floats of the edge rows of the levels [0, levels): each band has two rows of the next level, one
// above the band and one below it.
std::size_t edge_floats(const RenderCall &call, int levels = kLevels - 1) {
    std::size_t floats = 0;
    for (int level = 0; level < levels; ++level)
        floats += 2 * call.levels[level].bands() * call.levels[level + 1].line_floats();
    return floats;
}

}  // namespace

Tile PyramidLevel::band(int index) const {
    const int begin = index * band_rows;
    return {{begin, std::min(begin + band_rows, size.height)}, {0, size.width}};
}

RenderCall::RenderCall(const GopArrays &gop_, Size size_, Size coded_, bool mean_,
                       bool may_separate)
    : gop(gop_),
      size(size_),
      coded(coded_),
      kernels(gsvr::kernels()),
      mean(mean_),
      separate_static(may_separate && kernels.static_share(gop) >= kLeastStaticShare) {
    for (int level = 0; level < kLevels; ++level) {
        const int round_up = (1 << level) - 1;
        // Coarse levels have few rows: shorter bands give each thread some.
        levels[level] = {{(size.width + round_up) >> level, (size.height + round_up) >> level},
                         level ? kernels.band_rows / 2 : kernels.band_rows};
    }
}

void FrameRenderer::reserve(const RenderCall &call, int bands, Workspace &space) {
    const GopArrays &gop = call.gop;
    space.splats.reserve(blocks(gop));
    space.boxes.reserve(static_cast<std::size_t>(blocks(gop)) * kLayers);
    space.lines.reserve(static_cast<std::size_t>(gop.gx + gop.gy) * kChannels);
    space.pixels.reserve(bands * 2 * tile_floats(call));
    space.pictures.reserve(picture_floats(call));
}

FrameRenderer::FrameRenderer(const RenderCall &call, float tau, int threads, Workspace &space,
                             const StaticPyramid &static_pyramid)
    : call_(call),
      space_(space),
      threads_(threads),
      static_pyramid_(static_pyramid),
      coarsest_(static_pyramid.coarsest) {
    const GopArrays &gop = call.gop;
    const double zoom = std::min(static_cast<double>(call.size.width) / call.coded.width,
                                 static_cast<double>(call.size.height) / call.coded.height);
    frame_ = {tau,
              call.size.width,
              call.size.height,
              call.coded.width,
              call.coded.height,
              static_cast<float>(zoom),
              {},
              call.mean,
              call.separate_static,
              nullptr,
              nullptr};
    for (int level = 1; level < kLevels; ++level)
        frame_.level_log_scale[level] =
            static_cast<float>(std::log(kLevelScale * (1 << level) / zoom));
    if (gop.gx > 0) {
        float *xt = space.lines.get(), *yt = xt + gop.gx * kChannels;
        interpolate_slices(gop.xt, gop.gx, time_slices(tau, gop.gt), xt);
        interpolate_slices(gop.yt, gop.gy, time_slices(tau, gop.gt), yt);
        frame_.xt_line = xt;
        frame_.yt_line = yt;
    }
    const int count = static_pyramid.pictures ? static_pyramid.dynamic_blocks : blocks(gop);
    parallel_for((count + kProjectBlocks - 1) / kProjectBlocks, threads, [&](int job, int) {
        const int begin = job * kProjectBlocks;
        call.kernels.project(gop, frame_, begin, std::min(begin + kProjectBlocks, count),
                             space.splats.get(), space.boxes.get());
    });
    for (int layer = 0; layer < kLayers; ++layer) {
        const BlockBox *boxes = space.boxes.get() + static_cast<std::size_t>(layer) * blocks(gop);
        int begin = 0, end = static_pyramid.pictures && layer >= kLevels ? 0 : count;
        while (begin < end && boxes[begin].empty()) ++begin;
        while (begin < end && boxes[end - 1].empty()) --end;
        const int level = layer % kLevels;
        layers_[layer] = {space.splats.get(),          boxes, layer, begin, end,
                          call.levels[level].band_rows};
        if (begin < end) coarsest_ = std::max(coarsest_, level);
    }
}

StaticPyramid FrameRenderer::draw_static_pyramid() const {
    const Cells cells(call_, nullptr);
    std::uint8_t *marks = space_.static_cells.reserve(Cells::count(call_, 1));
    std::fill_n(marks, Cells::count(call_, 1), std::uint8_t{0});
    for_boxes(layers_[kLevels],
              [&](Range rows, Range columns) { cells.mark(0, rows, columns, marks); });
    float *pictures = space_.static_pictures.reserve(picture_floats(call_, 0));
    StaticPyramid drawn{static_pyramid_.base, pictures, marks, blocks(call_.gop), 0};
    const auto is_static = [&](int block) {
        const auto &layer = space_.splats.get()[block].layer;
        return std::all_of(layer, layer + kBlock, [](int of) { return of >= kLevels; });
    };
    while (drawn.dynamic_blocks && is_static(drawn.dynamic_blocks - 1)) --drawn.dynamic_blocks;
    for (int level = 0; level < kLevels; ++level) {
        const SplatLayer &splats = layers_[kLevels + level];
        if (!splats.empty()) drawn.coarsest = level;
        const PyramidLevel &own = call_.levels[level];
        const Pixels pixels = level_pixels(pictures, 0, level);
        const auto draw = [&](Tile run, bool is_wanted) {
            if (!is_wanted) return;
            set_tile(level, run, level ? Base{} : static_pyramid_.base, pixels);
            call_.kernels.rasterise(splats, run, pixels);
        };
        parallel_for(own.bands(), threads_, [&](int index, int) {
            const Tile band = own.band(index);
            if (level) return draw(band, true);
            for_runs(band, [&](int x) { return marks[cells.at(0, band.rows.begin, x)]; }, draw);
        });
    }
    return drawn;
}

Pixels FrameRenderer::level_pixels(float *pictures, int first, int level) const {
    const PyramidLevel &own = call_.levels[level];
    return {pictures + picture_floats(call_, first, level), 0, own.bands() * own.band_rows,
            Pixels::kAllStrips};
}

Pixels FrameRenderer::static_picture(int level) const {
    return level_pixels(const_cast<float *>(static_pyramid_.pictures), 0, level);
}

Pixels FrameRenderer::picture(int level) const {
    return level_pixels(space_.pictures.get(), 1, level);
}

Pixels FrameRenderer::picture_gradient(int level) const {
    return level_pixels(space_.picture_gradients.get(), 1, level);
}

float *FrameRenderer::edges(int level) const {
    return space_.edges.get() + edge_floats(call_, level);
}

void Cells::mark(int level, Range rows, Range columns, std::uint8_t *marks) const {
    const PyramidLevel &own = call_.levels[level];
    const int left = std::max(columns.begin, 0);
    const int right = std::min(columns.end, own.size.width) - 1;
    const int bottom = std::min(rows.end, own.size.height) - 1;
    const int top = std::max(rows.begin, 0) / own.band_rows * own.band_rows;
    for (int y = top; y <= bottom; y += own.band_rows)
        std::fill(marks + at(level, y, left), marks + at(level, y, right) + 1, std::uint8_t{1});
}

void FrameRenderer::find_dynamic(const Cells &cells) const {
    std::uint8_t *marks = &cells.dynamic(0);
    std::fill_n(marks, cells.count(), std::uint8_t{0});
    for (int level = 0; level < kLevels; ++level)
        for_boxes(layers_[level], [&](Range rows, Range columns) {
            cells.mark(level, rows, columns, marks);
            // Upsampling spreads a pixel over four by four.
            for (int finer = level - 1; finer >= 0; --finer) {
                for (Range *of : {&rows, &columns}) *of = {2 * of->begin - 1, 2 * of->end + 1};
                cells.mark(finer, rows, columns, marks);
            }
        });
}

void FrameRenderer::render_levels(const Cells *cells) const {
    for (int level = coarsest_; level > 0; --level) {
        const PyramidLevel &own = call_.levels[level];
        parallel_for(own.bands(), threads_, [&](int index, int) {
            const Tile band = own.band(index);
            const auto draw = [&](Tile run, bool is_drawn) {
                if (!is_drawn) rasterise_tile(level, run, picture(level));
            };
            if (!cells) return draw(band, false);
            const auto is_drawn = [&](int x) {
                const int cell = cells->at(level, band.rows.begin, x);
                const bool was = cells->drawn(cell), still = !cells->dynamic(cell);
                cells->drawn(cell) = still;
                return was && still;
            };
            for_runs(band, is_drawn, draw);
        });
    }
}

void FrameRenderer::set_tile(int level, Tile tile, Base base, const Pixels &pixels) const {
    if (base.plate) return call_.kernels.from_plate(*base.plate, tile, pixels);
    const std::size_t bytes = sizeof(float) * kRowFloats * call_.levels[level].band_rows;
    const auto strip_of = [&](const Pixels &of, int strip) {
        return of.data + of.strip_offset(strip) + (tile.rows.begin - of.first_row) * kRowFloats;
    };
    for (int x = tile.columns.begin; x < tile.columns.end; x += kStripWidth) {
        float *own = strip_of(pixels, x / kStripWidth);
        if (base.pixels)
            std::memcpy(own, strip_of(*base.pixels, x / kStripWidth), bytes);
        else
            std::memset(own, 0, bytes);
    }
}

void FrameRenderer::set_static_tile(int level, Tile tile, bool is_drawn,
                                    const Pixels &pixels) const {
    const SplatLayer &splats = layers_[kLevels + level];
    const bool upsampled = level < coarsest_;
    const Pixels drawn = is_drawn ? static_picture(level) : Pixels{};
    Base base = level ? Base{} : static_pyramid_.base;
    if (is_drawn) base = {&drawn, nullptr};
    // Upsampling adds the base as it writes the tile.
    if (!upsampled || !splats.empty()) {
        set_tile(level, tile, base, pixels);
        call_.kernels.rasterise(splats, tile, pixels);
        base = {&pixels, nullptr};
    }
    if (!upsampled) return;
    const Size coarser = call_.levels[level + 1].size;
    call_.kernels.upsample(picture(level + 1), coarser.width, coarser.height, pixels, tile, base);
}

void FrameRenderer::rasterise_tile(int level, Tile tile, const Pixels &pixels) const {
    const std::uint8_t *drawn = static_pyramid_.cells;
    const auto set = [&](Tile run, bool is_drawn) {
        set_static_tile(level, run, is_drawn, pixels);
    };
    if (level == 0 && drawn) {
        const Cells cells(call_, nullptr);
        for_runs(tile, [&](int x) { return drawn[cells.at(0, tile.rows.begin, x)]; }, set);
    } else {
        set(tile, drawn);
    }
    call_.kernels.rasterise(layers_[level], tile, pixels);
}

void FrameRenderer::backward_tile(int level, Tile tile, const Pixels &pixels) const {
    call_.kernels.gather_moments(layers_[level], tile, pixels, space_.moments.get());
    downsample_tile(level, tile, false, pixels);
}

void FrameRenderer::skip_tile(Tile tile, const Pixels &pixels) const {
    const SplatLayer &layer = layers_[0];
    for (int block = layer.begin; block < layer.end; ++block)
        if (layer.boxes[block].touches(tile) && layer.first(block, tile))
            space_.moments.get()[layer.slot(block, tile.rows)] = {};
    const int begin = tile.columns.begin / kStripWidth;
    const int end = (tile.columns.end + kStripWidth - 1) / kStripWidth;
    for (int strip = begin; strip < end; ++strip)
        if (strip < begin + 3 || strip >= end - 3)
            std::memset(pixels.data + pixels.strip_offset(strip), 0,
                        sizeof(float) * kRowFloats * pixels.rows);
    downsample_tile(0, tile, true, pixels);
}

void FrameRenderer::downsample_tile(int level, Tile tile, bool blank, const Pixels &pixels) const {
    if (level == coarsest_) return;
    const PyramidLevel &own = call_.levels[level], &coarser = call_.levels[level + 1];
    const int index = tile.rows.begin / own.band_rows;
    call_.kernels.downsample(pixels, own.size.width, own.size.height, tile, blank,
                             picture_gradient(level + 1), coarser.size.width,
                             edges(level) + 2 * index * coarser.line_floats());
}

void FrameRenderer::add_edges(int level, Range rows) const {
    const PyramidLevel &own = call_.levels[level], &finer = call_.levels[level - 1];
    const auto add = [&](const float *line, int row) {
        if (rows.begin <= row && row < rows.end)
            add_line(line, own, row, call_.kernels.lanes, picture_gradient(level));
    };
    for (int index = 0; index < finer.bands(); ++index) {
        const Range band = finer.band(index).rows;
        const float *lines = edges(level - 1) + 2 * index * own.line_floats();
        if (index) add(lines, band.begin / 2 - 1);
        if (index + 1 < finer.bands()) add(lines + own.line_floats(), band.end / 2);
    }
}

void FrameRenderer::backward_levels() const {
    for (int level = 1; level <= coarsest_; ++level) {
        const PyramidLevel &own = call_.levels[level];
        parallel_for(own.bands(), threads_, [&](int index, int) {
            const Tile band = own.band(index);
            add_edges(level, band.rows);
            backward_tile(level, band, picture_gradient(level));
        });
    }
}

void FrameRenderer::reserve_backward() const {
    space_.plane_gradients.reserve(kGradientGroups * plane_floats(call_.gop));
    space_.picture_gradients.reserve(picture_floats(call_));
    space_.edges.reserve(edge_floats(call_));
    BlockBox *box = space_.boxes.get();
    std::size_t slots = 0;
    for (const SplatLayer &layer : layers_)
        for (int block = 0; block < blocks(call_.gop); ++block, ++box) {
            box->slot = static_cast<int>(slots);
            slots += block_bands(*box, layer.band_rows);
        }
    space_.moments.reserve(slots);
}

void FrameRenderer::backward_deformation(const GopArrays &gradient) const {
    const GopArrays &gop = call_.gop;
    const std::size_t xy = static_cast<std::size_t>(gop.gx) * gop.gy * kChannels;
    const std::size_t xt = static_cast<std::size_t>(gop.gx) * kChannels;
    const std::size_t group = plane_floats(gop);
    float *sums = space_.plane_gradients.get();
    const int count = blocks(gop), size = (count + kGradientGroups - 1) / kGradientGroups;
    parallel_for(kGradientGroups, threads_, [&](int job, int) {
        float *own = sums + job * group;
        if (group) std::memset(own, 0, group * sizeof(float));
        call_.kernels.backward(gop, frame_, layers_, space_.moments.get(),
                               std::min(job * size, count), std::min(job * size + size, count),
                               gradient, own, own + xy, own + xy + xt);
    });
    if (gop.gx == 0) return;
    for (int job = 1; job < kGradientGroups; ++job)
        for (std::size_t i = 0; i < group; ++i) sums[i] += sums[job * group + i];
    std::memcpy(gradient.xy, sums, xy * sizeof(float));
    scatter_slices(sums + xy, gop.gt, gop.gx, time_slices(frame_.tau, gop.gt), gradient.xt);
    scatter_slices(sums + xy + xt, gop.gt, gop.gy, time_slices(frame_.tau, gop.gt), gradient.yt);
}

}  // namespace gsvr
