#include <algorithm>
#include <cmath>
#include <vector>

#include "gaussians.hpp"

namespace gsvr {
namespace {

// The two points of a grid's axis that a coordinate lies between, and the weight of the second.
struct Cell {
    int low, high;
    double fraction;
};

Cell cell_at(double coordinate, int size) {
    const double last = size - 1;
    // With the operands in this order, NaN becomes the first point.
    const double u = std::min(std::max(0.0, (coordinate + 1) / 2 * last), last);
    const int low = static_cast<int>(u);
    return {low, std::min(low + 1, size - 1), u - low};
}

template <class T>
double between(const T *a, const T *b, double fraction, int channel) {
    return a[channel] * (1 - fraction) + b[channel] * fraction;
}

// One Gaussian as drawn at one moment.
struct Look {
    float position[2], log_scale[2], rotation, colour[3], log_opacity;
};

// A GOP at one moment.
class Moment {
   public:
    Moment(const GopArrays &gop, double tau, bool mean)
        : gop_(gop),
          tau_(tau),
          mean_(mean),
          along_x_(lines(gop.xt, gop.gx)),
          along_y_(lines(gop.yt, gop.gy)) {}

    Look operator[](int i) const {
        const float *at = gop_.position + 2 * i, *ls = gop_.log_scale + 2 * i;
        const float *of = gop_.colour + 3 * i;
        double place[2];
        for (int axis = 0; axis < 2; ++axis)
            place[axis] = at[axis] + tau_ * gop_.linear[2 * i + axis] +
                          tau_ * tau_ * gop_.quadratic[2 * i + axis];
        Look look{{}, {ls[0], ls[1]}, gop_.rotation[i], {of[0], of[1], of[2]}, gop_.log_opacity[i]};
        if (gop_.gx && gop_.indicator[i] != 1) {
            double offset[kChannels];
            find_offset(at, 1 - static_cast<double>(gop_.indicator[i]), offset);
            for (int axis = 0; axis < 2; ++axis) {
                place[axis] += offset[axis];
                const double scale = std::exp(static_cast<double>(ls[axis])) + offset[2 + axis];
                look.log_scale[axis] = static_cast<float>(std::log(std::max(scale, kLeastScale)));
            }
            look.rotation = static_cast<float>(look.rotation + offset[4]);
            if (mean_)
                look.log_opacity = static_cast<float>(
                    std::min(std::max<double>(look.log_opacity + offset[5], -kMostLogOpacity),
                             static_cast<double>(kMostLogOpacity)));
            else
                for (int c = 0; c < 3; ++c)
                    look.colour[c] = static_cast<float>(look.colour[c] + offset[5 + c]);
        }
        for (int axis = 0; axis < 2; ++axis) look.position[axis] = static_cast<float>(place[axis]);
        return look;
    }

   private:
    static constexpr double kLeastScale = 0.1;  // kMinScale, which is rounded to a float

    // A (gt, cells, 8) grid at the moment, (cells, 8).
    std::vector<double> lines(const float *grid, int cells) const {
        std::vector<double> line(static_cast<std::size_t>(cells) * kChannels);
        if (line.empty()) return line;
        const Cell time = cell_at(tau_, gop_.gt);
        const float *a = grid + time.low * line.size(), *b = grid + time.high * line.size();
        for (std::size_t k = 0; k < line.size(); ++k)
            line[k] = between(a, b, time.fraction, static_cast<int>(k));
        return line;
    }

    void find_offset(const float *at, double strength, double *offset) const {
        const Cell x = cell_at(at[0], gop_.gx), y = cell_at(at[1], gop_.gy);
        const auto grid = [&](int row, int column) {
            return gop_.xy + (static_cast<std::size_t>(row) * gop_.gx + column) * kChannels;
        };
        const float *a = grid(y.low, x.low), *b = grid(y.low, x.high);
        const float *c = grid(y.high, x.low), *d = grid(y.high, x.high);
        const double *left = &along_x_[x.low * kChannels], *right = &along_x_[x.high * kChannels];
        const double *upper = &along_y_[y.low * kChannels], *lower = &along_y_[y.high * kChannels];
        for (int k = 0; k < kChannels; ++k) {
            const double top = between(a, b, x.fraction, k), bottom = between(c, d, x.fraction, k);
            const double field = bottom * y.fraction + top * (1 - y.fraction);
            offset[k] = strength * (field * between(left, right, x.fraction, k) *
                                    between(upper, lower, y.fraction, k));
        }
    }

    const GopArrays &gop_;
    const double tau_;
    const bool mean_;
    const std::vector<double> along_x_, along_y_;
};

// The arrays of a look, each with the number of its columns: the order of `bounds`.
template <class Body>
void for_attributes(Look &look, const LookArrays &arrays, Body body) {
    body(0, look.position, arrays.position, 2);
    body(1, look.log_scale, arrays.log_scale, 2);
    body(2, &look.rotation, arrays.rotation, 1);
    body(3, look.colour, arrays.colour, 3);
    body(4, &look.log_opacity, arrays.log_opacity, 1);
}

// What a stored change of 1 adds to each attribute of a look.
void find_units(const Look &look, double *unit) {
    const double first = look.log_scale[0], second = look.log_scale[1];
    const double opacity = look.log_opacity;
    const double area = first + second, shape = std::min(std::abs(first - second), 4.0);
    unit[0] = std::exp((3 * area - 4 * shape - opacity) / 8);
    unit[1] = std::exp((-area - shape - opacity) / 8);
    unit[2] = std::exp((area - 7 * shape) / 8);
    unit[3] = std::exp((-2 * area - opacity) / 8);
    unit[4] = 1;
}

void store(Look &look, const LookArrays &arrays, std::ptrdiff_t i) {
    for_attributes(look, arrays, [&](int, const float *own, float *array, int columns) {
        std::copy(own, own + columns, array + i * columns);
    });
}

}  // namespace

void look_at(const GopArrays &gop, double tau, bool mean, const LookArrays &out) {
    const Moment moment(gop, tau, mean);
    for (int i = 0; i < gop.n; ++i) {
        Look look = moment[i];
        store(look, out, i);
    }
}

void change_units(const LookArrays &looks, std::ptrdiff_t n, const LookArrays &units) {
    for (std::ptrdiff_t i = 0; i < n; ++i) {
        Look look;
        double unit[5];
        for_attributes(look, looks, [&](int, float *own, const float *array, int columns) {
            std::copy(array + i * columns, array + (i + 1) * columns, own);
        });
        find_units(look, unit);
        for_attributes(look, units, [&](int k, float *, float *array, int columns) {
            std::fill_n(array + i * columns, columns, static_cast<float>(unit[k]));
        });
    }
}

void carry_over(const GopArrays &reference, double tau, bool mean, const Carried &carried,
                const float (&bounds)[5][2], const GopArrays &gop) {
    const Moment moment(reference, tau, mean);
    const LookArrays out{gop.position, gop.log_scale, gop.rotation, gop.colour, gop.log_opacity};
    const double start = carried.start;
    std::ptrdiff_t changed = 0, moved = 0, kept = 0;
    for (int i = 0; i < reference.n; ++i) {
        const int mode = carried.mode[i];
        if (mode == Carried::kDropped) continue;
        Look look = moment[i];
        const bool changes = mode & Carried::kChanged, moves = mode & Carried::kMoved;
        double unit[5];
        if (changes) find_units(look, unit);
        for_attributes(look, carried.change, [&](int k, float *own, const float *change, int n) {
            for (int c = 0; c < n; ++c) {
                if (changes)
                    own[c] = static_cast<float>(own[c] + unit[k] * change[changed * n + c]);
                own[c] = std::min(std::max(own[c], bounds[k][0]), bounds[k][1]);
            }
        });
        gop.indicator[kept] = moves ? carried.indicator[moved] : 1;
        for (int axis = 0; axis < 2; ++axis) {
            const float linear = moves ? carried.linear[2 * moved + axis] : 0;
            const float quadratic = moves ? carried.quadratic[2 * moved + axis] : 0;
            gop.linear[2 * kept + axis] = linear;
            gop.quadratic[2 * kept + axis] = quadratic;
            if (!moves) continue;
            // The motion begins where the reference ends, plus the change.
            const double way = start * linear + start * start * quadratic;
            const float place = static_cast<float>(look.position[axis] - way);
            look.position[axis] = std::min(std::max(place, bounds[0][0]), bounds[0][1]);
        }
        store(look, out, kept);
        changed += changes;
        moved += moves;
        ++kept;
    }
}

}  // namespace gsvr
