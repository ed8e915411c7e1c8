// The Python module _core.
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "../arrays.hpp"
#include "core.hpp"
#include "effects.hpp"
#include "isa.hpp"
#include "pool.hpp"
#include "reconstruction.hpp"

namespace {

template <class T>
using Image = nb::ndarray<T, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
template <class T>
using Images = nb::ndarray<T, nb::shape<-1, -1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Times = nb::ndarray<const float, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

template <class T>
using Pictures = nb::ndarray<T, nb::shape<-1, -1, -1, 4>, nb::c_contig, nb::device::cpu>;

using Render = void (*)(const gsvr::Scene &, const float *, int, int, const gsvr::Backdrop *,
                        float *);
using RenderCodes = void (*)(const gsvr::Scene &, const float *, int, int, const gsvr::Backdrop *,
                             std::uint8_t *);

// Checks that a backdrop fits the picture; null = none.
void check(const gsvr::Backdrop *backdrop, gsvr::Size size) {
    if (!backdrop) return;
    require(backdrop->size().height == size.height && backdrop->size().width == size.width,
            "the backdrop must have the size of the picture");
    require(backdrop->lanes() == gsvr::kernels().lanes,
            "the backdrop was made for another instruction set");
}

// Renders to `out`, whose axes of rows and columns are given.
template <class Out, class Function>
void render(Function function, const Parameters &parameters, Times taus, Out out, int rows,
            int columns, std::int64_t coded_width, std::int64_t coded_height, bool mean,
            int threads, const gsvr::Backdrop *backdrop) {
    require(out.shape(0) == taus.shape(0), "out must hold one frame for each tau");
    require(out.shape(0) < (1u << 30), "too many frames");
    const gsvr::Scene scene{parameters.arrays, checked(out.shape(columns), out.shape(rows)),
                            checked(coded_width, coded_height), mean};
    check(backdrop, scene.size);
    threads = gsvr::resolve_threads(threads);
    nb::gil_scoped_release release;
    function(scene, taus.data(), static_cast<int>(taus.shape(0)), threads, backdrop, out.data());
}

void render_rgb8(const Parameters &parameters, Times taus, Images<std::uint8_t> out,
                 int coded_width, int coded_height, bool mean, int threads,
                 const gsvr::Backdrop *backdrop) {
    render<Images<std::uint8_t>, RenderCodes>(gsvr::render_rgb8, parameters, taus, out, 1, 2,
                                              coded_width, coded_height, mean, threads, backdrop);
}

using Planes = nb::ndarray<std::uint8_t, nb::shape<-1, 3, -1, -1>, nb::c_contig, nb::device::cpu>;

void render_planes8(const Parameters &parameters, Times taus, Planes out, int coded_width,
                    int coded_height, bool mean, int threads, const gsvr::Backdrop *backdrop) {
    render<Planes, RenderCodes>(gsvr::render_planes8, parameters, taus, out, 2, 3, coded_width,
                                coded_height, mean, threads, backdrop);
}

void render_float(const Parameters &parameters, Times taus, Images<float> out, int coded_width,
                  int coded_height, bool mean, int threads, const gsvr::Backdrop *backdrop) {
    render<Images<float>, Render>(gsvr::render_float, parameters, taus, out, 1, 2, coded_width,
                                  coded_height, mean, threads, backdrop);
}

void render_sums(const Parameters &parameters, Times taus, Pictures<float> out, int coded_width,
                 int coded_height, bool mean, int threads, const gsvr::Backdrop *backdrop) {
    render<Pictures<float>, Render>(gsvr::render_sums, parameters, taus, out, 1, 2, coded_width,
                                    coded_height, mean, threads, backdrop);
}

using Sums = nb::ndarray<const float, nb::shape<-1, -1, 4>, nb::c_contig, nb::device::cpu>;
using Plane = nb::ndarray<float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;

void pixel_errors(Sums sums, Image<const std::uint8_t> target, Plane out) {
    const auto same = [&](const auto &array) {
        return array.shape(0) == sums.shape(0) && array.shape(1) == sums.shape(1);
    };
    require(same(target) && same(out), "sums, target and out must be of one size");
    nb::gil_scoped_release release;
    gsvr::pixel_errors(sums.data(), target.data(), out.size(), out.data());
}

void add_effects(const Look &look, Sums sums, int coded_width, int coded_height,
                 nb::ndarray<double, nb::shape<-1>, nb::c_contig, nb::device::cpu> out,
                 int threads) {
    const std::size_t n = out.shape(0);
    require(n < (1u << 28), "too many Gaussians");
    const gsvr::LookArrays arrays = look.arrays(n);
    const gsvr::Size size = checked(sums.shape(1), sums.shape(0));
    const gsvr::Size coded = checked(coded_width, coded_height);
    threads = gsvr::resolve_threads(threads);
    nb::gil_scoped_release release;
    gsvr::add_effects(arrays, static_cast<int>(n), sums.data(), size, coded, threads, out.data());
}

using PlateCodes =
    nb::ndarray<const std::uint8_t, nb::shape<3, -1, -1>, nb::c_contig, nb::device::cpu>;

void init_backdrop(gsvr::Backdrop *self, Sums sums) {
    const gsvr::Size size = checked(sums.shape(1), sums.shape(0));
    nb::gil_scoped_release release;
    new (self) gsvr::Backdrop(sums.data(), size);
}

void init_plate(gsvr::Backdrop *self, PlateCodes ycc) {
    const gsvr::Size size = checked(ycc.shape(2), ycc.shape(1));
    nb::gil_scoped_release release;
    new (self) gsvr::Backdrop(ycc.data(), size);
}

void backward_float(const Parameters &parameters, float tau, Image<const float> weights,
                    int coded_width, int coded_height, bool mean, const Parameters &gradient,
                    int threads, const gsvr::Backdrop *backdrop) {
    require(gradient.same_shape(parameters), "gradient must have the shapes of the parameters");
    const gsvr::Scene scene{parameters.arrays, checked(weights.shape(1), weights.shape(0)),
                            checked(coded_width, coded_height), mean};
    check(backdrop, scene.size);
    threads = gsvr::resolve_threads(threads);
    nb::gil_scoped_release release;
    gsvr::backward_float(scene, tau, threads, weights.data(), backdrop, gradient.arrays);
}

using TileWeights = nb::ndarray<const float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;

double squared_error(const Parameters &parameters, float tau, Image<const std::uint8_t> target,
                     int coded_width, int coded_height, bool mean, const Parameters &gradient,
                     int threads, const gsvr::Backdrop *backdrop,
                     std::optional<TileWeights> weights) {
    require(gradient.same_shape(parameters), "gradient must have the shapes of the parameters");
    const gsvr::Scene scene{parameters.arrays, checked(target.shape(1), target.shape(0)),
                            checked(coded_width, coded_height), mean};
    check(backdrop, scene.size);
    if (weights) {
        const auto tiles = [](int pixels, int tile) {
            return std::size_t((pixels + tile - 1) / tile);
        };
        require(weights->shape(0) == tiles(scene.size.height, gsvr::kTileRows) &&
                    weights->shape(1) == tiles(scene.size.width, gsvr::kTileColumns),
                "weights must have an entry for each tile of the picture");
    }
    threads = gsvr::resolve_threads(threads);
    nb::gil_scoped_release release;
    return gsvr::squared_error(scene, tau, threads, target.data(), backdrop,
                               weights ? weights->data() : nullptr, gradient.arrays);
}

// Checks the arrays that Adam remembers of one attribute, and keeps them alive.
struct AdamPart {
    Floats value, mean, square, rates;
    std::optional<Floats> pace, axes;
    gsvr::AdamPart part{};

    AdamPart(Floats value_, Floats mean_, Floats square_, Floats rates_,
             std::optional<Floats> pace_, std::optional<Floats> axes_)
        : value(value_), mean(mean_), square(square_), rates(rates_), pace(pace_), axes(axes_) {
        const std::size_t n = value.size(), period = rates.size();
        require(mean.size() == n && square.size() == n && (!pace || pace->size() == n),
                "value, mean, square and pace must be of one size");
        require(period >= 1 && period <= 4096 && n % period == 0,
                "rates must have one entry, or one a column");
        require(!axes || (n % 2 == 0 && axes->size() == 2 * n),
                "axes must have a matrix for each pair of the value");
        part = {value.data(),
                mean.data(),
                square.data(),
                static_cast<std::int64_t>(n),
                rates.data(),
                static_cast<int>(period),
                pace ? pace->data() : nullptr,
                axes ? axes->data() : nullptr};
    }
};

void adam_step(const std::vector<const AdamPart *> &parts, const std::vector<Floats> &gradients,
               double factor, double beta1, double beta2, double epsilon, double agreeing,
               double opposing, std::int64_t step, int threads) {
    require(parts.size() == gradients.size(), "each part must have a gradient");
    require(step >= 1, "step counts from 1");
    std::vector<gsvr::AdamPart> values;
    std::vector<const float *> slopes;
    for (std::size_t i = 0; i < parts.size(); ++i) {
        require(gradients[i].size() == parts[i]->value.size(),
                "a gradient must have the size of its value");
        values.push_back(parts[i]->part);
        slopes.push_back(gradients[i].data());
    }
    threads = gsvr::resolve_threads(threads);
    nb::gil_scoped_release release;
    gsvr::adam_step(values.data(), slopes.data(), static_cast<int>(values.size()),
                    {factor, beta1, beta2, epsilon, agreeing, opposing, step}, threads);
}

using Table = nb::ndarray<float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;

void price_slopes(Table value, Floats step, std::optional<Floats> carried, int near, float change,
                  float fresh, Table out, int threads) {
    const std::size_t n = value.shape(0), columns = value.shape(1);
    require(out.shape(0) == n && out.shape(1) == columns, "out must have the shape of value");
    require(columns >= 1 && columns <= 64, "value must have 1 to 64 columns");
    require(step.size() == columns, "step must have an entry a column");
    require(!carried || carried->size() == n, "carried must have an entry a row");
    require(near >= 0 && near <= 4096, "near must be 0 to 4096");
    const gsvr::Priced priced{value.data(),
                              step.data(),
                              carried ? carried->data() : nullptr,
                              static_cast<std::int64_t>(n),
                              static_cast<int>(columns),
                              near,
                              change,
                              fresh};
    threads = gsvr::resolve_threads(threads);
    nb::gil_scoped_release release;
    gsvr::price_slopes(priced, out.data(), threads);
}

// By the names of gsvrcodec/model/reconstruction.py.
std::map<std::string, double> constants() {
    return {{"MIN_SCALE", gsvr::kMinScale},
            {"DILATION", gsvr::kDilation},
            {"CUTOFF", gsvr::kCutoff},
            {"ANTIALIAS", gsvr::kAntialias},
            {"GROUND", gsvr::kGround},
            {"PLATE_WEIGHT", gsvr::kPlateWeight},
            {"MOST_LOG_OPACITY", gsvr::kMostLogOpacity},
            {"LEVELS", gsvr::kLevels},
            {"LEVEL_SCALE", gsvr::kLevelScale},
            {"UPSAMPLING", gsvr::kUpsampling},
            {"MIN_VARIANCE", gsvr::kMinVariance}};
}

}  // namespace

NB_MODULE(_core, m) {
    m.doc() = "Native kernels: values of a GOP, rasterisation and its gradients (spec/gsvr.md).";
    m.def("isa", [] { return std::string(gsvr::kernels().isa); });
    m.def("isas", &gsvr::usable_isas);
    m.def("use_isa", &gsvr::use_isa, "name"_a);
    m.def("constants", &constants);
    m.def("resolve_threads", &gsvr::resolve_threads, "requested"_a);
    nb::class_<Parameters>(m, "Parameters")
        .def(nb::init<Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats,
                      Floats, Floats>(),
             exact("position"), exact("log_scale"), exact("rotation"), exact("colour"),
             exact("log_opacity"), exact("indicator"), exact("linear"), exact("quadratic"),
             exact("xy"), exact("xt"), exact("yt"));
    nb::class_<gsvr::Backdrop>(m, "Backdrop")
        .def("__init__", &init_backdrop, "sums"_a)
        .def("__init__", &init_plate, "ycc"_a);
    m.def("render_rgb8", &render_rgb8, "parameters"_a, "taus"_a, exact("out"), "coded_width"_a,
          "coded_height"_a, "mean"_a, "threads"_a, "backdrop"_a.none() = nb::none());
    m.def("render_planes8", &render_planes8, "parameters"_a, "taus"_a, exact("out"),
          "coded_width"_a, "coded_height"_a, "mean"_a, "threads"_a,
          "backdrop"_a.none() = nb::none());
    m.def("render_float", &render_float, "parameters"_a, "taus"_a, exact("out"), "coded_width"_a,
          "coded_height"_a, "mean"_a, "threads"_a, "backdrop"_a.none() = nb::none());
    m.def("render_sums", &render_sums, "parameters"_a, "taus"_a, exact("out"), "coded_width"_a,
          "coded_height"_a, "mean"_a, "threads"_a, "backdrop"_a.none() = nb::none());
    m.def("backward_float", &backward_float, "parameters"_a, "tau"_a, "weights"_a, "coded_width"_a,
          "coded_height"_a, "mean"_a, "gradient"_a, "threads"_a, "backdrop"_a.none() = nb::none());
    m.def("pixel_errors", &pixel_errors, "sums"_a, "target"_a, "out"_a);
    m.def("add_effects", &add_effects, "look"_a, "sums"_a, "coded_width"_a, "coded_height"_a,
          exact("out"), "threads"_a = 0);
    m.def("squared_error", &squared_error, "parameters"_a, "tau"_a, "target"_a, "coded_width"_a,
          "coded_height"_a, "mean"_a, "gradient"_a, "threads"_a, "backdrop"_a.none() = nb::none(),
          "weights"_a.none() = nb::none());
    nb::class_<AdamPart>(m, "AdamPart")
        .def(nb::init<Floats, Floats, Floats, Floats, std::optional<Floats>,
                      std::optional<Floats>>(),
             exact("value"), exact("mean"), exact("square"), exact("rates"),
             exact("pace").none() = nb::none(), exact("axes").none() = nb::none());
    m.def("adam_step", &adam_step, "parts"_a, "gradients"_a, "factor"_a, "beta1"_a, "beta2"_a,
          "epsilon"_a, "agreeing"_a, "opposing"_a, "step"_a, "threads"_a = 0);
    m.def("price_slopes", &price_slopes, exact("value"), exact("step"), exact("carried").none(),
          "near"_a, "change"_a, "fresh"_a, exact("out"), "threads"_a = 0);
    bind_model(m);
}
