// For tests/benchmarks alone: what the kernels are measured against.
#pragma once

#include <cstdint>

#include "core.hpp"

namespace gsvr {

// A frame by the plain method: scalar source over 16x32 tiles, vectorised by the compiler for the
// instruction set in use, without deformation and without recurrence.
void bench_plain(const Model &, Size size, int threads, std::uint8_t *out);

// Multiply-adds a second on vectors in registers, all threads together.
double bench_peak(int threads);

// A Gaussian as the plain method sees it: inverse covariance, bounding box.
struct PlainSplat {
    float cx, cy, a, b, c, red, green, blue;
    int x_begin, x_end, row_begin, row_end;
};

constexpr int kTileWidth = 16, kTileHeight = 32;

struct BenchKernels {
    const char *isa;
    void (*project)(const Model &, Size, int begin, int end, PlainSplat *);
    // One tile whose first pixel is (x, y), to interleaved samples.
    void (*tile)(const PlainSplat *, const int *list, int count, int x, int y, Size,
                 std::uint8_t *out);
    // Multiply-adds done in `rounds` rounds; `sink` keeps the compiler from dropping them.
    double (*multiply_add)(std::int64_t rounds, float *sink);
};

extern const BenchKernels kBench_portable;
#ifdef GSVR_X86_64
extern const BenchKernels kBench_avx2;
extern const BenchKernels kBench_avx512;
#endif

}  // namespace gsvr
