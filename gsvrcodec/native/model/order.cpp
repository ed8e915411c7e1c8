#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <vector>

#include "gaussians.hpp"

namespace gsvr {
namespace {

constexpr int kTile = 32;  // px of a side

// Where Gaussians come in the drawing order: levels, then rows of tiles, then columns.
class Places {
   public:
    explicit Places(Size size)
        : across_(std::max(size.width / kTile, 1)), down_(std::max(size.height / kTile, 1)) {
        for (int level = 1; level < kLevels; ++level)
            bounds_[level - 1] = static_cast<float>(std::log(kLevelScale * (1 << level)));
    }

    std::uint64_t count() const { return static_cast<std::uint64_t>(kLevels) * across_ * down_; }

    std::uint64_t operator()(const float *position, const float *log_scale) const {
        const float least = std::min(log_scale[0], log_scale[1]);
        std::uint64_t level = 0;
        for (float bound : bounds_) level += bound <= least;
        const std::uint64_t row = tile(position[1], down_), column = tile(position[0], across_);
        return (level * down_ + row) * across_ + column;
    }

   private:
    static std::uint64_t tile(float coordinate, int tiles) {
        const double at = static_cast<double>(coordinate + 1) * (0.5 * tiles);
        // With the operands in this order, NaN becomes the first tile.
        return static_cast<std::uint64_t>(std::min(std::max(0.0, at), tiles - 1.0));
    }

    const int across_, down_;
    float bounds_[kLevels - 1];
};

// The numbers of keys, sorted by key: digit by digit, from the lowest.
template <class Index>
void sort(const std::vector<std::uint64_t> &keys, std::uint64_t end, Index *order) {
    constexpr int kDigit = 11;
    const std::size_t n = keys.size();
    std::vector<Index> other(n);
    std::iota(order, order + n, Index{0});
    for (int shift = 0; shift < 64 && end >> shift; shift += kDigit) {
        std::size_t first[(1 << kDigit) + 1] = {};
        const auto digit = [&](Index i) { return keys[i] >> shift & ((1u << kDigit) - 1); };
        for (std::size_t i = 0; i < n; ++i) ++first[digit(static_cast<Index>(i)) + 1];
        std::partial_sum(std::begin(first), std::end(first), std::begin(first));
        for (std::size_t i = 0; i < n; ++i) other[first[digit(order[i])]++] = order[i];
        std::copy(other.begin(), other.end(), order);
    }
}

}  // namespace

void drawing_order(const float *position, const float *log_scale, int n, Size size,
                   std::int64_t *order) {
    const Places place(size);
    std::vector<std::uint64_t> keys(n);
    for (int i = 0; i < n; ++i) keys[i] = place(position + 2 * i, log_scale + 2 * i);
    sort(keys, place.count(), order);
}

void arrange(const GopArrays &gop, Size size, const GopArrays &arranged) {
    const Places place(size);
    std::vector<std::uint64_t> keys(gop.n);
    for (int i = 0; i < gop.n; ++i) {
        const float *linear = gop.linear + 2 * i, *quadratic = gop.quadratic + 2 * i;
        const bool moves = gop.indicator[i] != 1 || linear[0] != 0 || linear[1] != 0 ||
                           quadratic[0] != 0 || quadratic[1] != 0;
        keys[i] = place(gop.position + 2 * i, gop.log_scale + 2 * i) + (moves ? 0 : place.count());
    }
    std::vector<std::int32_t> order(gop.n);
    sort(keys, 2 * place.count(), order.data());
    const auto gather = [&](const float *from, float *to, int columns) {
        for (int i = 0; i < gop.n; ++i)
            std::memcpy(to + static_cast<std::ptrdiff_t>(i) * columns,
                        from + static_cast<std::ptrdiff_t>(order[i]) * columns,
                        columns * sizeof(float));
    };
    gather(gop.position, arranged.position, 2);
    gather(gop.log_scale, arranged.log_scale, 2);
    gather(gop.rotation, arranged.rotation, 1);
    gather(gop.colour, arranged.colour, 3);
    gather(gop.log_opacity, arranged.log_opacity, 1);
    gather(gop.indicator, arranged.indicator, 1);
    gather(gop.linear, arranged.linear, 2);
    gather(gop.quadratic, arranged.quadratic, 2);
}

}  // namespace gsvr
