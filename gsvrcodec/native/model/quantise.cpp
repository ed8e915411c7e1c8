#include <algorithm>
#include <cmath>

#include "gaussians.hpp"

namespace gsvr {

void dequantise(const CodedAttribute &a, float *values) {
    double halved[kMostBits + 1];
    for (int component = 0; component < a.components; ++component) {
        const std::uint16_t *codes = a.codes + component * a.stride;
        const double offset = a.offsets[component], step = a.steps[component];
        const auto put = [&](std::size_t i, double value) {
            values[i * a.components + component] =
                std::min(std::max(static_cast<float>(value), a.least), a.most);
        };
        if (!a.bits) {
            for (std::size_t i = 0; i < a.n; ++i) put(i, codes[i] * step + offset);
            continue;
        }
        for (int bits = 0; bits <= kMostBits; ++bits) halved[bits] = std::ldexp(step, -1 - bits);
        // In units of half of what the least bit is worth, the value is a whole number.
        const std::uint8_t *numbers = a.numbers + component * a.n;
        for (std::size_t i = 0; i < a.n; ++i) {
            const int bits = static_cast<int>(a.bits[i]);
            const int cell = 1 << bits;
            const int halves = 2 * (codes[i] * cell + numbers[i]) + 1 - cell;
            put(i, halves * halved[bits] + offset);
        }
    }
}

}  // namespace gsvr
