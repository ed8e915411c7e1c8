// Gaussians between the file and the renderer: the values of their codes, how they are drawn at one
// moment, how a GOP takes them over from another, and in which order they are rendered fastest.
// Equations: spec/gsvr.md, sections "Dequantisation", "Refinement", "Prediction".
//
// Computed in double precision, and compiled so that no two operations become one: all machines get
// the same values, except for the last bit of an exponential or a logarithm.
#pragma once

#include <cstddef>
#include <cstdint>

#include "../render/core.hpp"

namespace gsvr {

constexpr int kMostBits = 8;  // that refine a value

// Codes of the components of one attribute, and how they stand for values.
struct CodedAttribute {
    const std::uint16_t *codes;  // of each component n, `stride` codes apart
    std::ptrdiff_t stride;
    std::size_t n;
    int components;
    const double *offsets, *steps;  // (components)
    // Bits that refine the values of each sample, (n), and the numbers that they hold,
    // (components, n); null: none.
    const std::int8_t *bits;
    const std::uint8_t *numbers;
    float least, most;  // bounds of the values
};

// Writes the values, (n, components).
void dequantise(const CodedAttribute &, float *values);

// The arrays of a look, or of changes of one.
struct LookArrays {
    float *position, *log_scale, *rotation, *colour, *log_opacity;
};

// Writes the Gaussians of a GOP as drawn at a time.
void look_at(const GopArrays &, double tau, bool mean, const LookArrays &look);

// Writes what a stored change of 1 adds to each value of n looks.
void change_units(const LookArrays &looks, std::ptrdiff_t n, const LookArrays &units);

// How a GOP takes the Gaussians of its reference over.
struct Carried {
    // Bits of a mode.
    static constexpr std::uint8_t kMoved = 1, kChanged = 2, kDropped = 4;

    const std::uint8_t *mode;                     // of each Gaussian of the reference
    LookArrays change;                            // of those that change, in their units
    const float *indicator, *linear, *quadratic;  // of those that move
    double start;                                 // time at which they begin to move
};

// Writes the Gaussians that are not dropped, in the order of the reference, which is taken over as
// drawn at `tau`. `bounds` has the least and the greatest value of each attribute of a look.
void carry_over(const GopArrays &reference, double tau, bool mean, const Carried &,
                const float (&bounds)[5][2], const GopArrays &gop);

// Writes a permutation of n Gaussians that visits the pyramid levels of a frame one by one, and
// each of them tile by tile. Ties keep their order.
void drawing_order(const float *position, const float *log_scale, int n, Size size,
                   std::int64_t *order);

// Writes the Gaussians of a GOP in the order in which several frames are rendered fastest: those
// that move before those that stand still, each in drawing order.
void arrange(const GopArrays &, Size size, const GopArrays &arranged);

}  // namespace gsvr
