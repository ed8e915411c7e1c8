// What the parts of the Python module _core share: arrays as arguments, and their checks. Arrays
// are NumPy arrays or torch tensors on the CPU, never copied.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <initializer_list>

#include "model/gaussians.hpp"
#include "render/core.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using Floats = nb::ndarray<float, nb::c_contig, nb::device::cpu>;

inline void require(bool condition, const char *message) {
    if (!condition) throw nb::value_error(message);
}

inline bool has_shape(const Floats &array, std::initializer_list<std::size_t> shape) {
    if (array.ndim() != shape.size()) return false;
    std::size_t axis = 0;
    for (std::size_t n : shape)
        if (array.shape(axis++) != n) return false;
    return true;
}

// Checks the eleven arrays of a GOP, or of its gradients, and keeps them alive.
struct Parameters {
    Floats position, log_scale, rotation, colour, log_opacity, indicator, linear, quadratic;
    Floats xy, xt, yt;
    gsvr::GopArrays arrays{};

    Parameters(Floats position_, Floats log_scale_, Floats rotation_, Floats colour_,
               Floats log_opacity_, Floats indicator_, Floats linear_, Floats quadratic_,
               Floats xy_, Floats xt_, Floats yt_)
        : position(position_),
          log_scale(log_scale_),
          rotation(rotation_),
          colour(colour_),
          log_opacity(log_opacity_),
          indicator(indicator_),
          linear(linear_),
          quadratic(quadratic_),
          xy(xy_),
          xt(xt_),
          yt(yt_) {
        require(position.ndim() == 2, "position must have shape (N, 2)");
        const std::size_t n = position.shape(0);
        require(n < (1u << 28), "too many Gaussians");
        require(has_shape(position, {n, 2}), "position must have shape (N, 2)");
        require(has_shape(log_scale, {n, 2}), "log_scale must have shape (N, 2)");
        require(has_shape(rotation, {n}), "rotation must have shape (N,)");
        require(has_shape(colour, {n, 3}), "colour must have shape (N, 3)");
        require(has_shape(log_opacity, {n}), "log_opacity must have shape (N,)");
        require(has_shape(indicator, {n}), "indicator must have shape (N,)");
        require(has_shape(linear, {n, 2}), "linear must have shape (N, 2)");
        require(has_shape(quadratic, {n, 2}), "quadratic must have shape (N, 2)");
        require(xy.ndim() == 3 && xt.ndim() == 3 && yt.ndim() == 3, "grids must have three axes");
        const std::size_t gy = xy.shape(0), gx = xy.shape(1), gt = xt.shape(0);
        const bool empty = gx == 0 && gy == 0 && gt == 0;
        require(empty || (gx > 0 && gy > 0 && gt > 0), "grids must be all empty or none");
        require(gx <= 8192 && gy <= 8192 && gt <= 65536, "a grid is too large");
        require(has_shape(xy, {gy, gx, gsvr::kChannels}), "xy must have shape (Gy, Gx, 8)");
        require(has_shape(xt, {gt, gx, gsvr::kChannels}), "xt must have shape (Gt, Gx, 8)");
        require(has_shape(yt, {gt, gy, gsvr::kChannels}), "yt must have shape (Gt, Gy, 8)");
        arrays = {position.data(),
                  log_scale.data(),
                  rotation.data(),
                  colour.data(),
                  log_opacity.data(),
                  indicator.data(),
                  linear.data(),
                  quadratic.data(),
                  xy.data(),
                  xt.data(),
                  yt.data(),
                  static_cast<int>(n),
                  static_cast<int>(gx),
                  static_cast<int>(gy),
                  static_cast<int>(gt)};
    }

    bool same_shape(const Parameters &other) const {
        return arrays.n == other.arrays.n && arrays.gx == other.arrays.gx &&
               arrays.gy == other.arrays.gy && arrays.gt == other.arrays.gt;
    }
};

// Checks the five arrays of a look of n Gaussians, and keeps them alive.
struct Look {
    Floats position, log_scale, rotation, colour, log_opacity;

    gsvr::LookArrays arrays(std::size_t n) const {
        require(has_shape(position, {n, 2}) && has_shape(log_scale, {n, 2}) &&
                    has_shape(rotation, {n}) && has_shape(colour, {n, 3}) &&
                    has_shape(log_opacity, {n}),
                "the arrays of a look must be (N, 2), (N, 2), (N,), (N, 3) and (N,)");
        return {position.data(), log_scale.data(), rotation.data(), colour.data(),
                log_opacity.data()};
    }
};

inline gsvr::Size checked(std::int64_t width, std::int64_t height) {
    require(width > 0 && height > 0 && width <= 65536 && height <= 65536,
            "width and height must be in 1..65536");
    return {static_cast<int>(width), static_cast<int>(height)};
}

// For arrays that are written or kept: nanobind must not pass a converted copy.
inline auto exact(const char *name) { return nb::arg(name).noconvert(); }

// Adds what model/ has to the module; `Parameters` must be there.
void bind_model(nb::module_ &m);
