// Numbers of so many bits each, the highest bit first (spec section "Refinement").
#pragma once

#include <cstddef>
#include <cstdint>

namespace gsvr {

// Reads `count` numbers from `size` bytes; number i has bits[i] bits, 0 to 8. The bytes have all
// bits.
inline void unpack_numbers(const std::uint8_t *data, std::size_t size, const std::int8_t *bits,
                           std::size_t count, std::uint8_t *numbers) {
    std::size_t first = 0;  // bit of the number
    for (std::size_t i = 0; i < count; ++i) {
        const auto wanted = static_cast<unsigned>(bits[i]);
        // A number lies in two bytes at most; one of no bits may lie behind the last.
        const std::size_t byte = first / 8;
        const unsigned high = byte < size ? data[byte] : 0;
        const unsigned low = byte + 1 < size ? data[byte + 1] : 0;
        const unsigned right = 16 - first % 8 - wanted;
        numbers[i] = static_cast<std::uint8_t>((high << 8 | low) >> right & ((1u << wanted) - 1));
        first += wanted;
    }
}

}  // namespace gsvr
