// What lies behind the splats of a tile, a vector step of a strip at a time. Included by
// kernels.cpp.

// The pixels of a strip in one vector step, as wide as registers are: their rows follow each other.
#if GSVR_LANES == 16
typedef vf wide;
typedef vi wide_int;
static inline wide_int joined(const i8 *rows) {
    return __builtin_shufflevector(rows[0], rows[1], 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13,
                                   14, 15);
}
static inline wide load_wide(const float *p) { return load(p); }
static inline void store_wide(float *p, wide v) { store(p, v); }
static inline wide clamped(wide v, float most) { return min(max(v, wide{}), most - wide{}); }
static inline float sum_wide(wide v) { return sum(v); }
#else
typedef v8 wide;
typedef i8 wide_int;
static inline wide_int joined(const i8 *rows) { return rows[0]; }
static inline wide load_wide(const float *p) { return load8(p); }
static inline void store_wide(float *p, wide v) { store8(p, v); }
static inline float sum_wide(wide v) { return sum8(v); }
#endif

// The first pixel of a row of a strip, red.
static inline float *strip_row(const Pixels &pixels, int strip, int row) {
    const unsigned down = static_cast<unsigned>(row - pixels.first_row);
    return pixels.data + pixels.strip_offset(strip) + down / kVectorRows * kStepFloats +
           down % kVectorRows * kStripWidth;
}

// A strip of what lies behind, from a row on that a vector step begins with.
class NothingBehind {
   public:
    NothingBehind(Base, int, int) {}
    // Loads the sums of the pixels of a step: red, green, blue and the weight.
    void read(int, wide *sums) const {
        for (int c = 0; c < kSums; ++c) sums[c] = wide{};
    }
};

class PixelsBehind {
   public:
    PixelsBehind(Base base, int strip, int row)
        : first_(strip_row(*base.pixels, strip, row)),
          pair_(2 * static_cast<std::ptrdiff_t>(base.pixels->rows) * kRowFloats) {}
    void read(int step, wide *sums) const {
        const float *p = first_ + step * kStepFloats;
        for (int c = 0; c < kSums; ++c) {
            sums[c] = load_wide(p + c * kChannelFloats);
            // The next strips, which no processor foresees.
            __builtin_prefetch(p + pair_ + c * kChannelFloats);
        }
    }

   private:
    const float *first_;
    const std::ptrdiff_t pair_;
};

class PlateBehind {
   public:
    PlateBehind(Base base, int strip, int row)
        : line_(base.plate->line),
          plane_(base.plate->plane),
          first_(base.plate->y + row * line_ + static_cast<std::ptrdiff_t>(strip) * kStripWidth) {}
    // Spec section "Plate": the colours of full range, of which 1 is white.
    void read(int step, wide *sums) const {
        constexpr float kWhite = 255.0f;
        const std::uint8_t *p = first_ + step * kVectorRows * line_;
        const wide y = codes(p) * (1.0f / kWhite);
        const wide cb = codes(p + plane_) - 128.0f, cr = codes(p + 2 * plane_) - 128.0f;
        sums[0] = y + cr * (1.402f / kWhite);
        sums[1] = y - cb * (0.344136f / kWhite) - cr * (0.714136f / kWhite);
        sums[2] = y + cb * (1.772f / kWhite);
        sums[3] = kPlateWeight - wide{};
    }

   private:
    wide codes(const std::uint8_t *p) const {
#if GSVR_LANES == 16
        const __m128i rows = _mm_unpacklo_epi64(load_codes(p), load_codes(p + line_));
        return to_float((vi)_mm512_cvtepu8_epi32(rows));
#elif defined(__AVX2__)
        return to_float((vi)_mm256_cvtepu8_epi32(load_codes(p)));
#else
        wide codes;
        for (int i = 0; i < kStripWidth; ++i) codes[i] = p[i];
        return codes;
#endif
    }
#if defined(__AVX2__)
    static __m128i load_codes(const std::uint8_t *p) {
        return _mm_loadl_epi64(reinterpret_cast<const __m128i *>(p));
    }
#endif

    const std::ptrdiff_t line_, plane_;
    const std::uint8_t *const first_;
};

void from_plate(const PlateCodes &plate, Tile tile, Pixels pixels) {
    const int first = tile.rows.begin;
    for (int x = tile.columns.begin; x < tile.columns.end; x += kStripWidth) {
        const PlateBehind behind({nullptr, &plate}, x / kStripWidth, first);
        float *p = strip_row(pixels, x / kStripWidth, first);
        for (int row = first, step = 0; row < tile.rows.end; row += kVectorRows, ++step) {
            wide sums[kSums];
            behind.read(step, sums);
            for (int c = 0; c < kSums; ++c) store_wide(p + c * kChannelFloats, sums[c]);
            p += kStepFloats;
        }
    }
}
