// Converts rows of pixels to and from interleaved samples, eight pixels at a time. Included by
// kernels.cpp.

// Calls body(row, x, samples, red) for each row of each strip: `samples` pixels from column x on,
// with their red at `red`, green at red + kChannelFloats and blue at red + 2 * kChannelFloats.
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

// Converts eight pixels to interleaved samples.
static inline void store_samples(std::uint8_t *out, const float *red) {
    store_rgb(out, to_codes(load8(red)) | to_codes(load8(red + kChannelFloats)) << 8 |
                       to_codes(load8(red + 2 * kChannelFloats)) << 16);
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
                    store_samples(p + k * line, red + k * kStripWidth);
                continue;
            }
            for (int k = 0; k < row_count; ++k) {
                std::uint8_t bytes[3 * kStripWidth];
                store_samples(bytes, red + k * kStripWidth);
                for (int i = 0; i < samples; ++i) p[k * line + i] = bytes[i];
            }
        }
    }
}

// Converts eight pixels of one channel to samples.
static inline void store_plane(std::uint8_t *out, const float *channel) {
    typedef std::uint8_t b8 __attribute__((vector_size(8)));
    const b8 codes = __builtin_convertvector(to_codes(load8(channel)), b8);
    __builtin_memcpy(out, &codes, sizeof codes);
}

void to_planes8(Pixels pixels, const Frame &frame, RowRange rows, std::uint8_t *out) {
    const std::ptrdiff_t plane = static_cast<std::ptrdiff_t>(frame.width) * frame.height;
    for_strip_rows(pixels, frame, rows, [&](int row, int x, int samples, const float *red) {
        std::uint8_t *p = out + static_cast<std::ptrdiff_t>(row) * frame.width + x;
        for (int c = 0; c < 3; ++c, p += plane, red += kChannelFloats) {
            if (samples == kStripWidth) {
                store_plane(p, red);
                continue;
            }
            std::uint8_t bytes[kStripWidth];
            store_plane(bytes, red);
            for (int i = 0; i < samples; ++i) p[i] = bytes[i];
        }
    });
}

void to_float(Pixels pixels, const Frame &frame, RowRange rows, float *out) {
    for_strip_rows(pixels, frame, rows, [&](int row, int x, int samples, const float *red) {
        float *p = out + (static_cast<std::ptrdiff_t>(row) * frame.width + x) * 3;
        for (int i = 0; i < samples; ++i)
            for (int c = 0; c < 3; ++c) p[3 * i + c] = red[c * kChannelFloats + i];
    });
}

void from_float(const float *in, const Frame &frame, RowRange rows, Pixels pixels) {
    const int padded = (rows.end + kVectorRows - 1) / kVectorRows * kVectorRows;
    for_strip_rows(
        pixels, frame, {rows.begin, padded}, [&](int row, int x, int samples, float *red) {
            const float *p = in + (static_cast<std::ptrdiff_t>(row) * frame.width + x) * 3;
            if (row >= rows.end - rows.begin) samples = 0;
            for (int i = 0; i < kStripWidth; ++i)
                for (int c = 0; c < 3; ++c)
                    red[c * kChannelFloats + i] = i < samples ? p[3 * i + c] : 0.0f;
        });
}

double residual(Pixels pixels, const Frame &frame, RowRange rows, const std::uint8_t *target,
                const float *backdrop, float scale) {
    double total = 0.0;
    const int padded = (rows.end + kVectorRows - 1) / kVectorRows * kVectorRows;
    v8 squares{};
    for_strip_rows(
        pixels, frame, {rows.begin, padded}, [&](int row, int x, int samples, float *red) {
            const std::ptrdiff_t first = (static_cast<std::ptrdiff_t>(row) * frame.width + x) * 3;
            const std::uint8_t *p = target + first;
            if (row >= rows.end - rows.begin) samples = 0;
            i8 wanted{}, inside{};
            if (samples == kStripWidth) {
                wanted = load_rgb(p);
                inside = ~inside;
            } else {
                // Pixels beyond the frame get the residual 0.
                std::uint8_t bytes[3 * kStripWidth] = {};
                for (int i = 0; i < 3 * samples; ++i) bytes[i] = p[i];
                for (int i = 0; i < samples; ++i) inside[i] = -1;
                wanted = load_rgb(bytes);
            }
            for (int c = 0; c < 3; ++c, red += kChannelFloats) {
                const v8 sample =
                    __builtin_convertvector((wanted >> (8 * c)) & 255, v8) * (1.0f / 255.0f);
                v8 value = load8(red);
                if (backdrop)
                    for (int i = 0; i < samples; ++i) value[i] += backdrop[first + 3 * i + c];
                const v8 difference = (v8)((i8)(clamped(value) - sample) & inside);
                store8(red, difference * scale);
                squares += difference * difference;
            }
            // Single precision is exact enough for the sum of one row.
            if (x + kStripWidth >= frame.width) {
                total += static_cast<double>(sum8(squares));
                squares = v8{};
            }
        });
    return total;
}
