// Renders whole frames, forward and backward, on the threads of the pool.
#pragma once

#include <cstdint>

#include "kernels.hpp"
#include "workspace.hpp"

namespace gsvr {

struct Size {
    int width, height;
};

// What lies behind a frame: sums that are added to its own, or a plate, whose codes take less
// memory than its sums, and less time to be read again and again.
class Backdrop {
   public:
    // `sums` is (height, width, 4).
    Backdrop(const float *sums, Size);
    // `ycc` is (3, height, width).
    Backdrop(const std::uint8_t *ycc, Size);
    Size size() const { return size_; }
    // For tiles of level 0.
    Base base() const {
        return {sums_.get() ? &pixels_ : nullptr, codes_.get() ? &plate_ : nullptr};
    }
    // Floats of a vector of the kernels that it was made for.
    int lanes() const { return lanes_; }

   private:
    const Size size_;
    const int lanes_;
    Buffer<float> sums_;  // as those of frames lie in memory
    Buffer<std::uint8_t> codes_;
    Pixels pixels_{};
    PlateCodes plate_{};
};

// What pictures are made of and how: a GOP; the size to render at; the size in whose pixels the
// Gaussians have their scales; whether pictures are means, or sums.
struct Scene {
    const GopArrays &gop;
    Size size, coded;
    bool mean;
};

// Render a GOP at the `frames` times of `taus`, in front of a backdrop, which may be null; `out` is
// (frames, height, width, 3).
void render_rgb8(const Scene &, const float *taus, int frames, int threads,
                 const Backdrop *backdrop, std::uint8_t *out);
// The same, but `out` is (frames, 3, height, width).
void render_planes8(const Scene &, const float *taus, int frames, int threads,
                    const Backdrop *backdrop, std::uint8_t *out);
void render_float(const Scene &, const float *taus, int frames, int threads,
                  const Backdrop *backdrop, float *out);
// The same, but `out` is (frames, height, width, 4): the sums of the weighted colours, and of the
// weights, which the ground has no part in.
void render_sums(const Scene &, const float *taus, int frames, int threads,
                 const Backdrop *backdrop, float *out);

// Writes the squared error of each pixel of a mean, clamped, in 8-bit codes, summed over the
// colours. `sums` is (pixels, 4), `target` (pixels, 3), `out` (pixels).
void pixel_errors(const float *sums, const std::uint8_t *target, std::size_t pixels, float *out);

// Writes the gradients of sum(frame * weights) of one frame; `weights` is (height, width, 3).
// `backdrop` may be null.
void backward_float(const Scene &, float tau, int threads, const float *weights,
                    const Backdrop *backdrop, const GopArrays &gradient);

// Returns the mean squared error of the frame, clamped to [0, 1], against `target`, and writes the
// gradients of the error; the gradient of the clamp counts as 1 everywhere. `target` is
// (height, width, 3); `backdrop` as above. `weights` has a factor of the error for each tile of
// kTileRows and kTileColumns; where it is 0, nothing is drawn. Null: all are 1.
double squared_error(const Scene &, float tau, int threads, const std::uint8_t *target,
                     const Backdrop *backdrop, const float *weights, const GopArrays &gradient);

// n parameters that Adam moves. The learning rate of parameter i is rate[i % period], times pace[i]
// unless `pace` is null. If `axes` is not null, the parameters are pairs, of which each moves along
// two axes of its own: axes[4 i] to axes[4 i + 3] is the matrix from steps to pair i, by rows.
struct AdamPart {
    float *value, *mean, *square;
    std::int64_t n;
    const float *rate;
    int period;
    const float *pace, *axes;
};

struct Adam {
    double factor;  // of all rates
    double beta1, beta2, epsilon;
    double agreeing, opposing;  // factors of a step that the gradient agrees with, or opposes
    std::int64_t step;          // counts from 1
};

// Takes a step of all parts, each by its gradient.
void adam_step(const AdamPart *parts, const float *const *gradients, int count, const Adam &,
               int threads);

// Values whose bits have a price, (n, columns). `carried` is null, or of each row the share to
// which it belongs to the reference.
struct Priced {
    const float *value, *step, *carried;
    std::int64_t n;
    int columns, near;  // neighbours whose mean is the usual value; 0: the usual value is 0
    float change;       // price of a value of what is carried
    float fresh;        // price of what the others differ by from the usual
};

// Writes change carried S(value) + fresh (1 - carried) S(value - usual) to `out`, (n, columns),
// where S(x) = sign(x) / (|x| + step) is the derivative of ln(1 + |x| / step).
void price_slopes(const Priced &, float *out, int threads);

}  // namespace gsvr
