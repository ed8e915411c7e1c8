#include "context_codec.hpp"

#include <algorithm>
#include <cstdlib>

#include "rans.hpp"
#include "tokens.hpp"

namespace gsvr {
namespace {

constexpr int kMaxTerms = 15;
constexpr std::int32_t kMaxWeightSum = 1 << 12;
constexpr std::int32_t kMaxBias = (1 << 29) - 1;
constexpr std::uint32_t kMaxThreshold = 1u << 20;
// An upper bound of the reads between two checks before the first sample.
constexpr std::size_t kHeadReads = 8;
constexpr unsigned kGuided = 16, kNear = 32;

// The values of a sample that the prediction of later samples needs: 256 times the difference
// between the sample and the prediction from prior planes, and the magnitude of the error.
struct Cell {
    std::int32_t value, error;
};

// Visits the samples in raster order. step(index, prediction, around) must return the error of the
// prediction; row_done() is called after each row.
template <class Step, class RowDone>
void walk(const Plane &plane, const Predictor &predictor, Step step, RowDone row_done) {
    const int width = plane.width, highest = (1 << plane.bits) - 1;
    const std::array<int, kNeighbours> v = predictor.weights;
    std::vector<std::int32_t> base(width);
    std::vector<Cell> rows[2] = {std::vector<Cell>(width + 3), std::vector<Cell>(width + 3)};
    for (int y = 0; y < plane.height; ++y) {
        const std::size_t begin = static_cast<std::size_t>(y) * width;
        std::fill(base.begin(), base.end(), predictor.bias);
        for (const auto &term : predictor.terms) {
            const std::uint16_t *row = plane.prior + term.plane * plane.samples() + begin;
            for (int x = 0; x < width; ++x) base[x] += term.weight * row[x];
        }
        const std::uint16_t *columns = predictor.guided ? plane.columns + begin : nullptr;
        Cell *const row = rows[y & 1].data() + 1;
        const Cell *const above = rows[~y & 1].data() + 1;
        Cell left = y ? above[0] : Cell{0, 0}, left2 = left;
        for (int x = 0; x < width; ++x) {
            std::int64_t value = static_cast<std::int64_t>(v[0]) * left.value +
                                 static_cast<std::int64_t>(v[1]) * left2.value;
            std::uint32_t around = 2 * left.error + left2.error;
            if (y) {
                const Cell *const up = above + (columns ? columns[x] : x);
                value += static_cast<std::int64_t>(v[2]) * up[0].value +
                         static_cast<std::int64_t>(v[3]) * up[1].value +
                         static_cast<std::int64_t>(v[4]) * up[-1].value +
                         static_cast<std::int64_t>(v[5]) * up[2].value;
                around += 2 * up[0].error + 2 * up[1].error + up[-1].error + up[2].error;
            } else {
                value += static_cast<std::int64_t>(v[2] + v[3] + v[4] + v[5]) * left.value;
                around += 6 * left.error;
            }
            const std::int64_t wanted = (base[x] + (value >> 6) + 128) >> 8;
            const int prediction = static_cast<int>(wanted < 0         ? 0
                                                    : wanted > highest ? highest
                                                                       : wanted);
            const int error = step(begin + x, prediction, around);
            const Cell cell{256 * (prediction + error) - base[x], std::abs(error)};
            row[x] = cell;
            left2 = x ? left : cell;
            left = cell;
        }
        row[-1] = row[0];
        row[width] = row[width + 1] = row[width - 1];
        row_done();
    }
}

// Maps `around` of a sample to its context: the number of thresholds that are not larger.
class Contexts {
   public:
    explicit Contexts(const std::vector<std::uint32_t> &thresholds) : thresholds_(thresholds) {
        std::uint8_t context = 0;
        auto begin = table_.begin();
        for (std::uint32_t threshold : thresholds) {
            const auto end = table_.begin() + std::min(threshold, kTable);
            std::fill(begin, end, context++);
            begin = end;
        }
        std::fill(begin, table_.end(), context);
    }

    unsigned operator()(std::uint32_t around) const {
        return around < kTable ? table_[around] : count(around);
    }

   private:
    static constexpr std::uint32_t kTable = 4096;

    unsigned count(std::uint32_t around) const {
        unsigned context = 0;
        for (std::uint32_t threshold : thresholds_) context += around >= threshold;
        return context;
    }

    const std::vector<std::uint32_t> &thresholds_;
    std::array<std::uint8_t, kTable> table_;
};

void write_head(std::vector<std::uint8_t> &out, const Predictor &predictor, const Coding &coding) {
    const bool near = predictor.weights != std::array<int, kNeighbours>{};
    out.push_back(static_cast<std::uint8_t>(predictor.terms.size() |
                                            (predictor.guided ? kGuided : 0) | (near ? kNear : 0)));
    for (const auto &term : predictor.terms) {
        out.push_back(static_cast<std::uint8_t>(term.plane));
        write_varint(out, zigzag(term.weight));
    }
    write_varint(out, zigzag(predictor.bias));
    if (near)
        for (int weight : predictor.weights) out.push_back(static_cast<std::uint8_t>(weight));
    out.push_back(static_cast<std::uint8_t>(coding.direct | coding.top << 4));
    out.push_back(static_cast<std::uint8_t>(coding.thresholds.size()));
    std::uint32_t before = 0;
    for (std::uint32_t threshold : coding.thresholds) {
        write_varint(out, threshold - before);
        before = threshold;
    }
}

Predictor read_predictor(Reader &in, const Plane &plane) {
    Predictor predictor;
    const unsigned flags = in.byte();
    if (flags >= 2 * kNear) throw Corrupt("it has unknown flags");
    predictor.guided = flags & kGuided;
    if (predictor.guided && !plane.columns) throw Corrupt("it has no plane to be guided by");
    int next = 0;
    std::int32_t sum = 0;
    for (unsigned i = 0; i < flags % kGuided; ++i) {
        const int index = in.byte();
        const std::int32_t weight = unzigzag(read_varint(in));
        if (index < next || index >= plane.prior_count)
            throw Corrupt("it refers to a plane that is not before it");
        if (weight == 0 || weight < -kMaxWeightSum || weight > kMaxWeightSum ||
            (sum += std::abs(weight)) > kMaxWeightSum)
            throw Corrupt("its weights are out of range");
        predictor.terms.push_back({index, weight});
        next = index + 1;
    }
    predictor.bias = unzigzag(read_varint(in));
    if (predictor.bias < -kMaxBias || predictor.bias > kMaxBias)
        throw Corrupt("its bias is out of range");
    if (flags & kNear)
        for (int &weight : predictor.weights) weight = static_cast<std::int8_t>(in.byte());
    return predictor;
}

Coding read_coding(Reader &in) {
    Coding coding;
    const unsigned division = in.byte();
    coding.direct = division & 15;
    coding.top = division >> 4;
    if (!Division{coding.direct, coding.top}.valid())
        throw Corrupt("its tokens are not divided as they may be");
    const unsigned count = in.byte();
    if (count >= kMaxContexts) throw Corrupt("it has too many contexts");
    std::uint32_t threshold = 0;
    for (unsigned i = 0; i < count; ++i) {
        const std::uint32_t step = read_varint(in);
        if (step == 0 || step > kMaxThreshold - threshold)
            throw Corrupt("its thresholds are out of range");
        coding.thresholds.push_back(threshold += step);
    }
    return coding;
}

void require(bool condition, const char *message) {
    if (!condition) throw std::invalid_argument(message);
}

void check(const Plane &plane, const Predictor &predictor) {
    require(!predictor.guided || plane.columns, "no plane to be guided by");
    require(predictor.terms.size() <= kMaxTerms, "too many terms");
    int next = 0;
    std::int64_t sum = 0;
    for (const auto &term : predictor.terms) {
        require(term.plane >= next && term.plane < plane.prior_count,
                "terms must be ascending prior planes");
        next = term.plane + 1;
        sum += std::abs(static_cast<std::int64_t>(term.weight));
        require(term.weight != 0 && sum <= kMaxWeightSum, "weights out of range");
    }
    require(predictor.bias >= -kMaxBias && predictor.bias <= kMaxBias, "bias out of range");
    for (int weight : predictor.weights)
        require(weight >= -128 && weight <= 127, "weights of neighbours out of range");
}

void check(const Coding &coding) {
    require(Division{coding.direct, coding.top}.valid(), "tokens cannot be divided like this");
    require(coding.thresholds.size() < kMaxContexts, "too many contexts");
    std::uint32_t before = 0;
    for (std::uint32_t threshold : coding.thresholds) {
        require(threshold > before && threshold <= kMaxThreshold, "thresholds must be ascending");
        before = threshold;
    }
}

using AllCounts = std::vector<Frequencies::Counts>;

AllCounts count_tokens(const std::int32_t *errors, const std::uint32_t *around, std::size_t count,
                       const Coding &coding) {
    const Division division{coding.direct, coding.top};
    const Contexts context_of(coding.thresholds);
    AllCounts counts(coding.thresholds.size() + 1);
    for (std::size_t i = 0; i < count; ++i)
        ++counts[context_of(around[i])][division.token_of(zigzag(errors[i]))];
    return counts;
}

}  // namespace

void follow(int width, int height, const std::uint16_t *guide, std::uint16_t *columns) {
    std::fill(columns, columns + width, std::uint16_t{0});
    for (int y = 1; y < height; ++y) {
        const std::uint16_t *const above = guide + static_cast<std::size_t>(y - 1) * width;
        const std::uint16_t *const row = above + width;
        int column = 0;
        for (int x = 0; x < width; ++x) {
            while (column + 1 < width && above[column + 1] <= row[x]) ++column;
            columns[static_cast<std::size_t>(y) * width + x] = static_cast<std::uint16_t>(column);
        }
    }
}

void predict(const Plane &plane, const Predictor &predictor, const std::uint16_t *samples,
             std::int32_t *errors, std::uint32_t *around) {
    check(plane, predictor);
    walk(
        plane, predictor,
        [&](std::size_t index, int prediction, std::uint32_t near) {
            around[index] = near;
            return errors[index] = samples[index] - prediction;
        },
        [] {});
}

double measure(const std::int32_t *errors, const std::uint32_t *around, std::size_t count,
               const Coding &coding) {
    check(coding);
    const auto table = token_table({coding.direct, coding.top});
    Writer head;
    Frequencies frequencies;
    double bits = 0;
    for (const auto &counts : count_tokens(errors, around, count, coding)) {
        frequencies.write(head, counts);
        bits += frequencies.cost(counts);
        for (unsigned token = 0; token < kMaxTokens; ++token)
            bits += 1.0 * counts[token] * table[token].bits;
    }
    return bits + static_cast<double>(head.bit_count());
}

std::vector<std::uint8_t> encode_context(const Plane &plane, const Predictor &predictor,
                                         const Coding &coding, const std::uint16_t *samples) {
    check(coding);
    std::vector<std::int32_t> errors(plane.samples());
    std::vector<std::uint32_t> around(plane.samples());
    predict(plane, predictor, samples, errors.data(), around.data());

    Writer out;
    write_head(out.head, predictor, coding);
    const AllCounts counts = count_tokens(errors.data(), around.data(), errors.size(), coding);
    std::vector<Frequencies> contexts(counts.size());
    for (std::size_t i = 0; i < counts.size(); ++i) contexts[i].write(out, counts[i]);
    const Division division{coding.direct, coding.top};
    const auto table = token_table(division);
    for (std::int32_t error : errors) {
        const std::uint32_t number = zigzag(error);
        const Token &token = table[division.token_of(number)];
        out.bits((number - token.base) >> 1, token.bits);
    }
    const Contexts context_of(coding.thresholds);
    for (std::size_t i = errors.size(); i-- > 0;) {
        const Frequencies &context = contexts[context_of(around[i])];
        const unsigned token = division.token_of(zigzag(errors[i]));
        out.retreat(context.start(token), context.frequency(token), kFrequencyBits);
    }
    return out.finish();
}

void decode_context(const Plane &plane, const std::uint8_t *data, std::size_t size,
                    std::uint16_t *samples) {
    Reader in(data, size, kHeadReads + plane.width);
    const Predictor predictor = read_predictor(in, plane);
    const Coding coding = read_coding(in);
    in.begin();
    std::vector<Frequencies> contexts(coding.thresholds.size() + 1);
    for (auto &context : contexts) context.read(in);
    const Contexts context_of(coding.thresholds);
    const auto table = token_table({coding.direct, coding.top});
    const int highest = (1 << plane.bits) - 1;
    walk(
        plane, predictor,
        [&](std::size_t index, int prediction, std::uint32_t around) {
            const Frequencies &context = contexts[context_of(around)];
            const std::uint32_t slot = in.state() & (kFrequencySum - 1);
            const unsigned token = context.token(slot);
            in.advance(context.frequency(token), kFrequencyBits, slot - context.start(token));
            const std::uint32_t number = table[token].base + 2 * in.bits(table[token].bits);
            const int error = unzigzag(number), sample = prediction + error;
            if (sample < 0 || sample > highest) throw Corrupt("a sample is out of range");
            samples[index] = static_cast<std::uint16_t>(sample);
            return error;
        },
        [&] { in.check(); });
    in.finish();
}

}  // namespace gsvr
