#include "bench.hpp"

#include <algorithm>
#include <chrono>
#include <string>
#include <vector>

#include "isa.hpp"
#include "pool.hpp"

namespace gsvr {
namespace {

const BenchKernels &bench_kernels() {
#ifdef GSVR_X86_64
    for (const BenchKernels *k : {&kBench_avx2, &kBench_avx512})
        if (std::string(k->isa) == kernels().isa) return *k;
#endif
    return kBench_portable;
}

}  // namespace

void bench_plain(const Model &model, Size size, int threads, std::uint8_t *out) {
    constexpr int kChunk = 2048;
    const BenchKernels &k = bench_kernels();
    // Kept between calls, so that memory is not what is measured. One caller at a time.
    static std::vector<PlainSplat> splats;
    static std::vector<std::vector<std::vector<int>>> lists;
    splats.resize(model.n);
    parallel_for((model.n + kChunk - 1) / kChunk, threads, [&](int job, int) {
        k.project(model, size, job * kChunk, std::min(job * kChunk + kChunk, model.n),
                  splats.data());
    });
    const int columns = (size.width + kTileWidth - 1) / kTileWidth;
    lists.resize(threads);
    parallel_for((size.height + kTileHeight - 1) / kTileHeight, threads, [&](int job, int worker) {
        auto &tiles = lists[worker];
        tiles.resize(columns);
        for (auto &tile : tiles) tile.clear();
        const int y = job * kTileHeight;
        for (int i = 0; i < model.n; ++i) {
            const PlainSplat &s = splats[i];
            if (s.row_begin >= y + kTileHeight || s.row_end <= y) continue;
            for (int x = s.x_begin / kTileWidth; x * kTileWidth < s.x_end; ++x)
                tiles[x].push_back(i);
        }
        for (int x = 0; x < columns; ++x)
            k.tile(splats.data(), tiles[x].data(), static_cast<int>(tiles[x].size()),
                   x * kTileWidth, y, size, out);
    });
}

double bench_peak(int threads) {
    constexpr std::int64_t kRounds = 2000000;
    const BenchKernels &k = bench_kernels();
    const auto start = std::chrono::steady_clock::now();
    std::vector<double> done(threads);
    parallel_for(threads, threads, [&](int job, int) {
        float sink[2] = {0.999f, 0.001f};
        done[job] = k.multiply_add(kRounds, sink);
    });
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    double total = 0.0;
    for (double d : done) total += d;
    return total / seconds.count();
}

}  // namespace gsvr
