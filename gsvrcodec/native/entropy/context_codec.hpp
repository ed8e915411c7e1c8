// Codec 4, context (spec section "Codec 4"): a linear prediction from neighbours and from prior
// planes, and a range coder whose statistics depend on the errors around a sample.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsvr {

inline constexpr int kNeighbours = 6;
inline constexpr int kMaxContexts = 8;

struct Plane {
    int width, height, bits;
    const std::uint16_t *prior;  // planes of the same size before this one, one after the other
    int prior_count;
    const std::uint16_t *columns;  // for each sample, the column of the row above that it follows
    std::size_t samples() const { return static_cast<std::size_t>(width) * height; }
};

// What a sample is predicted from; all of it is stored.
struct Predictor {
    struct Term {
        int plane, weight;
    };
    std::vector<Term> terms;    // prior planes, ascending; weights in 1/256
    std::int32_t bias = 0;      // in 1/256
    bool guided = false;        // the row above is followed as `columns` says
    std::array<int, kNeighbours> weights{};  // left, left of it, above, right of it, left, two right; 1/64
};

// The part of the coder that does not depend on the prediction.
struct Coding {
    unsigned direct, top;                   // division of errors into tokens
    std::vector<std::uint32_t> thresholds;  // strictly ascending and positive: bounds of contexts
};

// For each sample, the column of the row above whose guide is the last not to be larger than its
// own, going from left to right and never back; 0 in the first row.
void follow(int width, int height, const std::uint16_t *guide, std::uint16_t *columns);

// Errors and, for each, the magnitude of the errors around it.
void predict(const Plane &plane, const Predictor &predictor, const std::uint16_t *samples,
             std::int32_t *errors, std::uint32_t *around);

// Bits of a stream with these errors, all but those of its predictor.
double measure(const std::int32_t *errors, const std::uint32_t *around, std::size_t count,
               const Coding &coding);

std::vector<std::uint8_t> encode_context(const Plane &plane, const Predictor &predictor,
                                         const Coding &coding, const std::uint16_t *samples);

// Throws Corrupt.
void decode_context(const Plane &plane, const std::uint8_t *data, std::size_t size,
                    std::uint16_t *samples);

}  // namespace gsvr
