#include "scene.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace gsvr {
namespace {

constexpr int kProjectBlocks = 128;  // blocks a job
// What stands still is kept when it is this part of all areas: to copy it costs time as well.
constexpr double kWorthKeeping = 0.15;
// The backward pass sums plane gradients in this many groups of blocks, whatever the number of
// threads, so that results do not depend on it.
constexpr int kGroups = 16;

// Where a time lies in a grid's gt slices: the nearer two and the weight of the second.
struct Instant {
    int low, high;
    float weight;
};

Instant instant(float tau, int gt) {
    const float last = static_cast<float>(gt - 1);
    // Comparisons in this order send NaN to the first slice.
    const float t = std::min(std::max(0.0f, (tau + 1.0f) * 0.5f * last), last);
    const int low = static_cast<int>(t);
    return {low, std::min(low + 1, gt - 1), t - static_cast<float>(low)};
}

// The slice of a (gt, cells, 8) grid at a time.
void slice(const float *grid, int cells, Instant at, float *line) {
    const std::size_t width = static_cast<std::size_t>(cells) * kChannels;
    const float *a = grid + at.low * width, *b = grid + at.high * width;
    for (std::size_t i = 0; i < width; ++i) line[i] = a[i] + (b[i] - a[i]) * at.weight;
}

// The gradient of a slice to that of the grid.
void spread(const float *line, int gt, int cells, Instant at, float *grid) {
    const std::size_t width = static_cast<std::size_t>(cells) * kChannels;
    std::memset(grid, 0, gt * width * sizeof(float));
    for (std::size_t i = 0; i < width; ++i) {
        grid[at.low * width + i] += line[i] * (1.0f - at.weight);
        grid[at.high * width + i] += line[i] * at.weight;
    }
}

// Floats of the gradients of the xy grid and of the two time slices.
std::size_t plane_floats(const Model &m) {
    return (static_cast<std::size_t>(m.gx) * m.gy + m.gx + m.gy) * kChannels;
}

// Adds a line of edges to a row of a picture whose vectors have `lanes` pixels.
void add_line(const float *line, const Level &level, int row, int lanes, const Pixels &pixels) {
    const int rows = std::max(lanes / kStripWidth, 1);
    float *p = pixels.data + static_cast<std::size_t>(row / rows) * rows * kRowFloats +
               row % rows * kStripWidth;
    for (int strip = 0; strip < level.strips(); ++strip)
        for (int c = 0; c < 3; ++c)
            for (int i = 0; i < kStripWidth; ++i)
                p[(static_cast<std::size_t>(strip) * pixels.rows * 3 + c * rows) * kStripWidth +
                  i] += line[(strip * 3 + c) * kStripWidth + i];
}

// Floats of the pictures of levels [first, end), one after the other.
std::size_t picture_floats(const Setting &setting, int first = 1, int end = kLevels) {
    std::size_t floats = 0;
    for (int level = first; level < end; ++level) floats += setting.levels[level].floats();
    return floats;
}

// Floats of the edges that the bands of a level leave: two lines of the next level each.
std::size_t edge_floats(const Setting &setting, int levels = kLevels - 1) {
    std::size_t floats = 0;
    for (int level = 0; level < levels; ++level)
        floats += 2 * setting.levels[level].bands() * setting.levels[level + 1].line_floats();
    return floats;
}

}  // namespace

Extent Level::band(int index) const {
    const int begin = index * band_rows;
    return {begin, std::min(begin + band_rows, size.height)};
}

Setting::Setting(const Model &model_, Size size_, Size coded_, bool apart_)
    : model(model_), size(size_), coded(coded_), kernels(gsvr::kernels()), apart(apart_) {
    for (int level = 0; level < kLevels; ++level) {
        const int round_up = (1 << level) - 1;
        // Shorter bands above: there are few of them for the threads to share.
        levels[level] = {{(size.width + round_up) >> level, (size.height + round_up) >> level},
                         level ? kernels.band_rows / 2 : kernels.band_rows};
    }
}

void Scene::reserve(const Setting &setting, int bands, Workspace &space) {
    const Model &m = setting.model;
    space.splats.reserve(blocks(m));
    space.rows.reserve(static_cast<std::size_t>(blocks(m)) * kLayers);
    space.lines.reserve(static_cast<std::size_t>(m.gx + m.gy) * kChannels);
    space.pixels.reserve(bands * setting.levels[0].band_floats());
    space.pictures.reserve(picture_floats(setting));
}

Scene::Scene(const Setting &setting, float tau, int threads, Workspace &space, const Still &still)
    : setting_(setting), space_(space), threads_(threads), still_(still), top_(still.top) {
    const Model &m = setting.model;
    const double zoom = std::min(static_cast<double>(setting.size.width) / setting.coded.width,
                                 static_cast<double>(setting.size.height) / setting.coded.height);
    frame_ = {tau,
              setting.size.width,
              setting.size.height,
              setting.coded.width,
              setting.coded.height,
              static_cast<float>(zoom),
              {},
              setting.apart,
              nullptr,
              nullptr};
    for (int level = 1; level < kLevels; ++level)
        frame_.level_log_scale[level] =
            static_cast<float>(std::log(kLevelScale * (1 << level) / zoom));
    if (m.gx > 0) {
        float *xt = space.lines.get(), *yt = xt + m.gx * kChannels;
        slice(m.xt, m.gx, instant(tau, m.gt), xt);
        slice(m.yt, m.gy, instant(tau, m.gt), yt);
        frame_.xt_line = xt;
        frame_.yt_line = yt;
    }
    const int count = still.pictures ? still.blocks : blocks(m);
    parallel_for((count + kProjectBlocks - 1) / kProjectBlocks, threads, [&](int job, int) {
        const int begin = job * kProjectBlocks;
        setting.kernels.project(m, frame_, begin, std::min(begin + kProjectBlocks, count),
                                space.splats.get(), space.rows.get());
    });
    for (int layer = 0; layer < kLayers; ++layer) {
        const BlockRows *rows = space.rows.get() + static_cast<std::size_t>(layer) * blocks(m);
        const auto empty = [&](int block) { return rows[block].begin >= rows[block].end; };
        int begin = 0, end = still.pictures && layer >= kLevels ? 0 : count;
        while (begin < end && empty(begin)) ++begin;
        while (begin < end && empty(end - 1)) --end;
        const int level = layer % kLevels;
        layers_[layer] = {space.splats.get(),           rows, layer, begin, end,
                          setting.levels[level].band_rows};
        if (begin < end) top_ = std::max(top_, level);
    }
}

Still Scene::keep_still() const {
    double still = 0.0, all = 0.0;
    Still kept{nullptr, 0, 0};
    const int count = blocks(setting_.model);
    for (int block = 0; block < count; ++block) {
        const Splats &s = space_.splats.get()[block];
        for (int lane = 0; lane < kBlock; ++lane) {
            if (s.layer[lane] < kLevels) kept.blocks = block + 1;
            if (s.row_begin[lane] >= s.row_end[lane]) continue;
            const double area = static_cast<double>(s.x_end[lane] - s.x_begin[lane]) *
                                (s.row_end[lane] - s.row_begin[lane]);
            all += area;
            if (s.layer[lane] >= kLevels) still += area;
        }
    }
    if (still <= kWorthKeeping * all) return kept;
    float *pictures = space_.still.reserve(picture_floats(setting_, 0));
    for (int level = 0; level < kLevels; ++level) {
        if (!layers_[kLevels + level].empty()) kept.top = level;
        const Level &own = setting_.levels[level];
        parallel_for(own.bands(), threads_, [&](int index, int) {
            begin_band(level, own.band(index), whole(pictures, 0, level));
        });
    }
    kept.pictures = pictures;
    return kept;
}

Pixels Scene::whole(float *pictures, int first, int level) const {
    const Level &own = setting_.levels[level];
    return {pictures + picture_floats(setting_, first, level), 0, own.bands() * own.band_rows};
}

Pixels Scene::picture(int level) const { return whole(space_.pictures.get(), 1, level); }

Pixels Scene::picture_gradient(int level) const {
    return whole(space_.picture_gradients.get(), 1, level);
}

float *Scene::edges(int level) const { return space_.edges.get() + edge_floats(setting_, level); }

void Scene::render_levels() const {
    for (int level = top_; level > 0; --level) {
        const Level &own = setting_.levels[level];
        parallel_for(own.bands(), threads_, [&](int index, int) {
            rasterise(level, own.band(index), picture(level));
        });
    }
}

void Scene::begin_band(int level, Extent rows, const Pixels &pixels) const {
    const Level &own = setting_.levels[level];
    const std::size_t bytes = sizeof(float) * kRowFloats * own.band_rows;
    const auto strip_of = [&](const Pixels &of, int strip) {
        const std::size_t row = static_cast<std::size_t>(strip) * of.rows + rows.begin;
        return of.data + (row - of.first_row) * kRowFloats;
    };
    if (still_.pictures) {
        const Pixels kept = whole(const_cast<float *>(still_.pictures), 0, level);
        for (int strip = 0; strip < own.strips(); ++strip)
            std::memcpy(strip_of(pixels, strip), strip_of(kept, strip), bytes);
        return;
    }
    for (int strip = 0; strip < own.strips(); ++strip)
        std::memset(strip_of(pixels, strip), 0, bytes);
    setting_.kernels.rasterise(layers_[kLevels + level], rows, pixels);
}

void Scene::rasterise(int level, Extent rows, const Pixels &pixels) const {
    const Level &own = setting_.levels[level];
    // A picture that is to be set need not be cleared.
    const bool add = level == top_ || still_.pictures || !layers_[kLevels + level].empty();
    if (add) begin_band(level, rows, pixels);
    if (level < top_) {
        const Size above = setting_.levels[level + 1].size;
        setting_.kernels.upsample(picture(level + 1), above.width, above.height, pixels,
                                  own.size.width, rows, add);
    }
    setting_.kernels.rasterise(layers_[level], rows, pixels);
}

void Scene::gather(int level, Extent rows, const Pixels &pixels) const {
    setting_.kernels.gather(layers_[level], rows, pixels, space_.moments.get());
    if (level == top_) return;
    const Level &own = setting_.levels[level], &above = setting_.levels[level + 1];
    setting_.kernels.downsample(
        pixels, own.size.width, own.size.height, rows, picture_gradient(level + 1),
        above.size.width, edges(level) + rows.begin / own.band_rows * 2 * above.line_floats());
}

void Scene::gather_levels() const {
    for (int level = 1; level <= top_; ++level) {
        const Level &own = setting_.levels[level], &below = setting_.levels[level - 1];
        const Pixels pixels = picture_gradient(level);
        for (int index = 0; index < below.bands(); ++index) {
            const Extent band = below.band(index);
            const float *lines = edges(level - 1) + 2 * index * own.line_floats();
            const int lanes = setting_.kernels.lanes;
            if (index) add_line(lines, own, band.begin / 2 - 1, lanes, pixels);
            if (index + 1 < below.bands())
                add_line(lines + own.line_floats(), own, band.end / 2, lanes, pixels);
        }
        parallel_for(own.bands(), threads_,
                     [&](int index, int) { gather(level, own.band(index), pixels); });
    }
}

void Scene::reserve_backward() const {
    space_.plane_gradients.reserve(kGroups * plane_floats(setting_.model));
    space_.picture_gradients.reserve(picture_floats(setting_));
    space_.edges.reserve(edge_floats(setting_));
    BlockRows *rows = space_.rows.get();
    std::size_t slots = 0;
    for (const Layer &of : layers_)
        for (int block = 0; block < blocks(setting_.model); ++block, ++rows) {
            rows->slot = static_cast<int>(slots);
            slots += block_bands(*rows, of.band_rows);
        }
    space_.moments.reserve(slots * kBlock);
}

void Scene::backward_deformation(const Model &gradient) const {
    const Model &m = setting_.model;
    const std::size_t xy = static_cast<std::size_t>(m.gx) * m.gy * kChannels;
    const std::size_t xt = static_cast<std::size_t>(m.gx) * kChannels;
    const std::size_t group = plane_floats(m);
    float *sums = space_.plane_gradients.get();
    const int count = blocks(m), size = (count + kGroups - 1) / kGroups;
    parallel_for(kGroups, threads_, [&](int job, int) {
        float *own = sums + job * group;
        if (group) std::memset(own, 0, group * sizeof(float));
        setting_.kernels.backward(m, frame_, layers_, space_.moments.get(),
                                  std::min(job * size, count), std::min(job * size + size, count),
                                  gradient, own, own + xy, own + xy + xt);
    });
    if (m.gx == 0) return;
    for (int job = 1; job < kGroups; ++job)
        for (std::size_t i = 0; i < group; ++i) sums[i] += sums[job * group + i];
    std::memcpy(gradient.xy, sums, xy * sizeof(float));
    spread(sums + xy, m.gt, m.gx, instant(frame_.tau, m.gt), gradient.xt);
    spread(sums + xy + xt, m.gt, m.gy, instant(frame_.tau, m.gt), gradient.yt);
}

}  // namespace gsvr
