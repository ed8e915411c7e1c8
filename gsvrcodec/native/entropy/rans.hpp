// The range coder of plane codecs 4 and 5 (spec section "Range coder"): rANS with a 32-bit state,
// renormalised by 16-bit words. Plain bits, which are not entropy coded, are stored from the end of
// the stream backwards.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace gsvr {

struct Corrupt : std::runtime_error {
    using std::runtime_error::runtime_error;
};

inline constexpr std::uint32_t kStateLow = 1u << 16;

// Reads a stream: the bytes of the head and then the words of the coder from the front, plain bits
// from the back. Reads beyond the ends of the stream return zeros, and the next check() throws.
class Reader {
   public:
    // `unchecked` is the largest number of calls of word(), advance() and bits() between two
    // checks.
    Reader(const std::uint8_t *data, std::size_t size, std::size_t unchecked)
        : buffer_(2 * (4 + 2 * unchecked) + size), front_(4 + 2 * unchecked), end_(front_ + size) {
        std::copy(data, data + size, buffer_.begin() + static_cast<std::ptrdiff_t>(front_));
    }

    std::uint8_t byte() {
        if (front_ == end_) throw Corrupt("it is cut short in its head");
        return buffer_[front_++];
    }

    std::uint32_t word() {
        const std::uint32_t value = buffer_[front_] | buffer_[front_ + 1] << 8;
        front_ += 2;
        return value;
    }

    // The next `count` plain bits, at most 16, the most significant first.
    std::uint32_t bits(unsigned count) {
        const std::uint8_t *last = buffer_.data() + end_ - (position_ >> 3) - 4;
        const std::uint32_t window =
            last[0] | last[1] << 8 | last[2] << 16 | static_cast<std::uint32_t>(last[3]) << 24;
        const std::uint32_t top = window << (position_ & 7);
        position_ += count;
        return (top >> 1) >> (31 - count);
    }

    void check() const {
        if (front_ + ((position_ + 7) >> 3) > end_) throw Corrupt("it is cut short");
    }

    void begin() {
        state_ = word();
        state_ |= word() << 16;
        check();
        if (state_ < kStateLow) throw Corrupt("its coder starts below its range");
    }

    std::uint32_t state() const { return state_; }

    // Decodes a symbol that has `frequency` of the 2^bits slots; `offset` is the slot of the state,
    // counted from the first slot of the symbol.
    void advance(std::uint32_t frequency, unsigned bits, std::uint32_t offset) {
        state_ = frequency * (state_ >> bits) + offset;
        // Renormalises without a branch: the processor could not predict the
        // branch.
        const std::uint32_t low = state_ < kStateLow;
        const std::uint32_t next = buffer_[front_] | buffer_[front_ + 1] << 8;
        front_ += 2 * low;
        state_ = low ? state_ << 16 | next : state_;
    }

    // Throws unless all bytes are used, the padding bits are zero, and the state is the one that
    // the writer started from.
    void finish() {
        check();
        const unsigned unused = static_cast<unsigned>(-position_ & 7);
        if (bits(unused)) throw Corrupt("its last bits are not zero");
        if (front_ + (position_ >> 3) != end_) throw Corrupt("it goes on after its last sample");
        if (state_ != kStateLow) throw Corrupt("its coder does not end where it must");
    }

   private:
    std::vector<std::uint8_t> buffer_;
    std::size_t front_, end_;
    std::size_t position_ = 0;
    std::uint32_t state_ = 0;
};

// Writes a stream for Reader. Symbols must be given from the last to the first, plain bits from the
// first to the last.
class Writer {
   public:
    std::vector<std::uint8_t> head;

    void bits(std::uint32_t value, unsigned count) {
        for (unsigned i = count; i-- > 0;) {
            if (used_ % 8 == 0) bits_.push_back(0);
            bits_.back() |= static_cast<std::uint8_t>((value >> i & 1) << (7 - used_ % 8));
            ++used_;
        }
    }

    // Encodes a symbol that has the slots [start, start + frequency) of 2^bits.
    void retreat(std::uint32_t start, std::uint32_t frequency, unsigned bits) {
        // In 64 bits: the bound is 2^32 for a symbol that has all slots.
        if (state_ >= static_cast<std::uint64_t>(frequency) << (32 - bits)) {
            words_.push_back(static_cast<std::uint16_t>(state_));
            state_ >>= 16;
        }
        state_ = (state_ / frequency << bits) + state_ % frequency + start;
    }

    std::size_t bit_count() const { return used_; }

    std::vector<std::uint8_t> finish() {
        std::vector<std::uint8_t> out = head;
        for (unsigned shift = 0; shift < 32; shift += 8)
            out.push_back(static_cast<std::uint8_t>(state_ >> shift));
        for (std::size_t i = words_.size(); i-- > 0;) {
            out.push_back(static_cast<std::uint8_t>(words_[i]));
            out.push_back(static_cast<std::uint8_t>(words_[i] >> 8));
        }
        out.insert(out.end(), bits_.rbegin(), bits_.rend());
        return out;
    }

   private:
    std::vector<std::uint16_t> words_;
    std::vector<std::uint8_t> bits_;
    std::size_t used_ = 0;
    std::uint32_t state_ = kStateLow;
};

// Unsigned numbers in the head of a stream: varints (see the spec) of at most 32 bits.
inline std::uint32_t read_varint(Reader &in) {
    std::uint32_t value = 0;
    for (unsigned shift = 0; shift < 35; shift += 7) {
        const std::uint8_t byte = in.byte();
        const std::uint32_t group = byte & 0x7f;
        if (shift == 28 && group > 0xf) break;
        value |= group << shift;
        if (byte < 0x80) {
            if (byte == 0 && shift) break;
            return value;
        }
    }
    throw Corrupt("a number of its head is too long");
}

inline void write_varint(std::vector<std::uint8_t> &out, std::uint32_t value) {
    for (; value >= 0x80; value >>= 7) out.push_back(static_cast<std::uint8_t>(value | 0x80));
    out.push_back(static_cast<std::uint8_t>(value));
}

inline std::uint32_t zigzag(std::int32_t value) {
    return static_cast<std::uint32_t>(value) << 1 ^ (value < 0 ? 0xffffffffu : 0u);
}

inline std::int32_t unzigzag(std::uint32_t value) {
    return static_cast<std::int32_t>(value >> 1 ^ (value & 1 ? 0xffffffffu : 0u));
}

}  // namespace gsvr
