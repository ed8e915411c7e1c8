// Numbers of so many bits each, the highest bit first (spec section "Refinement").
#pragma once

#include <cstddef>
#include <cstdint>

namespace gsvr {

// Reads `count` numbers; number i has bits[i] bits, 0 to 8. `data` has all bits.
inline void unpack_numbers(const std::uint8_t *data, const std::int64_t *bits, std::size_t count,
                           std::int64_t *numbers) {
    unsigned window = 0, held = 0;  // the last `held` bits of the window are not yet read
    for (std::size_t i = 0; i < count; ++i) {
        const auto wanted = static_cast<unsigned>(bits[i]);
        if (held < wanted) {
            window = window << 8 | *data++;
            held += 8;
        }
        held -= wanted;
        numbers[i] = window >> held & ((1u << wanted) - 1);
    }
}

}  // namespace gsvr
