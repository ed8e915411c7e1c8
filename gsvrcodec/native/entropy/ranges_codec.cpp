#include "ranges_codec.hpp"

#include <algorithm>

#include "rans.hpp"

namespace gsvr {
namespace {

constexpr unsigned kSlotBits = 16;

// The first of the 2^16 slots of `value`, one of `count` equally likely values. The inverse is
// slot * count >> 16.
std::uint32_t slot_of(std::uint32_t value, std::uint32_t count) {
    return static_cast<std::uint32_t>(
        ((static_cast<std::uint64_t>(value) << kSlotBits) + count - 1) / count);
}

}  // namespace

std::vector<std::uint8_t> encode_ranges(int width, int height, const std::uint16_t *samples) {
    Writer out;
    std::vector<std::uint16_t> lows(height);
    std::vector<std::uint32_t> counts(height);
    std::int32_t before = 0;
    for (int y = 0; y < height; ++y) {
        const std::uint16_t *row = samples + static_cast<std::size_t>(y) * width;
        const auto [low, high] = std::minmax_element(row, row + width);
        lows[y] = *low;
        counts[y] = *high - *low + 1u;
        write_varint(out.head, zigzag(*low - before));
        write_varint(out.head, counts[y] - 1);
        before = *high;
    }
    for (int y = height; y-- > 0;) {
        for (int x = width; x-- > 0;) {
            const std::uint32_t value = samples[static_cast<std::size_t>(y) * width + x] - lows[y];
            const std::uint32_t start = slot_of(value, counts[y]);
            out.retreat(start, slot_of(value + 1, counts[y]) - start, kSlotBits);
        }
    }
    return out.finish();
}

void decode_ranges(int width, int height, int bits, const std::uint8_t *data, std::size_t size,
                   std::uint16_t *samples) {
    Reader in(data, size, static_cast<std::size_t>(width) + 2);
    const std::int64_t highest = (1 << bits) - 1;
    std::vector<std::uint16_t> lows(height);
    std::vector<std::uint32_t> counts(height);
    std::int64_t before = 0;
    for (int y = 0; y < height; ++y) {
        const std::int64_t low = before + unzigzag(read_varint(in));
        const std::int64_t high = low + read_varint(in);
        if (low < 0 || high > highest) throw Corrupt("the range of a row is out of range");
        lows[y] = static_cast<std::uint16_t>(low);
        counts[y] = static_cast<std::uint32_t>(high - low + 1);
        before = high;
    }
    in.begin();
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const std::uint32_t slot = in.state() & ((1u << kSlotBits) - 1);
            const auto value = static_cast<std::uint32_t>(
                static_cast<std::uint64_t>(slot) * counts[y] >> kSlotBits);
            const std::uint32_t start = slot_of(value, counts[y]);
            in.advance(slot_of(value + 1, counts[y]) - start, kSlotBits, slot - start);
            *samples++ = static_cast<std::uint16_t>(lows[y] + value);
        }
        in.check();
    }
    in.finish();
}

}  // namespace gsvr
