#include "core.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <vector>

#include "pool.hpp"

namespace gsvr {
namespace {

constexpr int kProjectChunk = 2048;
// The backward pass sums plane gradients in this many groups of Gaussians, whatever the number of
// threads, so that results do not depend on it.
constexpr int kGroups = 16;

struct AlignedDelete {
    void operator()(void *p) const { std::free(p); }
};

template <class T>
class Buffer {
   public:
    // Room for n elements on a cache line; contents are kept only when it already was there.
    T *reserve(std::size_t n) {
        if (n > size_) {
            const std::size_t bytes = (n * sizeof(T) + 63) / 64 * 64;
            data_.reset(static_cast<T *>(std::aligned_alloc(64, bytes)));
            if (!data_) throw std::bad_alloc();
            size_ = n;
        }
        return data_.get();
    }
    T *get() const { return data_.get(); }

   private:
    std::unique_ptr<T[], AlignedDelete> data_;
    std::size_t size_ = 0;
};

// Scratch memory of one frame in flight, kept between calls.
struct Workspace {
    Buffer<Splat> splats;
    Buffer<float> lines, pixels, plane_gradients;
    std::vector<Buffer<float>> bands;
    std::vector<Buffer<int>> lists;
};

class Workspaces {
   public:
    std::unique_ptr<Workspace> take() {
        std::lock_guard<std::mutex> lock(mutex_);
        if (idle_.empty()) return std::make_unique<Workspace>();
        auto space = std::move(idle_.back());
        idle_.pop_back();
        return space;
    }
    void give(std::unique_ptr<Workspace> space) {
        std::lock_guard<std::mutex> lock(mutex_);
        idle_.push_back(std::move(space));
    }

   private:
    std::mutex mutex_;
    std::vector<std::unique_ptr<Workspace>> idle_;
};

Workspaces &workspaces() {
    static Workspaces instance;
    return instance;
}

class Borrowed {
   public:
    Borrowed() : space_(workspaces().take()) {}
    ~Borrowed() { workspaces().give(std::move(space_)); }
    Borrowed(const Borrowed &) = delete;
    Borrowed &operator=(const Borrowed &) = delete;
    Workspace &operator*() { return *space_; }

   private:
    std::unique_ptr<Workspace> space_;
};

// One time's slice of a (gt, cells, 8) grid, border clamped.
void time_slice(const float *grid, int gt, int cells, float tau, float *line, int *low, int *high,
                float *weight) {
    const float last = static_cast<float>(gt - 1);
    const float t = std::min(std::max((tau + 1.0f) * 0.5f * last, 0.0f), last);
    *low = static_cast<int>(t);
    *high = std::min(*low + 1, gt - 1);
    *weight = t - static_cast<float>(*low);
    const std::size_t width = static_cast<std::size_t>(cells) * kChannels;
    const float *a = grid + *low * width, *b = grid + *high * width;
    for (std::size_t i = 0; i < width; ++i) line[i] = a[i] + (b[i] - a[i]) * *weight;
}

// A frame of a model made ready: the time slices and the projected splats.
class Scene {
   public:
    Scene(const Model &model, float tau, Size size, Size coded, int threads, Workspace &space)
        : model_(model), space_(space), threads_(threads) {
        frame_ = {tau, size.width, size.height, coded.width, coded.height, nullptr, nullptr};
        if (model.gx > 0) {
            float *lines = space.lines.reserve((model.gx + model.gy) * kChannels);
            time_slice(model.xt, model.gt, model.gx, tau, lines, &low_, &high_, &weight_);
            time_slice(model.yt, model.gt, model.gy, tau, lines + model.gx * kChannels, &low_,
                       &high_, &weight_);
            frame_.xt_line = lines;
            frame_.yt_line = lines + model.gx * kChannels;
        }
        Splat *splats = space.splats.reserve(model.n);
        const int chunks = (model.n + kProjectChunk - 1) / kProjectChunk;
        parallel_for(chunks, threads, [&](int job, int) {
            const int begin = job * kProjectChunk;
            kernels().project(model_, frame_, begin, std::min(begin + kProjectChunk, model_.n), splats);
        });
        space.bands.resize(std::max<std::size_t>(space.bands.size(), threads));
        space.lists.resize(std::max<std::size_t>(space.lists.size(), threads));
    }

    int bands() const { return (frame_.height + kBandRows - 1) / kBandRows; }
    const Frame &frame() const { return frame_; }

    int strips() const { return (frame_.width + kStripWidth - 1) / kStripWidth; }
    std::size_t strip_floats() const { return static_cast<std::size_t>(frame_.height) * kRowFloats; }

    // Rasterises each band into `pixels` (the whole frame's when given, else scratch) and hands it
    // to done(first_row, last_row, pixels_of_first_row, strip_rows).
    template <class Done>
    void for_bands(float *pixels, Done done) {
        const int strip_rows = pixels ? frame_.height : kBandRows;
        const std::size_t strip = static_cast<std::size_t>(strip_rows) * kRowFloats;
        parallel_for(bands(), threads_, [&](int band, int worker) {
            const int begin = band * kBandRows;
            const int end = std::min(begin + kBandRows, frame_.height);
            float *out = pixels ? pixels + static_cast<std::size_t>(begin) * kRowFloats
                                : space_.bands[worker].reserve(strips() * strip);
            for (int s = 0; s < strips(); ++s)
                std::memset(out + s * strip, 0, (end - begin) * kRowFloats * sizeof(float));
            int *list = space_.lists[worker].reserve(model_.n + 1);
            int count = 0;
            const Splat *splats = space_.splats.get();
            for (int i = 0; i < model_.n; ++i) {
                list[count] = i;
                count += splats[i].row_begin < end && splats[i].row_end > begin;
            }
            kernels().rasterise(splats, list, count, frame_, begin, end, out, strip_rows);
            done(begin, end, out, strip_rows);
        });
    }

    // Gradients of all parameters from the gradient of the frame's pixels.
    void backward(const float *pixels, const Model &gradient) {
        const std::size_t xy = static_cast<std::size_t>(model_.gx) * model_.gy * kChannels;
        const std::size_t xt = static_cast<std::size_t>(model_.gx) * kChannels;
        const std::size_t yt = static_cast<std::size_t>(model_.gy) * kChannels;
        const std::size_t group = xy + xt + yt;
        float *sums = space_.plane_gradients.reserve(std::max<std::size_t>(kGroups * group, 1));
        const int size = (model_.n + kGroups - 1) / kGroups;
        parallel_for(kGroups, threads_, [&](int job, int) {
            float *own = sums + job * group;
            std::memset(own, 0, group * sizeof(float));
            const int begin = std::min(job * size, model_.n);
            const int end = std::min(begin + size, model_.n);
            kernels().backward(model_, frame_, space_.splats.get(), pixels, begin, end, gradient, own,
                               own + xy, own + xy + xt);
        });
        if (model_.gx == 0) return;
        for (int job = 1; job < kGroups; ++job)
            for (std::size_t i = 0; i < group; ++i) sums[i] += sums[job * group + i];
        std::memcpy(gradient.xy, sums, xy * sizeof(float));
        spread_line(sums + xy, xt, gradient.xt);
        spread_line(sums + xy + xt, yt, gradient.yt);
    }

   private:
    void spread_line(const float *line, std::size_t width, float *grid) const {
        std::memset(grid, 0, model_.gt * width * sizeof(float));
        for (std::size_t i = 0; i < width; ++i) {
            grid[low_ * width + i] += line[i] * (1.0f - weight_);
            grid[high_ * width + i] += line[i] * weight_;
        }
    }

    const Model &model_;
    Workspace &space_;
    int threads_;
    Frame frame_{};
    int low_ = 0, high_ = 0;
    float weight_ = 0.0f;
};

template <class T, class RowKernel>
void render(const Model &model, const float *taus, int frames, Size size, Size coded, int threads,
            T *out, RowKernel to_samples) {
    const std::size_t row = static_cast<std::size_t>(size.width) * 3;
    const auto render_one = [&](int index, int within) {
        Borrowed space;
        Scene scene(model, taus[index], size, coded, within, *space);
        scene.for_bands(nullptr, [&](int begin, int end, const float *pixels, int strip_rows) {
            for (int y = begin; y < end; ++y)
                to_samples(pixels + (y - begin) * kRowFloats, scene.frame(), strip_rows,
                           out + (static_cast<std::size_t>(index) * size.height + y) * row);
        });
    };
    // Whole frames side by side when there are enough of them, else bands of one frame.
    if (frames >= threads) {
        parallel_for(frames, threads, [&](int index, int) { render_one(index, 1); });
    } else {
        for (int index = 0; index < frames; ++index) render_one(index, threads);
    }
}

const Kernels &choose() {
    std::vector<const Kernels *> usable{&kKernels_portable};
#ifdef GSVR_X86_64
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        usable.push_back(&kKernels_avx2);
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq"))
        usable.push_back(&kKernels_avx512);
#endif
    const char *wanted = std::getenv("GSVR_ISA");
    if (!wanted || !*wanted) return *usable.back();
    std::string names;
    for (const Kernels *k : usable) {
        if (std::string(wanted) == k->isa) return *k;
        names += std::string(names.empty() ? "" : ", ") + k->isa;
    }
    throw std::runtime_error("GSVR_ISA=" + std::string(wanted) + " is not available here: use one of " + names);
}

}  // namespace

const Kernels &kernels() {
    static const Kernels &chosen = choose();
    return chosen;
}

void render_rgb8(const Model &model, const float *taus, int frames, Size size, Size coded,
                 int threads, std::uint8_t *out) {
    render(model, taus, frames, size, coded, threads, out, kernels().row_to_rgb8);
}

void render_float(const Model &model, const float *taus, int frames, Size size, Size coded,
                  int threads, float *out) {
    render(model, taus, frames, size, coded, threads, out, kernels().row_to_float);
}

void backward_float(const Model &model, float tau, Size size, Size coded, int threads,
                    const float *weights, const Model &gradient) {
    Borrowed space;
    Scene scene(model, tau, size, coded, threads, *space);
    float *pixels = (*space).pixels.reserve(scene.strips() * scene.strip_floats());
    parallel_for(size.height, threads, [&](int y, int) {
        kernels().row_from_float(weights + static_cast<std::size_t>(y) * size.width * 3, scene.frame(),
                                 size.height, pixels + static_cast<std::size_t>(y) * kRowFloats);
    });
    scene.backward(pixels, gradient);
}

double squared_error(const Model &model, float tau, Size size, Size coded, int threads,
                     const std::uint8_t *target, const Model &gradient) {
    Borrowed space;
    Scene scene(model, tau, size, coded, threads, *space);
    float *frame_pixels = (*space).pixels.reserve(scene.strips() * scene.strip_floats());
    const double samples = 3.0 * size.width * size.height;
    const float scale = static_cast<float>(2.0 / samples);
    std::vector<double> sums(scene.bands());
    scene.for_bands(frame_pixels, [&](int begin, int end, float *pixels, int strip_rows) {
        double total = 0.0;
        for (int y = begin; y < end; ++y)
            total += kernels().row_residual(pixels + (y - begin) * kRowFloats, scene.frame(), strip_rows,
                                            target + static_cast<std::size_t>(y) * size.width * 3, scale);
        sums[begin / kBandRows] = total;
    });
    scene.backward(frame_pixels, gradient);
    double total = 0.0;
    for (double s : sums) total += s;
    return total / samples;
}

}  // namespace gsvr
