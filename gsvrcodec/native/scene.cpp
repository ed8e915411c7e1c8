#include "scene.hpp"

#include <algorithm>
#include <cstring>

namespace gsvr {
namespace {

constexpr int kProjectBlocks = 128;  // blocks a job
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

}  // namespace

Extent Setting::band(int index) const {
    const int begin = index * kernels.band_rows;
    return {begin, std::min(begin + kernels.band_rows, size.height)};
}

void Scene::reserve(const Setting &setting, int bands, Workspace &space) {
    const Model &m = setting.model;
    space.splats.reserve(setting.blocks());
    space.rows.reserve(setting.blocks());
    space.lines.reserve(static_cast<std::size_t>(m.gx + m.gy) * kChannels);
    space.pixels.reserve(bands * setting.band_floats());
}

Scene::Scene(const Setting &setting, float tau, int threads, Workspace &space)
    : setting_(setting), space_(space), threads_(threads) {
    const Model &m = setting.model;
    frame_ = {tau,
              setting.size.width,
              setting.size.height,
              setting.coded.width,
              setting.coded.height,
              nullptr,
              nullptr};
    if (m.gx > 0) {
        float *xt = space.lines.get(), *yt = xt + m.gx * kChannels;
        slice(m.xt, m.gx, instant(tau, m.gt), xt);
        slice(m.yt, m.gy, instant(tau, m.gt), yt);
        frame_.xt_line = xt;
        frame_.yt_line = yt;
    }
    const int blocks = setting.blocks();
    parallel_for((blocks + kProjectBlocks - 1) / kProjectBlocks, threads, [&](int job, int) {
        const int begin = job * kProjectBlocks;
        setting.kernels.project(m, frame_, begin, std::min(begin + kProjectBlocks, blocks),
                                space.splats.get(), space.rows.get());
    });
}

void Scene::rasterise(Extent rows, const Pixels &pixels) const {
    std::memset(pixels.data, 0, setting_.band_floats() * sizeof(float));
    setting_.kernels.rasterise(space_.splats.get(), space_.rows.get(), setting_.blocks(), rows,
                               pixels);
}

void Scene::reserve_backward() const {
    space_.plane_gradients.reserve(kGroups * plane_floats(setting_.model));
    BlockRows *rows = space_.rows.get();
    std::size_t slots = 0;
    for (int block = 0; block < setting_.blocks(); ++block) {
        rows[block].slot = static_cast<int>(slots);
        slots += block_bands(rows[block], setting_.kernels.band_rows);
    }
    space_.moments.reserve(slots * kBlock);
}

void Scene::backward_deformation(const Model &gradient) const {
    const Model &m = setting_.model;
    const std::size_t xy = static_cast<std::size_t>(m.gx) * m.gy * kChannels;
    const std::size_t xt = static_cast<std::size_t>(m.gx) * kChannels;
    const std::size_t group = plane_floats(m);
    float *sums = space_.plane_gradients.get();
    const int blocks = setting_.blocks(), size = (blocks + kGroups - 1) / kGroups;
    parallel_for(kGroups, threads_, [&](int job, int) {
        float *own = sums + job * group;
        if (group) std::memset(own, 0, group * sizeof(float));
        setting_.kernels.backward(m, frame_, space_.splats.get(), space_.rows.get(),
                                  space_.moments.get(), std::min(job * size, blocks),
                                  std::min(job * size + size, blocks), gradient, own, own + xy,
                                  own + xy + xt);
    });
    if (m.gx == 0) return;
    for (int job = 1; job < kGroups; ++job)
        for (std::size_t i = 0; i < group; ++i) sums[i] += sums[job * group + i];
    std::memcpy(gradient.xy, sums, xy * sizeof(float));
    spread(sums + xy, m.gt, m.gx, instant(frame_.tau, m.gt), gradient.xt);
    spread(sums + xy + xt, m.gt, m.gy, instant(frame_.tau, m.gt), gradient.yt);
}

}  // namespace gsvr
