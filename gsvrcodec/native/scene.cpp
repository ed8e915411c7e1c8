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

int Setting::scratch_rows() const { return padded(std::min(kernels.band_rows, size.height)); }

void Scene::reserve(const Setting &setting, int bands, Workspace &space) {
    const Model &m = setting.model;
    space.splats.reserve(setting.blocks());
    space.extents.reserve(setting.blocks());
    space.lines.reserve(static_cast<std::size_t>(m.gx + m.gy) * kChannels);
    if (bands) space.pixels.reserve(bands * setting.floats(setting.scratch_rows()));
}

void Scene::reserve_backward(const Setting &setting, Workspace &space) {
    reserve(setting, 0, space);
    space.pixels.reserve(setting.floats(setting.size.height));
    space.plane_gradients.reserve(kGroups * plane_floats(setting.model));
    space.sums.reserve(setting.bands());
}

Scene::Scene(const Setting &setting, float tau, int threads, Workspace &space)
    : setting_(setting), space_(space), threads_(threads) {
    const Model &m = setting.model;
    frame_ = {tau, setting.size.width, setting.size.height, setting.coded.width,
              setting.coded.height, nullptr, nullptr};
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
                                space.splats.get(), space.extents.get());
    });
}

Pixels Scene::rasterise(Extent rows, float *whole, int worker) const {
    const int held = whole ? setting_.padded(frame_.height) : setting_.scratch_rows();
    Pixels pixels = {whole, 0, held};
    if (!whole)
        pixels = {space_.pixels.get() + worker * setting_.floats(held), rows.begin, held};
    const std::size_t strip = static_cast<std::size_t>(held) * kRowFloats;
    const std::size_t first = static_cast<std::size_t>(rows.begin - pixels.first_row) * kRowFloats;
    const std::size_t bytes =
        static_cast<std::size_t>(setting_.padded(rows.end - rows.begin)) * kRowFloats * sizeof(float);
    for (int s = 0; s < setting_.strips(); ++s) std::memset(pixels.data + s * strip + first, 0, bytes);
    setting_.kernels.rasterise(space_.splats.get(), space_.extents.get(), setting_.blocks(), rows, pixels);
    return pixels;
}

void Scene::backward(float *whole, const Model &gradient) const {
    const Model &m = setting_.model;
    const Pixels pixels = {whole, 0, setting_.padded(frame_.height)};
    const std::size_t xy = static_cast<std::size_t>(m.gx) * m.gy * kChannels;
    const std::size_t xt = static_cast<std::size_t>(m.gx) * kChannels;
    const std::size_t group = plane_floats(m);
    float *sums = space_.plane_gradients.get();
    const int blocks = setting_.blocks(), size = (blocks + kGroups - 1) / kGroups;
    parallel_for(kGroups, threads_, [&](int job, int) {
        float *own = sums + job * group;
        if (group) std::memset(own, 0, group * sizeof(float));
        setting_.kernels.backward(m, frame_, space_.splats.get(), space_.extents.get(), pixels,
                                  std::min(job * size, blocks), std::min(job * size + size, blocks),
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
