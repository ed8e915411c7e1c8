// What each Gaussian does for a picture.
#pragma once

#include "../model/gaussians.hpp"
#include "core.hpp"

namespace gsvr {

// Adds to `effects` (n) the squared change of a picture of means, summed over colours and pixels,
// without each of n Gaussians. `look` has them as drawn; the picture of `size` has them and all
// others: `sums` is (height, width, 4). `coded` is the frame that the scales are relative to.
void add_effects(const LookArrays &look, int n, const float *sums, Size size, Size coded,
                 int threads, double *effects);

}  // namespace gsvr
