// Rows of the strips of a band to and from interleaved samples. Included by kernels.cpp.

static inline float clamped(float v) { return min(max(v, 0.0f), 1.0f); }

// Calls body(x, samples, red): `samples` pixels from x on, the first one's red at `red`, its green
// and blue kStripWidth and 2 * kStripWidth floats on.
template <class Pixels, class Body>
static inline void for_strips(Pixels *row, const Frame &frame, int strip_rows, Body body) {
    for (int x = 0; x < frame.width; x += kStripWidth, row += strip_rows * kRowFloats)
        body(x, min(kStripWidth, frame.width - x), row);
}

void row_to_rgb8(const float *row, const Frame &frame, int strip_rows, std::uint8_t *out) {
    for_strips(row, frame, strip_rows, [&](int x, int samples, const float *red) {
        std::uint8_t codes[kRowFloats];
        for (int i = 0; i < kRowFloats; ++i)
            codes[i] = static_cast<std::uint8_t>(static_cast<int>(clamped(red[i]) * 255.0f + 0.5f));
        std::uint8_t *p = out + 3 * x;
        for (int i = 0; i < samples; ++i)
            for (int c = 0; c < 3; ++c) p[3 * i + c] = codes[c * kStripWidth + i];
    });
}

void row_to_float(const float *row, const Frame &frame, int strip_rows, float *out) {
    for_strips(row, frame, strip_rows, [&](int x, int samples, const float *red) {
        for (int i = 0; i < samples; ++i)
            for (int c = 0; c < 3; ++c) out[3 * (x + i) + c] = red[c * kStripWidth + i];
    });
}

void row_from_float(const float *in, const Frame &frame, int strip_rows, float *row) {
    for_strips(row, frame, strip_rows, [&](int x, int samples, float *red) {
        for (int i = 0; i < kRowFloats; ++i) red[i] = 0.0f;
        for (int i = 0; i < samples; ++i)
            for (int c = 0; c < 3; ++c) red[c * kStripWidth + i] = in[3 * (x + i) + c];
    });
}

double row_residual(float *row, const Frame &frame, int strip_rows, const std::uint8_t *target,
                    float scale) {
    double total = 0.0;
    for_strips(row, frame, strip_rows, [&](int x, int samples, float *red) {
        // Columns beyond the frame get no residual: their target is what is there.
        float wanted[kRowFloats];
        for (int i = 0; i < kRowFloats; ++i) wanted[i] = clamped(red[i]);
        const std::uint8_t *p = target + 3 * x;
        for (int i = 0; i < samples; ++i)
            for (int c = 0; c < 3; ++c)
                wanted[c * kStripWidth + i] = static_cast<float>(p[3 * i + c]) * (1.0f / 255.0f);
        float squares[kStripWidth] = {};
        for (int i = 0; i < kRowFloats; ++i) {
            const float residual = clamped(red[i]) - wanted[i];
            red[i] = residual * scale;
            squares[i % kStripWidth] += residual * residual;
        }
        float sum = 0.0f;
        for (float s : squares) sum += s;
        total += static_cast<double>(sum);
    });
    return total;
}
