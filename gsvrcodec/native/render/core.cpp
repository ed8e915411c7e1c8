#include "core.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <vector>

#include "frame_renderer.hpp"

namespace gsvr {
namespace {

// How the samples of a picture lie in memory: in planes, of which each has so many for a pixel.
struct Layout {
    int planes, channels;
};

template <class T>
void copy_tile(const T *from, T *to, Size size, Layout layout, Tile tile) {
    const std::size_t count = layout.channels * (tile.columns.end - tile.columns.begin);
    for (int plane = 0; plane < layout.planes; ++plane)
        for (int y = tile.rows.begin; y < tile.rows.end; ++y) {
            const std::size_t row = static_cast<std::size_t>(plane) * size.height + y;
            const std::size_t at = layout.channels * (row * size.width + tile.columns.begin);
            std::copy_n(from + at, count, to + at);
        }
}

template <class T, class ToSamples>
void render(const Scene &scene, const float *taus, int frames, int threads,
            const Backdrop *backdrop, T *out, Layout layout, ToSamples Kernels::*convert) {
    const RenderCall call(scene.gop, scene.size, scene.coded, scene.mean, true);
    const ToSamples to_samples = call.kernels.*convert;
    const std::size_t samples = static_cast<std::size_t>(layout.planes) * layout.channels *
                                call.size.width * call.size.height;
    const BorrowedWorkspace common;
    FrameRenderer::reserve(call, threads, *common);
    StaticPyramid static_pyramid = StaticPyramid::in_front_of(backdrop);
    // A cell without dynamic splats is the same in all frames: the first that needs it draws it,
    // and others copy it. By cell of level 0, the number of a frame that has it, from 1; 0 = none.
    const bool copies = frames > 1 && call.separate_static;
    if (copies)
        static_pyramid =
            FrameRenderer(call, taus[0], threads, *common, static_pyramid).draw_static_pyramid();
    std::vector<std::atomic<int>> drawn_in(copies ? Cells::count(call, 1) : 0);
    const auto reserve_cells = [&](Workspace &space) {
        if (!copies) return;
        const std::size_t marks = 2 * Cells::count(call, kLevels);
        std::fill_n(space.cells.reserve(marks), marks, std::uint8_t{0});
    };
    reserve_cells(*common);
    const auto render_one = [&](int index, int threads_of_frame, Workspace &space) {
        const FrameRenderer renderer(call, taus[index], threads_of_frame, space, static_pyramid);
        const Cells cells(call, space.cells.get());
        if (copies) renderer.find_dynamic(cells);
        T *own = out + index * samples;
        const auto copied_from = [&](int cell) {
            return cells.dynamic(cell) ? 0 : drawn_in[cell].load(std::memory_order_acquire);
        };
        const auto copy = [&](Tile tile, int from) {
            copy_tile(out + (from - 1) * samples, own, call.size, layout, tile);
        };
        const auto done = [&](Tile tile, const Pixels &pixels) {
            to_samples(pixels, renderer.frame(), tile, own);
            for (int x = tile.columns.begin; copies && x < tile.columns.end; x += kCellColumns) {
                const int cell = cells.at(0, tile.rows.begin, x);
                if (!cells.dynamic(cell))
                    drawn_in[cell].store(index + 1, std::memory_order_release);
            }
        };
        // Frames that are drawn at the same time begin far from each other, and so find more drawn.
        const int first_band = index % threads * call.levels[0].bands() / threads;
        renderer.render(first_band, copies ? &cells : nullptr, copied_from, copy, done);
    };
    // With enough frames, each thread renders whole frames; else the threads share each frame.
    if (threads > 1 && frames >= threads) {
        std::vector<BorrowedWorkspace> spaces(threads);
        for (const BorrowedWorkspace &space : spaces) {
            FrameRenderer::reserve(call, 1, *space);
            reserve_cells(*space);
        }
        parallel_for(frames, threads,
                     [&](int index, int worker) { render_one(index, 1, *spaces[worker]); });
    } else {
        for (int index = 0; index < frames; ++index) render_one(index, threads, *common);
    }
}

}  // namespace

void render_rgb8(const Scene &scene, const float *taus, int frames, int threads,
                 const Backdrop *backdrop, std::uint8_t *out) {
    render(scene, taus, frames, threads, backdrop, out, {1, 3}, &Kernels::to_rgb8);
}

void render_planes8(const Scene &scene, const float *taus, int frames, int threads,
                    const Backdrop *backdrop, std::uint8_t *out) {
    render(scene, taus, frames, threads, backdrop, out, {3, 1}, &Kernels::to_planes8);
}

void render_float(const Scene &scene, const float *taus, int frames, int threads,
                  const Backdrop *backdrop, float *out) {
    render(scene, taus, frames, threads, backdrop, out, {1, 3}, &Kernels::to_float);
}

void render_sums(const Scene &scene, const float *taus, int frames, int threads,
                 const Backdrop *backdrop, float *out) {
    render(scene, taus, frames, threads, backdrop, out, {1, kSums}, &Kernels::to_sums);
}

void pixel_errors(const float *sums, const std::uint8_t *target, std::size_t pixels, float *out) {
    for (std::size_t i = 0; i < pixels; ++i, sums += kSums, target += 3) {
        // One vector for a pixel: without branches, which a processor would foresee badly.
        typedef float Pixel __attribute__((vector_size(16)));
        typedef int Codes __attribute__((vector_size(16)));
        const Pixel own = {sums[0], sums[1], sums[2], 0.0f}, black{}, white = black + 255.0f;
        Pixel code = own * (255.0f / (sums[3] + kGround));
        code = code > black ? code : black;
        code = code < white ? code : white;
        const Codes wanted = {target[0], target[1], target[2], 0};
        const Pixel apart = code - __builtin_convertvector(wanted, Pixel);
        const Pixel squares = apart * apart;
        out[i] = squares[0] + squares[1] + squares[2];
    }
}

Backdrop::Backdrop(const float *sums, Size size) : size_(size), lanes_(kernels().lanes) {
    const GopArrays none{};
    const RenderCall call(none, size, size, true, false);
    const PyramidLevel &own = call.levels[0];
    float *picture = sums_.reserve(own.floats());
    pixels_ = {picture, 0, own.bands() * own.band_rows, Pixels::kAllStrips};
    std::fill_n(picture, own.floats(), 0.0f);
    const int rows = std::max(lanes_ / kStripWidth, 1);  // of a vector
    for (int y = 0; y < size.height; ++y)
        for (int x = 0; x < size.width; ++x, sums += kSums) {
            float *p = picture + pixels_.strip_offset(x / kStripWidth) +
                       y / rows * rows * kRowFloats + y % rows * kStripWidth + x % kStripWidth;
            for (int c = 0; c < kSums; ++c) p[c * rows * kStripWidth] = sums[c];
        }
}

Backdrop::Backdrop(const std::uint8_t *ycc, Size size) : size_(size), lanes_(kernels().lanes) {
    const auto whole = [](int n, int of) {
        return static_cast<std::ptrdiff_t>((n + of - 1) / of * of);
    };
    const std::ptrdiff_t line = whole(size.width, kStripWidth), rows = whole(size.height, 2);
    plate_ = {codes_.reserve(3 * rows * line), line, rows * line};
    std::fill_n(codes_.get(), 3 * rows * line, std::uint8_t{0});
    for (int plane = 0; plane < 3; ++plane)
        for (int y = 0; y < size.height; ++y, ycc += size.width)
            std::copy_n(ycc, size.width, codes_.get() + plane * plate_.plane + y * line);
}

void backward_float(const Scene &scene, float tau, int threads, const float *weights,
                    const Backdrop *backdrop, const GopArrays &gradient) {
    const RenderCall call(scene.gop, scene.size, scene.coded, scene.mean, false);
    const BorrowedWorkspace space;
    FrameRenderer::reserve(call, threads, *space);
    const FrameRenderer renderer(call, tau, threads, *space, StaticPyramid::in_front_of(backdrop));
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
    const FrameRenderer renderer(call, tau, threads, *space, StaticPyramid::in_front_of(backdrop));
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

namespace {

// Takes a step of the parameters [begin, end) of a part.
void adam_step(const AdamPart &part, const float *gradient, const Adam &adam, std::int64_t begin,
               std::int64_t end) {
    const Kernels &k = kernels();
    const double scale = adam.factor / (1.0 - std::pow(adam.beta1, static_cast<double>(adam.step)));
    const double correction = 1.0 / (1.0 - std::pow(adam.beta2, static_cast<double>(adam.step)));
    // The rates, repeated until the pattern fills whole vectors.
    const std::int64_t pattern = static_cast<std::int64_t>(part.period) * k.lanes, n = end - begin;
    const BorrowedWorkspace space;
    float *rates = space->lines.reserve(pattern);
    for (std::int64_t i = 0; i < pattern; ++i)
        rates[i] = static_cast<float>(part.rate[i % part.period] * scale);
    const AdamRule rule = {static_cast<float>(adam.beta1), static_cast<float>(adam.beta2),
                           static_cast<float>(adam.epsilon), static_cast<float>(adam.agreeing),
                           static_cast<float>(adam.opposing)};
    const auto move = [&](float *value, const float *slope) {
        k.adam(value, slope, part.mean + begin, part.square + begin,
               part.pace ? part.pace + begin : nullptr, n, rates, part.period, rule,
               static_cast<float>(correction));
    };
    if (!part.axes) return move(part.value + begin, gradient + begin);
    float *slopes = space->pixels.reserve(2 * n), *steps = slopes + n;
    const float *axes = part.axes + 2 * begin;
    gradient += begin;
    for (std::int64_t i = 0; i < n; i += 2) {
        const float *a = axes + 2 * i;
        slopes[i] = a[0] * gradient[i] + a[2] * gradient[i + 1];
        slopes[i + 1] = a[1] * gradient[i] + a[3] * gradient[i + 1];
    }
    std::fill_n(steps, n, 0.0f);
    move(steps, slopes);
    float *value = part.value + begin;
    for (std::int64_t i = 0; i < n; i += 2) {
        const float *a = axes + 2 * i;
        value[i] += a[0] * steps[i] + a[1] * steps[i + 1];
        value[i + 1] += a[2] * steps[i] + a[3] * steps[i + 1];
    }
}

}  // namespace

void adam_step(const AdamPart *parts, const float *const *gradients, int count, const Adam &adam,
               int threads) {
    constexpr std::int64_t kChunk = 1 << 15;
    // A chunk is a whole number of patterns of rates, and of pairs.
    const auto chunk = [](const AdamPart &part) {
        const std::int64_t pattern = static_cast<std::int64_t>(part.period) * kernels().lanes;
        return std::max<std::int64_t>(kChunk / pattern, 1) * pattern;
    };
    const auto jobs = [&](const AdamPart &part) {
        return static_cast<int>((part.n + chunk(part) - 1) / chunk(part));
    };
    int total = 0;
    for (int i = 0; i < count; ++i) total += jobs(parts[i]);
    parallel_for(total, threads, [&](int job, int) {
        int i = 0;
        for (; job >= jobs(parts[i]); ++i) job -= jobs(parts[i]);
        const std::int64_t begin = job * chunk(parts[i]);
        adam_step(parts[i], gradients[i], adam, begin,
                  std::min(begin + chunk(parts[i]), parts[i].n));
    });
}

namespace {

constexpr int kPricedRows = 512;  // of a job

// Means of the neighbours of the rows [begin, end), of which `padded` values are written. `rows`
// has room for these, and for `near` rows more.
void usual_values(const Priced &p, std::int64_t begin, std::int64_t end, float *rows, float *usual,
                  std::int64_t padded) {
    const std::int64_t side = p.near / 2;
    const std::int64_t low = std::max<std::int64_t>(begin - side, 0);
    const std::int64_t high = std::min(end + side, p.n);
    std::fill_n(rows, padded + 2 * side * p.columns, 0.0f);
    std::copy(p.value + low * p.columns, p.value + high * p.columns,
              rows + (low - begin + side) * p.columns);
    // Quicker than a sum that goes along, which adds one value at a time.
    kernels().sum_shifted(rows, p.columns, 2 * static_cast<int>(side) + 1, usual, padded);
    for (std::int64_t row = begin; row < end; ++row) {
        const std::int64_t near =
            std::min(row + side + 1, p.n) - std::max<std::int64_t>(row - side, 0);
        for (int c = 0; c < p.columns; ++c) *usual++ /= static_cast<float>(near);
    }
}

}  // namespace

void price_slopes(const Priced &p, float *out, int threads) {
    const Kernels &k = kernels();
    const std::int64_t jobs = (p.n + kPricedRows - 1) / kPricedRows;
    parallel_for(static_cast<int>(jobs), threads, [&](int job, int) {
        const std::int64_t begin = static_cast<std::int64_t>(job) * kPricedRows;
        const std::int64_t end = std::min(begin + kPricedRows, p.n);
        const std::int64_t count = (end - begin) * p.columns;
        // Whole vectors: each value, the usual one, its step, its price as a change and as fresh.
        const std::int64_t padded = (count + k.lanes - 1) / k.lanes * k.lanes;
        const BorrowedWorkspace space;
        const std::int64_t around = padded + p.near * p.columns;
        float *value = space->pixels.reserve(5 * padded + around), *usual = value + padded;
        float *step = usual + padded, *change = step + padded, *fresh = change + padded;
        std::fill_n(value, 5 * padded, 1.0f);
        std::copy_n(p.value + begin * p.columns, count, value);
        std::fill_n(usual, count, 0.0f);
        if (p.near) usual_values(p, begin, end, fresh + padded, usual, padded);
        float *s = step, *c = change, *f = fresh;
        for (std::int64_t row = begin; row < end; ++row) {
            const float carried = p.carried ? p.carried[row] : 0.0f;
            for (int column = 0; column < p.columns; ++column) {
                *s++ = p.step[column];
                *c++ = p.change * carried;
                *f++ = p.fresh * (1.0f - carried);
            }
        }
        k.price(value, usual, step, change, fresh, padded);
        std::copy_n(value, count, out + begin * p.columns);
    });
}

}  // namespace gsvr
