// Converts tiles of pixels to and from interleaved samples, a vector step at a time. Included by
// kernels.cpp.

// Calls body(x, row, red) for each vector step of each strip of a tile: pixels from column x on, in
// the rows of the step, which begin at `row`. The red of the first is at `red`, its green at red +
// kChannelFloats, then blue and the weight.
template <class Body>
static inline void for_steps_of_strips(const Pixels &pixels, Tile tile, Body body) {
    const std::ptrdiff_t strip = static_cast<std::ptrdiff_t>(pixels.rows) * kRowFloats;
    for (int row = tile.rows.begin; row < tile.rows.end; row += kVectorRows) {
        float *red = pixels.data + pixels.strip_offset(tile.columns.begin / kStripWidth) +
                     static_cast<std::ptrdiff_t>(row - pixels.first_row) * kRowFloats;
        for (int x = tile.columns.begin; x < tile.columns.end; x += kStripWidth, red += strip)
            body(x, row, red);
    }
}

// The number of a frame's pixel: of those before it, row by row.
static inline std::ptrdiff_t pixel_at(const Frame &frame, int x, int row) {
    return static_cast<std::ptrdiff_t>(row) * frame.width + x;
}

// The factor that turns sums into colours, from the sums of the weights.
static inline wide colour_factor(const Frame &frame, wide weight) {
    const wide one = 1.0f - wide{};
    return frame.mean ? one / (weight + kGround) : one;
}

// That of the pixels of a step, whose red begins at `red`.
static inline wide colour_factor(const Frame &frame, const float *red) {
    return colour_factor(frame, load_wide(red + 3 * kChannelFloats));
}

// Red, green and blue of the pixels of a step, 0 to 255.
struct StepCodes {
    wide_int channel[3];
};

static inline StepCodes to_codes(const Frame &frame, const float *red) {
    const wide factor = 255.0f * colour_factor(frame, red);
    StepCodes codes;
    for (int c = 0; c < 3; ++c) {
        const wide value = load_wide(red + c * kChannelFloats) * factor + 0.5f;
        codes.channel[c] = __builtin_convertvector(clamped(value, 255.5f), wide_int);
    }
    return codes;
}

constexpr int kRowBytes = 3 * kStripWidth;  // of a row of a strip, as interleaved samples

#if defined(__AVX2__)
// Stores the rows of a step as interleaved samples, which are `line` bytes apart.
static inline void store_rgb(std::uint8_t *out, std::ptrdiff_t line, const StepCodes &codes) {
    const auto put = [](std::uint8_t *p, __m256i row) {
        _mm_storeu_si128(reinterpret_cast<__m128i *>(p), _mm256_castsi256_si128(row));
        _mm_storel_epi64(reinterpret_cast<__m128i *>(p + 16), _mm256_extracti128_si256(row, 1));
    };
    // Each part of 16 bytes has four pixels: their reds, greens, blues, and the blues once more.
    const __m128i order = _mm_setr_epi8(0, 4, 8, 1, 5, 9, 2, 6, 10, 3, 7, 11, -1, -1, -1, -1);
#if GSVR_LANES == 16
    const __m512i r = (__m512i)codes.channel[0], g = (__m512i)codes.channel[1];
    const __m512i b = (__m512i)codes.channel[2];
    const __m512i planes =
        _mm512_packus_epi16(_mm512_packus_epi32(r, g), _mm512_packus_epi32(b, b));
    const __m512i parts = _mm512_shuffle_epi8(planes, _mm512_broadcast_i32x4(order));
    const __m512i rows = _mm512_permutexvar_epi32(
        _mm512_setr_epi32(0, 1, 2, 4, 5, 6, 7, 7, 8, 9, 10, 12, 13, 14, 15, 15), parts);
    put(out, _mm512_castsi512_si256(rows));
    put(out + line, _mm512_extracti64x4_epi64(rows, 1));
#else
    const __m256i r = (__m256i)codes.channel[0], g = (__m256i)codes.channel[1];
    const __m256i b = (__m256i)codes.channel[2];
    const __m256i planes =
        _mm256_packus_epi16(_mm256_packus_epi32(r, g), _mm256_packus_epi32(b, b));
    const __m256i parts = _mm256_shuffle_epi8(planes, _mm256_broadcastsi128_si256(order));
    static_cast<void>(line);
    put(out, _mm256_permutevar8x32_epi32(parts, _mm256_setr_epi32(0, 1, 2, 4, 5, 6, 7, 7)));
#endif
}

// Eight pixels of 32 bits each from 24 bytes. Red is in the lowest byte.
static inline i8 load_rgb(const std::uint8_t *in) {
    const __m128i a = _mm_loadu_si128(reinterpret_cast<const __m128i *>(in));
    const __m128i b = _mm_loadu_si128(reinterpret_cast<const __m128i *>(in + 8));
    return (i8)_mm256_set_m128i(
        _mm_shuffle_epi8(b,
                         _mm_setr_epi8(4, 5, 6, -1, 7, 8, 9, -1, 10, 11, 12, -1, 13, 14, 15, -1)),
        _mm_shuffle_epi8(a, _mm_setr_epi8(0, 1, 2, -1, 3, 4, 5, -1, 6, 7, 8, -1, 9, 10, 11, -1)));
}
#else
static inline void store_rgb(std::uint8_t *out, std::ptrdiff_t line, const StepCodes &codes) {
    for (int i = 0; i < kVectorRows * kStripWidth; ++i)
        for (int c = 0; c < 3; ++c)
            out[i / kStripWidth * line + i % kStripWidth * 3 + c] =
                static_cast<std::uint8_t>(codes.channel[c][i]);
}

static inline i8 load_rgb(const std::uint8_t *in) {
    i8 v;
    for (int i = 0; i < 8; ++i) v[i] = in[3 * i] | in[3 * i + 1] << 8 | in[3 * i + 2] << 16;
    return v;
}
#endif

void to_rgb8(Pixels pixels, const Frame &frame, Tile tile, std::uint8_t *out) {
    const std::ptrdiff_t line = static_cast<std::ptrdiff_t>(frame.width) * 3;
    for_steps_of_strips(pixels, tile, [&](int x, int row, const float *red) {
        const int rows = min(kVectorRows, tile.rows.end - row);
        const int samples = 3 * min(kStripWidth, tile.columns.end - x);
        const StepCodes codes = to_codes(frame, red);
        std::uint8_t *p = out + 3 * pixel_at(frame, x, row);
        if (rows == kVectorRows && samples == kRowBytes) {
            store_rgb(p, line, codes);
            return;
        }
        std::uint8_t bytes[kVectorRows * kRowBytes];
        store_rgb(bytes, kRowBytes, codes);
        for (int k = 0; k < rows; ++k)
            for (int i = 0; i < samples; ++i) p[k * line + i] = bytes[k * kRowBytes + i];
    });
}

void to_planes8(Pixels pixels, const Frame &frame, Tile tile, std::uint8_t *out) {
    typedef std::uint8_t wide_bytes __attribute__((vector_size(kVectorRows * kStripWidth)));
    const std::ptrdiff_t plane = static_cast<std::ptrdiff_t>(frame.width) * frame.height;
    for_steps_of_strips(pixels, tile, [&](int x, int row, const float *red) {
        const int rows = min(kVectorRows, tile.rows.end - row);
        const int samples = min(kStripWidth, tile.columns.end - x);
        const StepCodes codes = to_codes(frame, red);
        for (int c = 0; c < 3; ++c) {
            std::uint8_t bytes[kVectorRows * kStripWidth];
            const wide_bytes narrow = __builtin_convertvector(codes.channel[c], wide_bytes);
            __builtin_memcpy(bytes, &narrow, sizeof bytes);
            for (int k = 0; k < rows; ++k) {
                std::uint8_t *p = out + c * plane + pixel_at(frame, x, row + k);
                if (samples == kStripWidth)
                    __builtin_memcpy(p, bytes + k * kStripWidth, kStripWidth);
                else
                    for (int i = 0; i < samples; ++i) p[i] = bytes[k * kStripWidth + i];
            }
        }
    });
}

void to_float(Pixels pixels, const Frame &frame, Tile tile, float *out) {
    for_steps_of_strips(pixels, tile, [&](int x, int row, const float *red) {
        const wide factor = colour_factor(frame, red);
        for (int k = 0; k < min(kVectorRows, tile.rows.end - row); ++k) {
            float *p = out + 3 * pixel_at(frame, x, row + k);
            for (int i = 0; i < min(kStripWidth, tile.columns.end - x); ++i)
                for (int c = 0; c < 3; ++c) {
                    const int at = k * kStripWidth + i;
                    p[3 * i + c] = red[c * kChannelFloats + at] * factor[at];
                }
        }
    });
}

void to_sums(Pixels pixels, const Frame &frame, Tile tile, float *out) {
    for_steps_of_strips(pixels, tile, [&](int x, int row, const float *red) {
        for (int k = 0; k < min(kVectorRows, tile.rows.end - row); ++k) {
            float *p = out + kSums * pixel_at(frame, x, row + k);
            for (int i = 0; i < min(kStripWidth, tile.columns.end - x); ++i)
                for (int c = 0; c < kSums; ++c)
                    p[kSums * i + c] = red[c * kChannelFloats + k * kStripWidth + i];
        }
    });
}

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

void from_float(const float *weights, const Frame &frame, Tile tile, Pixels pixels) {
    for_steps_of_strips(pixels, tile, [&](int x, int row, float *red) {
        const int samples = min(kStripWidth, tile.columns.end - x);
        alignas(64) float planes[3][kVectorRows * kStripWidth] = {};
        for (int k = 0; k < min(kVectorRows, tile.rows.end - row); ++k) {
            const float *p = weights + 3 * pixel_at(frame, x, row + k);
            for (int i = 0; i < samples; ++i)
                for (int c = 0; c < 3; ++c) planes[c][k * kStripWidth + i] = p[3 * i + c];
        }
        const wide factor = colour_factor(frame, red);
        wide wanted[3], colours[3];
        for (int c = 0; c < 3; ++c) {
            colours[c] = load_wide(red + c * kChannelFloats) * factor;
            wanted[c] = load_wide(planes[c]);
        }
        store_gradient(frame, wanted, colours, factor, red);
    });
}

double residual(Pixels pixels, const Frame &frame, Tile tile, const std::uint8_t *target,
                float scale) {
    double total = 0.0;
    wide squares{};
    const int last_row = frame.height - 1;
    for_steps_of_strips(pixels, tile, [&](int x, int row, float *red) {
        const int samples = min(kStripWidth, tile.columns.end - x);
        i8 codes[kVectorRows] = {}, inside_row[kVectorRows] = {};
        for (int k = 0; k < min(kVectorRows, tile.rows.end - row); ++k) {
            const std::uint8_t *p = target + 3 * pixel_at(frame, x, row + k);
            // In a tile, rows are too short for the processor to fetch them ahead by itself.
            __builtin_prefetch(target + 3 * pixel_at(frame, x, min(row + k + 8, last_row)));
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
        const wide factor = colour_factor(frame, red);
        wide weights[3], colours[3];
        for (int c = 0; c < 3; ++c) {
            const wide sample =
                __builtin_convertvector((wanted >> (8 * c)) & 255, wide) * (1.0f / 255.0f);
            colours[c] = load_wide(red + c * kChannelFloats) * factor;
            const wide difference = (wide)((wide_int)(clamped(colours[c], 1.0f) - sample) & inside);
            weights[c] = difference * scale;
            squares += difference * difference;
        }
        store_gradient(frame, weights, colours, factor, red);
        // Single precision is exact enough for the sum of the rows of one step.
        if (x + kStripWidth >= tile.columns.end) {
            total += static_cast<double>(sum_wide(squares));
            squares = wide{};
        }
    });
    return total;
}
