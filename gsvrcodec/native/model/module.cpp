// What the Python module _core has of Gaussians before they are rendered.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <vector>

#include "../arrays.hpp"
#include "gaussians.hpp"

namespace {

template <class T, int Axes>
struct ArrayOf;
template <class T>
struct ArrayOf<T, 1> {
    using Type = nb::ndarray<T, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
};
template <class T>
struct ArrayOf<T, 2> {
    using Type = nb::ndarray<T, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
};
template <class T, int Axes>
using Array = typename ArrayOf<T, Axes>::Type;

void look_at(const Parameters &parameters, double tau, bool mean, const Look &look) {
    const gsvr::LookArrays out = look.arrays(parameters.position.shape(0));
    nb::gil_scoped_release release;
    gsvr::look_at(parameters.arrays, tau, mean, out);
}

void change_units(const Look &look, const Look &out) {
    const std::size_t n = look.rotation.size();
    const gsvr::LookArrays looks = look.arrays(n), units = out.arrays(n);
    nb::gil_scoped_release release;
    gsvr::change_units(looks, static_cast<std::ptrdiff_t>(n), units);
}

void carry_over(const Parameters &reference, double tau, bool mean,
                Array<const std::uint8_t, 1> mode, const Look &change, Floats indicator,
                Floats linear, Floats quadratic, double start, Array<const float, 2> bounds,
                const Parameters &out) {
    const std::size_t n = mode.shape(0), moves = indicator.size();
    require(n == reference.position.shape(0), "mode must have an entry for each Gaussian");
    require(has_shape(indicator, {moves}) && has_shape(linear, {moves, 2}) &&
                has_shape(quadratic, {moves, 2}),
            "indicator, linear and quadratic must be (V,), (V, 2) and (V, 2)");
    require(bounds.shape(0) == 5 && bounds.shape(1) == 2, "bounds must have shape (5, 2)");
    std::size_t changed = 0, moved = 0, kept = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const int of = mode.data()[i];
        if (of == gsvr::Carried::kDropped) continue;
        changed += (of & gsvr::Carried::kChanged) != 0;
        moved += (of & gsvr::Carried::kMoved) != 0;
        ++kept;
    }
    require(moved == moves, "indicator must have an entry for each Gaussian that moves");
    require(kept <= out.position.shape(0), "out must have room for all Gaussians that are kept");
    const gsvr::Carried carried{mode.data(),   change.arrays(changed), indicator.data(),
                                linear.data(), quadratic.data(),       start};
    float of[5][2];
    std::copy_n(bounds.data(), 10, of[0]);
    nb::gil_scoped_release release;
    gsvr::carry_over(reference.arrays, tau, mean, carried, of, out.arrays);
}

void drawing_order(Array<const float, 2> position, Array<const float, 2> log_scale, int width,
                   int height, Array<std::int64_t, 1> out) {
    const std::size_t n = position.shape(0);
    require(n < (1u << 28), "too many Gaussians");
    require(position.shape(1) == 2 && log_scale.shape(1) == 2 && log_scale.shape(0) == n &&
                out.shape(0) == n,
            "position, log_scale and out must be (N, 2), (N, 2) and (N,)");
    const gsvr::Size size = checked(width, height);
    nb::gil_scoped_release release;
    gsvr::drawing_order(position.data(), log_scale.data(), static_cast<int>(n), size, out.data());
}

void arrange(const Parameters &parameters, int width, int height, const Parameters &out) {
    require(out.arrays.n == parameters.arrays.n, "out must have as many Gaussians");
    const gsvr::Size size = checked(width, height);
    nb::gil_scoped_release release;
    gsvr::arrange(parameters.arrays, size, out.arrays);
}

// The rows may lie apart.
using Codes = nb::ndarray<const std::uint16_t, nb::shape<-1, -1>, nb::device::cpu>;

void dequantise(Codes codes, const std::vector<double> &offsets, const std::vector<double> &steps,
                std::optional<Array<const std::int8_t, 1>> bits,
                std::optional<Array<const std::uint8_t, 2>> numbers, float least, float most,
                Array<float, 2> out) {
    const std::size_t components = codes.shape(0), n = out.shape(0);
    require(components >= 1 && components <= 64, "codes must have 1 to 64 rows");
    require(
        offsets.size() == components && steps.size() == components && out.shape(1) == components,
        "offsets, steps and the columns of out must be as many as rows of codes");
    require(n == codes.shape(1), "out must have a row for each column of codes");
    require(n <= 1 || codes.stride(1) == 1, "each row of codes must be in one piece");
    require(bits.has_value() == numbers.has_value(), "bits and numbers go together");
    if (bits) {
        require(bits->shape(0) == n && numbers->shape(0) == components && numbers->shape(1) == n,
                "bits and numbers must have an entry for each value");
        require(std::all_of(bits->data(), bits->data() + n,
                            [](int of) { return of >= 0 && of <= gsvr::kMostBits; }),
                "bits must be 0 to 8");
    }
    const gsvr::CodedAttribute coded{codes.data(),
                                     codes.stride(0),
                                     n,
                                     static_cast<int>(components),
                                     offsets.data(),
                                     steps.data(),
                                     bits ? bits->data() : nullptr,
                                     numbers ? numbers->data() : nullptr,
                                     least,
                                     most};
    nb::gil_scoped_release release;
    gsvr::dequantise(coded, out.data());
}

}  // namespace

void bind_model(nb::module_ &m) {
    nb::class_<Look>(m, "Look").def(nb::init<Floats, Floats, Floats, Floats, Floats>(),
                                    exact("position"), exact("log_scale"), exact("rotation"),
                                    exact("colour"), exact("log_opacity"));
    m.def("look_at", &look_at, "parameters"_a, "tau"_a, "mean"_a, "out"_a);
    m.def("change_units", &change_units, "look"_a, exact("out"));
    m.def("carry_over", &carry_over, "reference"_a, "tau"_a, "mean"_a, "mode"_a, "change"_a,
          "indicator"_a, "linear"_a, "quadratic"_a, "start"_a, "bounds"_a, "out"_a);
    m.def("drawing_order", &drawing_order, "position"_a, "log_scale"_a, "width"_a, "height"_a,
          exact("out"));
    m.def("arrange", &arrange, "parameters"_a, "width"_a, "height"_a, "out"_a);
    m.def("dequantise", &dequantise, "codes"_a, "offsets"_a, "steps"_a, "bits"_a.none(),
          "numbers"_a.none(), "least"_a, "most"_a, exact("out"));
}
