// The kernels that the native renderer is compared with: a plain rasteriser, and a loop of
// multiply-adds that measures the peak of the processor.
#pragma once

#include <cstdint>

namespace gsvr {

// Gaussians without deformation; shapes as in gsvrcodec/model/gop.py.
struct PlainGaussians {
    const float *position, *log_scale, *rotation, *colour;
    int n;
};

struct PlainFrame {
    int width, height;
};

// A projected Gaussian: centre, inverse covariance, colour and bounding box.
struct PlainSplat {
    float cx, cy, a, b, c, red, green, blue;
    int x_begin, x_end, row_begin, row_end;
};

constexpr int kTileWidth = 16, kTileHeight = 32;

struct BaselineKernels {
    const char *isa;
    // Projects the Gaussians [begin, end).
    void (*project)(const PlainGaussians &, PlainFrame, int begin, int end, PlainSplat *);
    // Rasterises the `count` splats of `list` on the tile whose first pixel is (x, y); `out` is
    // the whole frame of interleaved samples.
    void (*tile)(const PlainSplat *, const int *list, int count, int x, int y, PlainFrame,
                 std::uint8_t *out);
    // Runs `rounds` rounds of multiply-adds on registers and returns their number. The result in
    // `sink` keeps the compiler from dropping the loop.
    double (*multiply_add)(std::int64_t rounds, float *sink);
};

extern const BaselineKernels kBaseline_portable;
#ifdef GSVR_X86_64
extern const BaselineKernels kBaseline_avx2;
extern const BaselineKernels kBaseline_avx512;
#endif

}  // namespace gsvr
