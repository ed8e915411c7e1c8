// Converts rows of pixels to and from interleaved samples, eight pixels at a time. Included by
// kernels.cpp.

// Calls body(row, x, samples, red) for each row of each strip: `samples` pixels from column x on,
// with their red at `red`, green at red + kChannelFloats, then blue and the weight.
// `row` counts from rows.begin.
template <class Body>
static inline void for_strip_rows(const Pixels &pixels, const Frame &frame, RowRange rows,
                                  Body body) {
    const std::ptrdiff_t strip = static_cast<std::ptrdiff_t>(pixels.rows) * kRowFloats;
    for (int row = rows.begin; row < rows.end; row += kVectorRows) {
        float *step =
            pixels.data + static_cast<std::ptrdiff_t>(row - pixels.first_row) * kRowFloats;
        for (int x = 0; x < frame.width; x += kStripWidth, step += strip)
            for (int k = 0; k < min(kVectorRows, rows.end - row); ++k)
                body(row + k - rows.begin, x, min(kStripWidth, frame.width - x),
                     step + k * kStripWidth);
    }
}

// Converts eight pixels of 32 bits each to 24 bytes, and back. Red is in the lowest byte; the
// highest byte is ignored.
#if defined(__SSSE3__)
static inline void store_rgb(std::uint8_t *out, i8 rgbx) {
    const __m256i v = (__m256i)rgbx;
    const __m128i a = _mm256_castsi256_si128(v), b = _mm256_extracti128_si256(v, 1);
    const __m128i low =
        _mm_shuffle_epi8(a, _mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1));
    const __m128i high =
        _mm_shuffle_epi8(b, _mm_setr_epi8(-1, -1, -1, -1, 0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14));
    _mm_storeu_si128(reinterpret_cast<__m128i *>(out), low);
    _mm_storeu_si128(reinterpret_cast<__m128i *>(out + 8),
                     _mm_or_si128(high, _mm_srli_si128(low, 8)));
}

static inline i8 load_rgb(const std::uint8_t *in) {
    const __m128i a = _mm_loadu_si128(reinterpret_cast<const __m128i *>(in));
    const __m128i b = _mm_loadu_si128(reinterpret_cast<const __m128i *>(in + 8));
    return (i8)_mm256_set_m128i(
        _mm_shuffle_epi8(b,
                         _mm_setr_epi8(4, 5, 6, -1, 7, 8, 9, -1, 10, 11, 12, -1, 13, 14, 15, -1)),
        _mm_shuffle_epi8(a, _mm_setr_epi8(0, 1, 2, -1, 3, 4, 5, -1, 6, 7, 8, -1, 9, 10, 11, -1)));
}
#else
static inline void store_rgb(std::uint8_t *out, i8 rgbx) {
    for (int i = 0; i < 8; ++i)
        for (int c = 0; c < 3; ++c) out[3 * i + c] = static_cast<std::uint8_t>(rgbx[i] >> (8 * c));
}

static inline i8 load_rgb(const std::uint8_t *in) {
    i8 v;
    for (int i = 0; i < 8; ++i) v[i] = in[3 * i] | in[3 * i + 1] << 8 | in[3 * i + 2] << 16;
    return v;
}
#endif

static inline i8 to_codes(v8 value) {
    return __builtin_convertvector(clamped(value) * 255.0f + 0.5f, i8);
}

// The factor that turns sums into colours, from the sums of the weights.
template <class Vector>
static inline Vector colour_factor(const Frame &frame, Vector weight) {
    const Vector one = 1.0f - Vector{};
    return frame.mean ? one / (weight + kGround) : one;
}

// That of eight pixels.
static inline v8 sums_to_colours(const Frame &frame, const float *red) {
    return colour_factor(frame, load8(red + 3 * kChannelFloats));
}

// Converts eight pixels to interleaved samples.
static inline void store_samples(std::uint8_t *out, const Frame &frame, const float *red) {
    const v8 factor = sums_to_colours(frame, red);
    store_rgb(out, to_codes(load8(red) * factor) |
                       to_codes(load8(red + kChannelFloats) * factor) << 8 |
                       to_codes(load8(red + 2 * kChannelFloats) * factor) << 16);
}

void to_rgb8(Pixels pixels, const Frame &frame, RowRange rows, std::uint8_t *out) {
    const std::ptrdiff_t line = static_cast<std::ptrdiff_t>(frame.width) * 3;
    const std::ptrdiff_t strip = static_cast<std::ptrdiff_t>(pixels.rows) * kRowFloats;
    for (int row = rows.begin; row < rows.end; row += kVectorRows, out += kVectorRows * line) {
        const float *red =
            pixels.data + static_cast<std::ptrdiff_t>(row - pixels.first_row) * kRowFloats;
        const int row_count = min(kVectorRows, rows.end - row);
        std::uint8_t *p = out;
        for (int x = 0; x < frame.width; x += kStripWidth, red += strip, p += 3 * kStripWidth) {
            const int samples = 3 * min(kStripWidth, frame.width - x);
            if (row_count == kVectorRows && samples == 3 * kStripWidth) {
                // The usual case, as a loop of constant length, which the compiler unrolls.
                for (int k = 0; k < kVectorRows; ++k)
                    store_samples(p + k * line, frame, red + k * kStripWidth);
                continue;
            }
            for (int k = 0; k < row_count; ++k) {
                std::uint8_t bytes[3 * kStripWidth];
                store_samples(bytes, frame, red + k * kStripWidth);
                for (int i = 0; i < samples; ++i) p[k * line + i] = bytes[i];
            }
        }
    }
}

// Converts eight pixels of one channel to samples.
static inline void store_plane(std::uint8_t *out, v8 channel) {
    typedef std::uint8_t b8 __attribute__((vector_size(8)));
    const b8 codes = __builtin_convertvector(to_codes(channel), b8);
    __builtin_memcpy(out, &codes, sizeof codes);
}

void to_planes8(Pixels pixels, const Frame &frame, RowRange rows, std::uint8_t *out) {
    const std::ptrdiff_t plane = static_cast<std::ptrdiff_t>(frame.width) * frame.height;
    for_strip_rows(pixels, frame, rows, [&](int row, int x, int samples, const float *red) {
        std::uint8_t *p = out + static_cast<std::ptrdiff_t>(row) * frame.width + x;
        const v8 factor = sums_to_colours(frame, red);
        for (int c = 0; c < 3; ++c, p += plane) {
            const v8 value = load8(red + c * kChannelFloats) * factor;
            if (samples == kStripWidth) {
                store_plane(p, value);
                continue;
            }
            std::uint8_t bytes[kStripWidth];
            store_plane(bytes, value);
            for (int i = 0; i < samples; ++i) p[i] = bytes[i];
        }
    });
}

void to_float(Pixels pixels, const Frame &frame, RowRange rows, float *out) {
    for_strip_rows(pixels, frame, rows, [&](int row, int x, int samples, const float *red) {
        float *p = out + (static_cast<std::ptrdiff_t>(row) * frame.width + x) * 3;
        const v8 factor = sums_to_colours(frame, red);
        for (int i = 0; i < samples; ++i)
            for (int c = 0; c < 3; ++c) p[3 * i + c] = red[c * kChannelFloats + i] * factor[i];
    });
}

void to_sums(Pixels pixels, const Frame &frame, RowRange rows, float *out) {
    for_strip_rows(pixels, frame, rows, [&](int row, int x, int samples, const float *red) {
        float *p = out + (static_cast<std::ptrdiff_t>(row) * frame.width + x) * kSums;
        for (int i = 0; i < samples; ++i)
            for (int c = 0; c < kSums; ++c) p[kSums * i + c] = red[c * kChannelFloats + i];
    });
}

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
static inline wide clamped(wide v) { return min(max(v, wide{}), 1.0f - wide{}); }
static inline float sum_wide(wide v) { return sum(v); }
#else
typedef v8 wide;
typedef i8 wide_int;
static inline wide_int joined(const i8 *rows) { return rows[0]; }
static inline wide load_wide(const float *p) { return load8(p); }
static inline void store_wide(float *p, wide v) { store8(p, v); }
static inline float sum_wide(wide v) { return sum8(v); }
#endif

// Replaces the sums of pixels by the gradient of sum(weights * colours), where `weights` are of
// red, green and blue, and `colours` and `factor` those of the pixels.
static inline void store_gradient(const Frame &frame, const wide *weights, const wide *colours,
                                  wide factor, float *red) {
    wide of_weight{};
    for (int c = 0; c < 3; ++c) {
        const wide gradient = weights[c] * factor;
        store_wide(red + c * kChannelFloats, gradient);
        of_weight -= gradient * colours[c];
    }
    store_wide(red + 3 * kChannelFloats, frame.mean ? of_weight : wide{});
}

// Calls body(x, first, red) for each vector step of each strip: pixels from column x on in the rows
// of the step, which begin at `first`, counted from rows.begin; the red of the first is at `red`.
template <class Body>
static inline void for_steps_of_strips(const Pixels &pixels, const Frame &frame, RowRange rows,
                                       Body body) {
    const std::ptrdiff_t strip = static_cast<std::ptrdiff_t>(pixels.rows) * kRowFloats;
    for (int row = rows.begin; row < rows.end; row += kVectorRows) {
        float *red = pixels.data + static_cast<std::ptrdiff_t>(row - pixels.first_row) * kRowFloats;
        for (int x = 0; x < frame.width; x += kStripWidth, red += strip)
            body(x, row - rows.begin, red);
    }
}

void from_float(const float *weights, const Frame &frame, RowRange rows, Pixels pixels) {
    for_steps_of_strips(pixels, frame, rows, [&](int x, int first, float *red) {
        const int samples = min(kStripWidth, frame.width - x);
        alignas(64) float planes[3][kVectorRows * kStripWidth] = {};
        for (int k = 0; k < min(kVectorRows, rows.end - rows.begin - first); ++k) {
            const float *p =
                weights + (static_cast<std::ptrdiff_t>(first + k) * frame.width + x) * 3;
            for (int i = 0; i < samples; ++i)
                for (int c = 0; c < 3; ++c) planes[c][k * kStripWidth + i] = p[3 * i + c];
        }
        const wide factor = colour_factor(frame, load_wide(red + 3 * kChannelFloats));
        wide wanted[3], colours[3];
        for (int c = 0; c < 3; ++c) {
            colours[c] = load_wide(red + c * kChannelFloats) * factor;
            wanted[c] = load_wide(planes[c]);
        }
        store_gradient(frame, wanted, colours, factor, red);
    });
}

double residual(Pixels pixels, const Frame &frame, RowRange rows, const std::uint8_t *target,
                float scale) {
    double total = 0.0;
    wide squares{};
    for_steps_of_strips(pixels, frame, rows, [&](int x, int first, float *red) {
        const int samples = min(kStripWidth, frame.width - x);
        i8 codes[kVectorRows] = {}, inside_row[kVectorRows] = {};
        for (int k = 0; k < min(kVectorRows, rows.end - rows.begin - first); ++k) {
            const std::uint8_t *p =
                target + (static_cast<std::ptrdiff_t>(first + k) * frame.width + x) * 3;
            if (samples == kStripWidth) {
                codes[k] = load_rgb(p);
                inside_row[k] = ~i8{};
                continue;
            }
            // Pixels beyond the frame get the residual 0.
            std::uint8_t bytes[3 * kStripWidth] = {};
            for (int i = 0; i < 3 * samples; ++i) bytes[i] = p[i];
            for (int i = 0; i < samples; ++i) inside_row[k][i] = -1;
            codes[k] = load_rgb(bytes);
        }
        const wide_int wanted = joined(codes), inside = joined(inside_row);
        const wide factor = colour_factor(frame, load_wide(red + 3 * kChannelFloats));
        wide weights[3], colours[3];
        for (int c = 0; c < 3; ++c) {
            const wide sample =
                __builtin_convertvector((wanted >> (8 * c)) & 255, wide) * (1.0f / 255.0f);
            colours[c] = load_wide(red + c * kChannelFloats) * factor;
            const wide difference = (wide)((wide_int)(clamped(colours[c]) - sample) & inside);
            weights[c] = difference * scale;
            squares += difference * difference;
        }
        store_gradient(frame, weights, colours, factor, red);
        // Single precision is exact enough for the sum of the rows of one step.
        if (x + kStripWidth >= frame.width) {
            total += static_cast<double>(sum_wide(squares));
            squares = wide{};
        }
    });
    return total;
}
