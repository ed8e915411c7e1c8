#include "baseline.hpp"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <vector>

#include "pool.hpp"

#define GSVR_EXPORT extern "C" __attribute__((visibility("default")))

namespace gsvr {
namespace {

const BaselineKernels &kernels_of(const char *isa) {
#ifdef GSVR_X86_64
    for (const BaselineKernels *k : {&kBaseline_avx2, &kBaseline_avx512})
        if (!std::strcmp(k->isa, isa)) return *k;
#endif
    return kBaseline_portable;
}

void render(const BaselineKernels &kernels, const PlainGaussians &gaussians, PlainFrame frame,
            int threads, std::uint8_t *out) {
    constexpr int kChunk = 2048;
    // Memory is kept between calls: the time of allocation is not of interest. One caller at a time.
    static std::vector<PlainSplat> splats;
    static std::vector<std::vector<std::vector<int>>> lists;
    const int n = gaussians.n;
    splats.resize(n);
    parallel_for((n + kChunk - 1) / kChunk, threads, [&](int job, int) {
        kernels.project(gaussians, frame, job * kChunk, std::min(job * kChunk + kChunk, n),
                        splats.data());
    });
    const int columns = (frame.width + kTileWidth - 1) / kTileWidth;
    lists.resize(threads);
    parallel_for((frame.height + kTileHeight - 1) / kTileHeight, threads, [&](int job, int worker) {
        auto &tiles = lists[worker];
        tiles.resize(columns);
        for (auto &tile : tiles) tile.clear();
        const int y = job * kTileHeight;
        for (int i = 0; i < n; ++i) {
            const PlainSplat &s = splats[i];
            if (s.row_begin >= y + kTileHeight || s.row_end <= y) continue;
            for (int x = s.x_begin / kTileWidth; x * kTileWidth < s.x_end; ++x)
                tiles[x].push_back(i);
        }
        for (int x = 0; x < columns; ++x)
            kernels.tile(splats.data(), tiles[x].data(), static_cast<int>(tiles[x].size()),
                         x * kTileWidth, y, frame, out);
    });
}

}  // namespace
}  // namespace gsvr

// A frame by the plain method; `out` is (height, width, 3).
GSVR_EXPORT void gsvr_plain_render(const char *isa, const float *position, const float *log_scale,
                                   const float *rotation, const float *colour, int n, int width,
                                   int height, int threads, std::uint8_t *out) {
    gsvr::render(gsvr::kernels_of(isa), {position, log_scale, rotation, colour, n}, {width, height},
                 threads, out);
}

// Multiply-adds a second, all threads together.
GSVR_EXPORT double gsvr_multiply_adds_per_second(const char *isa, int threads) {
    constexpr std::int64_t kRounds = 2000000;
    const gsvr::BaselineKernels &kernels = gsvr::kernels_of(isa);
    std::vector<double> counts(threads);
    const auto start = std::chrono::steady_clock::now();
    gsvr::parallel_for(threads, threads, [&](int job, int) {
        float sink[2] = {0.999f, 0.001f};
        counts[job] = kernels.multiply_add(kRounds, sink);
    });
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    double total = 0.0;
    for (double count : counts) total += count;
    return total / seconds.count();
}
