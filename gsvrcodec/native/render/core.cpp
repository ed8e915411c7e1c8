#include "core.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "frame_renderer.hpp"

namespace gsvr {
namespace {

// `row` is the distance of the rows of a frame, in samples; `channels` how many a pixel has.
template <class T, class ToSamples>
void render(const Scene &scene, const float *taus, int frames, int threads, T *out,
            std::size_t channels, std::size_t row, ToSamples Kernels::*convert) {
    const RenderCall call(scene.gop, scene.size, scene.coded, scene.mean, true);
    const ToSamples to_samples = call.kernels.*convert;
    const std::size_t samples = channels * call.size.width * call.size.height;
    const BorrowedWorkspace common;
    FrameRenderer::reserve(call, threads, *common);
    StaticPyramid static_pyramid{};
    if (frames > 1)
        static_pyramid = FrameRenderer(call, taus[0], threads, *common).draw_static_pyramid();
    const auto render_one = [&](int index, int threads_of_frame, Workspace &space) {
        const FrameRenderer renderer(call, taus[index], threads_of_frame, space, static_pyramid);
        renderer.render([&](int, RowRange rows, const Pixels &pixels) {
            to_samples(pixels, renderer.frame(), rows, out + index * samples + rows.begin * row);
        });
    };
    // With enough frames, each thread renders whole frames; else the threads share each frame.
    if (threads > 1 && frames >= threads) {
        std::vector<BorrowedWorkspace> spaces(threads);
        for (const BorrowedWorkspace &space : spaces) FrameRenderer::reserve(call, 1, *space);
        parallel_for(frames, threads,
                     [&](int index, int worker) { render_one(index, 1, *spaces[worker]); });
    } else {
        for (int index = 0; index < frames; ++index) render_one(index, threads, *common);
    }
}

}  // namespace

void render_rgb8(const Scene &scene, const float *taus, int frames, int threads,
                 std::uint8_t *out) {
    const std::size_t row = std::size_t{3} * scene.size.width;
    render(scene, taus, frames, threads, out, 3, row, &Kernels::to_rgb8);
}

void render_planes8(const Scene &scene, const float *taus, int frames, int threads,
                    std::uint8_t *out) {
    render(scene, taus, frames, threads, out, 3, scene.size.width, &Kernels::to_planes8);
}

void render_float(const Scene &scene, const float *taus, int frames, int threads, float *out) {
    const std::size_t row = std::size_t{3} * scene.size.width;
    render(scene, taus, frames, threads, out, 3, row, &Kernels::to_float);
}

void render_sums(const Scene &scene, const float *taus, int frames, int threads, float *out) {
    const std::size_t row = std::size_t{kSums} * scene.size.width;
    render(scene, taus, frames, threads, out, kSums, row, &Kernels::to_sums);
}

void backward_float(const Scene &scene, float tau, int threads, const float *weights,
                    const float *backdrop, const GopArrays &gradient) {
    const RenderCall call(scene.gop, scene.size, scene.coded, scene.mean, false);
    const BorrowedWorkspace space;
    FrameRenderer::reserve(call, threads, *space);
    const FrameRenderer renderer(call, tau, threads, *space);
    // The gradient of a sum does not depend on the picture.
    renderer.backward(call.mean, gradient, [&](int, RowRange rows, const Pixels &pixels) {
        const std::size_t first = static_cast<std::size_t>(rows.begin) * call.size.width;
        const float *behind = call.mean && backdrop ? backdrop + kSums * first : nullptr;
        call.kernels.from_float(weights + 3 * first, behind, renderer.frame(), rows, pixels);
    });
}

double squared_error(const Scene &scene, float tau, int threads, const std::uint8_t *target,
                     const float *backdrop, const GopArrays &gradient) {
    const RenderCall call(scene.gop, scene.size, scene.coded, scene.mean, false);
    const BorrowedWorkspace space;
    FrameRenderer::reserve(call, threads, *space);
    const FrameRenderer renderer(call, tau, threads, *space);
    double *sums = space->sums.reserve(call.levels[0].bands());
    const double samples = 3.0 * call.size.width * call.size.height;
    renderer.backward(true, gradient, [&](int index, RowRange rows, const Pixels &pixels) {
        const std::size_t first = static_cast<std::size_t>(rows.begin) * call.size.width;
        sums[index] = call.kernels.residual(pixels, renderer.frame(), rows, target + 3 * first,
                                            backdrop ? backdrop + kSums * first : nullptr,
                                            static_cast<float>(2.0 / samples));
    });
    double total = 0.0;
    for (int band = 0; band < call.levels[0].bands(); ++band) total += sums[band];
    return total / samples;
}

void adam_step(const Adam &adam, int threads) {
    constexpr std::int64_t kChunk = 1 << 15;
    const Kernels &k = kernels();
    const double scale = 1.0 / (1.0 - std::pow(adam.beta1, static_cast<double>(adam.step)));
    const double correction = 1.0 / (1.0 - std::pow(adam.beta2, static_cast<double>(adam.step)));
    // The rates, repeated until the pattern fills whole vectors.
    const std::int64_t pattern = static_cast<std::int64_t>(adam.period) * k.lanes;
    const BorrowedWorkspace space;
    float *rates = space->lines.reserve(pattern);
    for (std::int64_t i = 0; i < pattern; ++i)
        rates[i] = static_cast<float>(adam.rate[i % adam.period] * scale);
    // A chunk is a whole number of patterns.
    const std::int64_t chunk = std::max<std::int64_t>(kChunk / pattern, 1) * pattern;
    parallel_for(static_cast<int>((adam.n + chunk - 1) / chunk), threads, [&](int job, int) {
        const std::int64_t begin = job * chunk;
        k.adam(adam.value + begin, adam.gradient + begin, adam.mean + begin, adam.square + begin,
               std::min(chunk, adam.n - begin), rates, adam.period, static_cast<float>(adam.beta1),
               static_cast<float>(adam.beta2), static_cast<float>(correction),
               static_cast<float>(adam.epsilon));
    });
}

}  // namespace gsvr
