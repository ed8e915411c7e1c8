// Plane codec 5, "ranges" (spec section "Codec 5"). Stores the smallest and the largest sample of
// each row; the samples of a row are coded as equally likely values of that range.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsvr {

std::vector<std::uint8_t> encode_ranges(int width, int height, const std::uint16_t *samples);

// Throws Corrupt if the stream is not valid.
void decode_ranges(int width, int height, int bits, const std::uint8_t *data, std::size_t size,
                   std::uint16_t *samples);

}  // namespace gsvr
