// Plane codec 4, "context" (spec section "Codec 4"). Samples are predicted linearly from their
// neighbours and from prior planes. A range coder stores the prediction errors; its statistics
// depend on the errors of the neighbours.
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
    const std::uint16_t *prior;  // (prior_count, height, width): the prior planes
    int prior_count;
    const std::uint16_t *columns;  // (height, width), or null: see `follow`
    std::size_t samples() const { return static_cast<std::size_t>(width) * height; }
};

// The linear prediction of a sample; stored in the stream.
struct Predictor {
    struct Term {
        int plane, weight;
    };
    std::vector<Term> terms;  // planes ascending; weights in 1/256
    std::int32_t bias = 0;    // in 1/256
    bool guided = false;      // the neighbours above are those of the column in `columns`
    // Of the neighbours, in 1/64: left, two to the left, above, above right, above left, above two
    // to the right.
    std::array<int, kNeighbours> weights{};
};

// The parameters of the entropy coder; stored in the stream.
struct Coding {
    unsigned direct, top;                   // division of errors into tokens, see tokens.hpp
    std::vector<std::uint32_t> thresholds;  // bounds of contexts, strictly ascending, positive
};

// Finds, for each sample, the column of the row above that the sample follows. `guide` is the plane
// of the Gaussians' x positions, whose rows mostly ascend. From left to right, the column advances
// while the guide at the next column above is not larger than the guide at the sample; the column
// never goes back. The columns of the first row are 0.
void follow(int width, int height, const std::uint16_t *guide, std::uint16_t *columns);

// Computes, for each sample, the error of its prediction and `around`: the weighted sum of the
// magnitudes of its neighbours' errors.
void predict(const Plane &plane, const Predictor &predictor, const std::uint16_t *samples,
             std::int32_t *errors, std::uint32_t *around);

// Returns the size in bits of a stream with these errors, without its predictor.
double measure(const std::int32_t *errors, const std::uint32_t *around, std::size_t count,
               const Coding &coding);

std::vector<std::uint8_t> encode_context(const Plane &plane, const Predictor &predictor,
                                         const Coding &coding, const std::uint16_t *samples);

// Throws Corrupt if the stream is not valid.
void decode_context(const Plane &plane, const std::uint8_t *data, std::size_t size,
                    std::uint16_t *samples);

}  // namespace gsvr
