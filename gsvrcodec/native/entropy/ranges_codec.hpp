// Codec 5, ranges (spec section "Codec 5"): the range of each row, and all samples of it alike.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsvr {

std::vector<std::uint8_t> encode_ranges(int width, int height, const std::uint16_t *samples);

// Throws Corrupt.
void decode_ranges(int width, int height, int bits, const std::uint8_t *data, std::size_t size,
                   std::uint16_t *samples);

}  // namespace gsvr
