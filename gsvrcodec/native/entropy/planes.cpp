#include "planes.hpp"

#include <algorithm>
#include <string>

#include "context_codec.hpp"
#include "ranges_codec.hpp"
#include "rans.hpp"

namespace gsvr {
namespace {

// Codec 0 (spec section "Codec 0"): the value of all samples.
void decode_constant(const CodedPlane &plane, std::size_t samples, std::uint16_t *out) {
    if (plane.size != 2) throw Corrupt("it does not have two bytes");
    const int value = plane.data[0] | plane.data[1] << 8;
    if (value >> plane.bits)
        throw Corrupt("sample " + std::to_string(value) + " in a plane of " +
                      std::to_string(plane.bits) + " bits");
    std::fill_n(out, samples, static_cast<std::uint16_t>(value));
}

}  // namespace

void decode_plane(const CodedPlane &plane, PlaneStack &stack) {
    const std::size_t samples = static_cast<std::size_t>(stack.width) * stack.height;
    std::uint16_t *out = stack.samples + plane.place * samples;
    switch (plane.codec) {
        case kConstant:
            return decode_constant(plane, samples, out);
        case kContext: {
            const bool guided = stack.guided && plane.place;
            if (guided && stack.columns.empty()) {
                stack.columns.resize(samples);
                follow(stack.width, stack.height, stack.samples, stack.columns.data());
            }
            const Plane shape{stack.width,   stack.height, plane.bits,
                              stack.samples, plane.place,  guided ? stack.columns.data() : nullptr};
            return decode_context(shape, plane.data, plane.size, out);
        }
        case kRanges:
            return decode_ranges(stack.width, stack.height, plane.bits, plane.data, plane.size,
                                 out);
        default:
            throw std::invalid_argument("not one of the format's own codecs");
    }
}

}  // namespace gsvr
