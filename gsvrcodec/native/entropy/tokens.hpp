// Prediction errors as tokens and plain bits, and the frequencies of tokens (spec section "Codec
// 4").
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "rans.hpp"

namespace gsvr {

inline constexpr unsigned kMaxTokens = 256;
inline constexpr unsigned kFrequencyBits = 12;
inline constexpr std::uint32_t kFrequencySum = 1u << kFrequencyBits;

// The division of zigzag numbers into tokens. Each number below 2^direct has its own token. The
// numbers above share a token if they have the same highest set bit, the same `top` bits below it,
// and the same lowest bit.
struct Division {
    unsigned direct, top;
    bool valid() const { return top <= 2 && direct > top && direct <= 7; }

    unsigned token_of(std::uint32_t number) const {
        if (number >> direct == 0) return number;
        unsigned octave = 0;
        while (number >> (octave + direct + 1)) ++octave;
        const unsigned high = number >> (octave + direct - top) & ((1u << top) - 1);
        return (1u << direct) + (octave << (top + 1)) + 2 * high + (number & 1);
    }
};

// A token stands for 2^bits zigzag numbers: base, base + 2, base + 4, ... Plain bits select one.
struct Token {
    std::uint32_t base;
    unsigned bits;
};
using TokenTable = std::array<Token, kMaxTokens>;

// Zigzag numbers have at most 17 bits. Tokens beyond them stand for 2^20, which is never a valid
// error.
inline TokenTable token_table(const Division &division) {
    TokenTable table;
    table.fill({1u << 20, 0});
    for (unsigned token = 0; token < kMaxTokens; ++token) {
        if (token >> division.direct == 0) {
            table[token] = {token, 0};
            continue;
        }
        const unsigned rest = token - (1u << division.direct);
        const unsigned octave = rest >> (division.top + 1);
        const unsigned high = rest >> 1 & ((1u << division.top) - 1);
        const unsigned bits = octave + division.direct - division.top - 1;
        if (bits > 16) break;
        table[token] = {((1u << division.top) + high) << (bits + 1) | (rest & 1), bits};
    }
    return table;
}

// The frequencies of the tokens of one context, in slots of 2^kFrequencyBits.
class Frequencies {
   public:
    using Counts = std::array<std::uint32_t, kMaxTokens>;

    // Throws Corrupt if the frequencies are not valid.
    void read(Reader &in) {
        const unsigned count = in.bits(8) + 1;
        std::array<std::uint8_t, kMaxTokens> levels{};
        for (unsigned token = 0; token < count; ++token) {
            unsigned high = 0;
            while (in.bits(1)) {
                in.check();
                if (++high > kMaxLevel) throw Corrupt("a level of a token is too long");
            }
            const int change = unzigzag(high << 1 | in.bits(1));
            const int level = (token < 2 ? 0 : levels[token - 2]) + change;
            if (level < 0 || level > kMaxLevel) throw Corrupt("a level of a token is out of range");
            levels[token] = static_cast<std::uint8_t>(level);
            in.check();
        }
        set(levels);
    }

    // Writes frequencies for read(); each token with a count gets at least one slot.
    void write(Writer &out, Counts counts) {
        if (std::all_of(counts.begin(), counts.end(), [](auto count) { return !count; }))
            counts[0] = 1;
        std::uint64_t total = 0;
        unsigned used = 1;
        for (unsigned token = 0; token < kMaxTokens; ++token) {
            total += counts[token];
            if (counts[token]) used = token + 1;
        }
        std::array<std::uint8_t, kMaxTokens> levels{};
        out.bits(used - 1, 8);
        for (unsigned token = 0; token < used; ++token) {
            levels[token] = static_cast<std::uint8_t>(level_of(counts[token], total));
            const int change = levels[token] - (token < 2 ? 0 : levels[token - 2]);
            const std::uint32_t coded = zigzag(change);
            for (unsigned i = 0; i < coded >> 1; ++i) out.bits(1, 1);
            out.bits(coded & 1, 2);
        }
        set(levels);
    }

    // The size in bits of tokens with these counts.
    double cost(const Counts &counts) const {
        double bits = 0;
        for (unsigned token = 0; token < kMaxTokens; ++token)
            if (counts[token])
                bits += counts[token] * (kFrequencyBits - std::log2(double(frequency(token))));
        return bits;
    }

    std::uint32_t start(unsigned token) const { return intervals_[token] & 0xffff; }
    std::uint32_t frequency(unsigned token) const { return intervals_[token] >> 16; }
    unsigned token(std::uint32_t slot) const { return slots_[slot]; }

   private:
    static constexpr int kMaxLevel = 49;

    // The weight by which a token shares the slots beyond the first one of each token. Level 0: the
    // token does not occur; level 1: the token has only its first slot.
    static std::uint32_t weight(int level) {
        return level < 2 ? 0 : static_cast<std::uint32_t>(4 + (level - 2) % 4) << ((level - 2) / 4);
    }

    static int level_of(std::uint32_t count, std::uint64_t total) {
        if (!count) return 0;
        const double wanted = 4 * (static_cast<double>(kFrequencySum) * count / total - 1);
        int level = 1;
        while (level < kMaxLevel && weight(level) + weight(level + 1) <= 2 * wanted) ++level;
        return level;
    }

    void set(const std::array<std::uint8_t, kMaxTokens> &levels) {
        std::uint32_t sum = 0, used = 0;
        unsigned largest = 0;
        for (unsigned token = 0; token < kMaxTokens; ++token) {
            sum += weight(levels[token]);
            used += levels[token] > 0;
            if (levels[token] > levels[largest]) largest = token;
        }
        if (!used) throw Corrupt("none of its tokens may occur");
        std::array<std::uint32_t, kMaxTokens> frequencies{};
        std::uint32_t rest = kFrequencySum;
        for (unsigned token = 0; token < kMaxTokens; ++token) {
            if (!levels[token]) continue;
            const std::uint32_t share = weight(levels[token]) * (kFrequencySum - used);
            frequencies[token] = 1 + share / std::max(sum, 1u);
            rest -= frequencies[token];
        }
        frequencies[largest] += rest;
        std::uint32_t begin = 0;
        for (unsigned token = 0; token < kMaxTokens; ++token) {
            intervals_[token] = frequencies[token] << 16 | begin;
            const auto at = slots_.begin() + begin;
            std::fill(at, at + frequencies[token], static_cast<std::uint8_t>(token));
            begin += frequencies[token];
        }
    }

    std::array<std::uint8_t, kFrequencySum> slots_;
    std::array<std::uint32_t, kMaxTokens> intervals_;
};

}  // namespace gsvr
