// The planes of a GOP: those of the format's own codecs are decoded together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsvr {

// The numbers of the codecs in the plane table.
enum Codec { kConstant = 0, kContext = 4, kRanges = 5 };

// The planes of one grid, in the order of the table.
struct PlaneStack {
    std::uint16_t *samples;  // (count, height, width)
    int count, width, height;
    bool guided;                         // the first plane guides the others: see `follow`
    std::vector<std::uint16_t> columns;  // what `follow` found; empty until a plane asks for it
};

struct CodedPlane {
    int codec, bits;
    const std::uint8_t *data;
    std::size_t size;
    int place;  // in its stack; the planes before it are decoded
};

// Decodes a plane to its place in the stack. Throws Corrupt if the bytes are not such a plane, and
// std::invalid_argument if the codec is none of the above.
void decode_plane(const CodedPlane &plane, PlaneStack &stack);

}  // namespace gsvr
