#include "core.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "frame_renderer.hpp"

namespace gsvr {
namespace {

// `channels`: samples of a pixel.
template <class T, class ToSamples>
void render(const Scene &scene, const float *taus, int frames, int threads, T *out,
            std::size_t channels, ToSamples Kernels::*convert) {
    const RenderCall call(scene.gop, scene.size, scene.coded, scene.mean, true);
    const ToSamples to_samples = call.kernels.*convert;
    const std::size_t samples = channels * call.size.width * call.size.height;
    const BorrowedWorkspace common;
    FrameRenderer::reserve(call, threads, *common);
    StaticPyramid static_pyramid{};
    if (frames > 1 && call.separate_static)
        static_pyramid = FrameRenderer(call, taus[0], threads, *common).draw_static_pyramid();
    const auto render_one = [&](int index, int threads_of_frame, Workspace &space) {
        const FrameRenderer renderer(call, taus[index], threads_of_frame, space, static_pyramid);
        renderer.render([&](Tile tile, const Pixels &pixels) {
            to_samples(pixels, renderer.frame(), tile, out + index * samples);
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
    render(scene, taus, frames, threads, out, 3, &Kernels::to_rgb8);
}

void render_planes8(const Scene &scene, const float *taus, int frames, int threads,
                    std::uint8_t *out) {
    render(scene, taus, frames, threads, out, 3, &Kernels::to_planes8);
}

void render_float(const Scene &scene, const float *taus, int frames, int threads, float *out) {
    render(scene, taus, frames, threads, out, 3, &Kernels::to_float);
}

void render_sums(const Scene &scene, const float *taus, int frames, int threads, float *out) {
    render(scene, taus, frames, threads, out, kSums, &Kernels::to_sums);
}

void pixel_errors(const float *sums, const std::uint8_t *target, std::size_t pixels, float *out) {
    for (std::size_t i = 0; i < pixels; ++i, sums += kSums, target += 3) {
        const float factor = 255.0f / (sums[3] + kGround);
        float total = 0.0f;
        for (int c = 0; c < 3; ++c) {
            const float code = std::min(std::max(sums[c] * factor, 0.0f), 255.0f);
            const float apart = code - static_cast<float>(target[c]);
            total += apart * apart;
        }
        out[i] = total;
    }
}

Backdrop::Backdrop(const float *sums, Size size) : size_(size), lanes_(kernels().lanes) {
    const GopArrays none{};
    const RenderCall call(none, size, size, true, false);
    const std::size_t floats = call.levels[0].floats();
    float *picture = picture_.reserve(floats);
    std::fill_n(picture, floats, 0.0f);
    const int rows = std::max(lanes_ / kStripWidth, 1);  // of a vector
    const std::size_t strip =
        static_cast<std::size_t>(call.levels[0].bands()) * call.levels[0].band_rows * kRowFloats;
    for (int y = 0; y < size.height; ++y)
        for (int x = 0; x < size.width; ++x, sums += kSums) {
            float *p = picture + x / kStripWidth * strip + y / rows * rows * kRowFloats +
                       y % rows * kStripWidth + x % kStripWidth;
            for (int c = 0; c < kSums; ++c) p[c * rows * kStripWidth] = sums[c];
        }
}

namespace {

// What a frame is drawn over: a picture that is as that of static splats.
StaticPyramid drawn(const Backdrop *backdrop, const GopArrays &gop) {
    if (!backdrop) return {};
    return {backdrop->picture(), 1, blocks(gop), 0};
}

}  // namespace

void backward_float(const Scene &scene, float tau, int threads, const float *weights,
                    const Backdrop *backdrop, const GopArrays &gradient) {
    const RenderCall call(scene.gop, scene.size, scene.coded, scene.mean, false);
    const BorrowedWorkspace space;
    FrameRenderer::reserve(call, threads, *space);
    const FrameRenderer renderer(call, tau, threads, *space, drawn(backdrop, scene.gop));
    // The gradient of a sum does not depend on the picture.
    const auto all = [](Tile) { return true; };
    renderer.backward(call.mean, gradient, all, [&](int, Tile tile, const Pixels &pixels) {
        call.kernels.from_float(weights, renderer.frame(), tile, pixels);
    });
}

double squared_error(const Scene &scene, float tau, int threads, const std::uint8_t *target,
                     const Backdrop *backdrop, const float *weights, const GopArrays &gradient) {
    const RenderCall call(scene.gop, scene.size, scene.coded, scene.mean, false);
    const BorrowedWorkspace space;
    FrameRenderer::reserve(call, threads, *space);
    const FrameRenderer renderer(call, tau, threads, *space, drawn(backdrop, scene.gop));
    const int columns = (call.size.width + kTileColumns - 1) / kTileColumns;
    const auto weight = [&](Tile tile) {
        const int row = tile.rows.begin / kTileRows, column = tile.columns.begin / kTileColumns;
        return weights ? weights[row * columns + column] : 1.0f;
    };
    const auto looks = [&](Tile tile) { return weight(tile) != 0.0f; };
    double *sums = space->sums.reserve(call.levels[0].bands());
    const double samples = 3.0 * call.size.width * call.size.height;
    std::fill_n(sums, call.levels[0].bands(), 0.0);
    renderer.backward(true, gradient, looks, [&](int band, Tile tile, const Pixels &pixels) {
        const double factor = weight(tile);
        sums[band] += factor * call.kernels.residual(pixels, renderer.frame(), tile, target,
                                                     static_cast<float>(2.0 * factor / samples));
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
