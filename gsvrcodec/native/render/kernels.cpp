// The kernels of one instruction set (GSVR_ISA, GSVR_LANES): deformation and projection,
// rasterisation, and their gradients. The kernels call no function of the C++ library: simd.hpp
// says why.
#include "kernels.hpp"

#include <cstddef>
#include <utility>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#define GSVR_JOIN_(a, b) a##b
#define GSVR_JOIN(a, b) GSVR_JOIN_(a, b)
#define GSVR_NAME_(a) #a
#define GSVR_NAME(a) GSVR_NAME_(a)

namespace gsvr {
namespace GSVR_ISA {
namespace {

#include "simd.hpp"
#include "shuffle.hpp"
#include "segments.hpp"
#include "lookup.hpp"
#include "deform.hpp"
#include "deform_backward.hpp"
#include "raster.hpp"
#include "base.hpp"
#include "pyramid.hpp"
#include "rows.hpp"
#include "adam.hpp"
#include "price.hpp"

}  // namespace
}  // namespace GSVR_ISA

extern const Kernels GSVR_JOIN(kKernels_, GSVR_ISA);
const Kernels GSVR_JOIN(kKernels_, GSVR_ISA) = {
    GSVR_NAME(GSVR_ISA),  GSVR_LANES,           GSVR_ISA::kBandRows,  GSVR_ISA::static_share,
    GSVR_ISA::project,    GSVR_ISA::rasterise,  GSVR_ISA::from_plate, GSVR_ISA::upsample,
    GSVR_ISA::downsample, GSVR_ISA::to_rgb8,    GSVR_ISA::to_planes8, GSVR_ISA::to_float,
    GSVR_ISA::to_sums,    GSVR_ISA::from_float, GSVR_ISA::residual,   GSVR_ISA::gather_moments,
    GSVR_ISA::backward,   GSVR_ISA::adam,       GSVR_ISA::price,      GSVR_ISA::sum_shifted,
};

}  // namespace gsvr
