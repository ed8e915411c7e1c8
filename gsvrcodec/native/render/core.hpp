// Rendering of whole frames, forward and backward, on the pool's threads.
#pragma once

#include <cstdint>

#include "kernels.hpp"

namespace gsvr {

struct Size {
    int width, height;
};

// Renders `frames` times of a GOP; `out` is (frames, height, width, 3).
void render_rgb8(const GopArrays &, const float *taus, int frames, Size size, Size coded, int threads,
                 std::uint8_t *out);
void render_float(const GopArrays &, const float *taus, int frames, Size size, Size coded, int threads,
                  float *out);

// Gradients of sum(render * weights), weights (height, width, 3), of one frame.
void backward_float(const GopArrays &, float tau, Size size, Size coded, int threads,
                    const float *weights, const GopArrays &gradient);

// Mean squared error of the clamped frame against `target` (height, width, 3) and its gradients,
// the clamp passed through. `backdrop` (height, width, 3), if not null, is added to the frame.
double squared_error(const GopArrays &, float tau, Size size, Size coded, int threads,
                     const std::uint8_t *target, const float *backdrop, const GopArrays &gradient);

// The state of Adam over n numbers; `rate` has `period` entries and repeats.
struct Adam {
    float *value;
    const float *gradient;
    float *mean, *square;
    std::int64_t n;
    const float *rate;
    int period;
    double beta1, beta2, epsilon;
    std::int64_t step;  // from 1
};

void adam_step(const Adam &, int threads);

}  // namespace gsvr
