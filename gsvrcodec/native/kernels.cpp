// The kernels of one instruction set (GSVR_ISA, GSVR_LANES): deformation and projection,
// rasterisation, and their gradients. No function of the C++ library is called here, see simd.hpp.
#include "kernels.hpp"

#define GSVR_JOIN_(a, b) a##b
#define GSVR_JOIN(a, b) GSVR_JOIN_(a, b)
#define GSVR_NAME_(a) #a
#define GSVR_NAME(a) GSVR_NAME_(a)

namespace gsvr {
namespace GSVR_ISA {
namespace {

#include "simd.hpp"
#include "deform.hpp"
#include "raster.hpp"
#include "rows.hpp"

void backward(const Model &model, const Frame &frame, const Splat *splats, const float *pixels,
              int begin, int end, const Model &gradient, float *xy, float *xt_line,
              float *yt_line) {
    Moments moments[kLanes];
    for (int i = begin; i < end; i += kLanes) {
        const int count = min(kLanes, end - i);
        for (int l = 0; l < count; ++l) moments[l] = splat_moments(splats[i + l], frame, pixels);
        deform_backward(model, frame, splats, moments, i, count, gradient, xy, xt_line, yt_line);
    }
}

}  // namespace
}  // namespace GSVR_ISA

extern const Kernels GSVR_JOIN(kKernels_, GSVR_ISA);
const Kernels GSVR_JOIN(kKernels_, GSVR_ISA) = {
    GSVR_NAME(GSVR_ISA),     GSVR_LANES,
    GSVR_ISA::project,       GSVR_ISA::rasterise,
    GSVR_ISA::row_to_rgb8,   GSVR_ISA::row_to_float,
    GSVR_ISA::row_from_float, GSVR_ISA::row_residual,
    GSVR_ISA::backward,
};

}  // namespace gsvr
