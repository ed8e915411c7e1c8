// Renders whole frames, forward and backward, on the threads of the pool.
#pragma once

#include <cstdint>

#include "kernels.hpp"

namespace gsvr {

struct Size {
    int width, height;
};

// Render a GOP at the `frames` times of `taus`; `out` is (frames, height, width, 3). `size` is the
// size to render at; Gaussians have their scales in pixels of the size `coded`.
void render_rgb8(const GopArrays &, const float *taus, int frames, Size size, Size coded,
                 int threads, std::uint8_t *out);
// The same, but `out` is (frames, 3, height, width).
void render_planes8(const GopArrays &, const float *taus, int frames, Size size, Size coded,
                    int threads, std::uint8_t *out);
void render_float(const GopArrays &, const float *taus, int frames, Size size, Size coded,
                  int threads, float *out);

// Writes the gradients of sum(frame * weights) of one frame; `weights` is (height, width, 3).
void backward_float(const GopArrays &, float tau, Size size, Size coded, int threads,
                    const float *weights, const GopArrays &gradient);

// Returns the mean squared error of the frame, clamped to [0, 1], against `target`, and writes the
// gradients of the error; the gradient of the clamp counts as 1 everywhere. `target` and `backdrop`
// are (height, width, 3); `backdrop`, if not null, is added to the frame before the clamp.
double squared_error(const GopArrays &, float tau, Size size, Size coded, int threads,
                     const std::uint8_t *target, const float *backdrop, const GopArrays &gradient);

// The state of Adam for n parameters. The learning rate of parameter i is rate[i % period].
struct Adam {
    float *value;
    const float *gradient;
    float *mean, *square;
    std::int64_t n;
    const float *rate;
    int period;
    double beta1, beta2, epsilon;
    std::int64_t step;  // counts from 1
};

void adam_step(const Adam &, int threads);

}  // namespace gsvr
