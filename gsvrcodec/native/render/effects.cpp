#include "effects.hpp"

#include <algorithm>
#include <cmath>

#include "pool.hpp"
#include "reconstruction.hpp"

namespace gsvr {
namespace {

constexpr int kChunk = 512;  // Gaussians of a job
constexpr double kPi = 3.14159265358979323846;
// Most of the weights at a point that a Gaussian may have: without it, nothing would be left.
constexpr double kMostShare = 0.9999;

// Where a Gaussian is looked at: at some angles on three ellipses, at the nodes of Gauss and
// Laguerre for the square of the distance from its centre, in standard deviations. What integrates
// a product with the square of a Gaussian exactly if it is a polynomial of the fifth degree.
constexpr int kRings = 3, kAngles = 8;
constexpr double kNodes[kRings] = {0.4157745567834791, 2.294280360279042, 6.289945082937479};
constexpr double kWeights[kRings] = {0.7110930099291730, 0.2785177335692408, 0.01038925650158614};

struct Point {
    double x, y;   // standard deviations along the axes
    double value;  // of the Gaussian, with the cut-off
    double share;  // of the area, in products of the standard deviations
};

struct Points {
    Point of[kRings * kAngles];

    Points() {
        Point *point = of;
        for (int ring = 0; ring < kRings; ++ring) {
            const double u = kNodes[ring], radius = std::sqrt(u);
            const double value = std::max(std::exp(-u / 2) - kCutoff, 0.0);
            const double share = kWeights[ring] * std::exp(u) * kPi / kAngles;
            for (int k = 0; k < kAngles; ++k) {
                const double angle = 2 * kPi * (k + 0.5 * (ring % 2)) / kAngles;
                *point++ = {radius * std::cos(angle), radius * std::sin(angle), value, share};
            }
        }
    }
};

}  // namespace

void add_effects(const LookArrays &look, int n, const float *sums, Size size, Size coded,
                 int threads, double *effects) {
    static const Points points;
    const double zoom_x = static_cast<double>(size.width) / coded.width;
    const double zoom_y = static_cast<double>(size.height) / coded.height;
    const auto effect = [&](int i) {
        double sigma[2];
        for (int axis = 0; axis < 2; ++axis)
            sigma[axis] = std::sqrt(std::exp(2.0 * look.log_scale[2 * i + axis]) + kDilation);
        const double cosine = std::cos(static_cast<double>(look.rotation[i]));
        const double sine = std::sin(static_cast<double>(look.rotation[i]));
        const double centre_x = (look.position[2 * i] + 1.0) / 2 * size.width;
        const double centre_y = (look.position[2 * i + 1] + 1.0) / 2 * size.height;
        const double opacity = std::exp(static_cast<double>(look.log_opacity[i]));
        const float *colour = look.colour + 3 * i;
        double sum = 0;
        for (const Point &point : points.of) {
            const double along = point.x * sigma[0], across = point.y * sigma[1];
            const double x = centre_x + (along * cosine - across * sine) * zoom_x;
            const double y = centre_y + (along * sine + across * cosine) * zoom_y;
            if (!(x >= 0 && y >= 0 && x < size.width && y < size.height)) continue;
            const float *there =
                sums + kSums * (static_cast<std::size_t>(y) * size.width + static_cast<int>(x));
            // Of the colour c with the share s of the weights, it changes the picture P by
            // s / (1 - s) (P - c) when it leaves.
            const double weight = there[3] + static_cast<double>(kGround);
            const double share = std::min(opacity * point.value / weight, kMostShare);
            double apart = 0;
            for (int c = 0; c < 3; ++c)
                apart += std::pow(there[c] / weight - static_cast<double>(colour[c]), 2);
            sum += point.share * std::pow(share / (1 - share), 2) * apart;
        }
        return sum * sigma[0] * sigma[1] * zoom_x * zoom_y;
    };
    parallel_for((n + kChunk - 1) / kChunk, threads, [&](int job, int) {
        for (int i = job * kChunk; i < std::min(n, (job + 1) * kChunk); ++i)
            effects[i] += effect(i);
    });
}

}  // namespace gsvr
