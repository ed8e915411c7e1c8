// Rasterisation of splats and its gradient, a vector of neighbouring pixels of a row at a time.
// Included by kernels.cpp.
//
// Down a column the exponent E is a quadratic in y, so exp(-E) follows a recurrence of two
// multiplications a row: e(y+1) = e(y) r(y), r(y+1) = r(y) k. It cannot start from an e that
// underflows (thin tilted Gaussians); such columns take an exponential a row instead.

constexpr float kRecurrenceLimit = 60.0f;

// kLanes neighbouring columns of a splat and the rows on which any of them is inside it.
struct Column {
    vf dx;
    int row_begin, row_end;
    bool recurrence;
};

static inline float exponent(const Splat &s, float dx, float dy) {
    return 0.5f * (s.a * dx * dx + s.c * dy * dy) + s.b * dx * dy;
}

static inline Column column(const Splat &s, int x, int row_begin, int row_end) {
    const float first = static_cast<float>(x) + 0.5f - s.cx;
    const float last = first + static_cast<float>(kLanes - 1);
    // The ellipse's lower and upper edge over [first, last] are extreme where its vertical
    // extremes are, or at the end nearest to them.
    const float low_at = min(max(s.top, first), last);
    const float high_at = min(max(-s.top, first), last);
    const float w2 = s.half_width * s.half_width;
    const float low = s.slope * low_at + __builtin_sqrtf(max((w2 - low_at * low_at) * s.bend, 0.0f));
    const float high =
        s.slope * high_at - __builtin_sqrtf(max((w2 - high_at * high_at) * s.bend, 0.0f));
    Column c;
    c.dx = first + iota();
    // The bounds lie within the splat's rows but for rounding, so the conversions are safe.
    const float begin = max(s.cy + high - 0.5f, static_cast<float>(row_begin) - 1.0f);
    const float end = min(s.cy + low - 0.5f, static_cast<float>(row_end));
    c.row_begin = row_begin;
    c.row_end = row_begin;
    if (!(begin <= end)) return c;
    c.row_begin = max(static_cast<int>(__builtin_ceilf(begin)), row_begin);
    c.row_end = min(static_cast<int>(__builtin_floorf(end)) + 1, row_end);
    const float dy0 = static_cast<float>(c.row_begin) + 0.5f - s.cy;
    const float dy1 = static_cast<float>(c.row_end) - 0.5f - s.cy;
    const float corner = max(max(exponent(s, first, dy0), exponent(s, last, dy0)),
                             max(exponent(s, first, dy1), exponent(s, last, dy1)));
    c.recurrence = corner < kRecurrenceLimit;
    return c;
}

// Calls body(e) with e = exp(-E) of each row of the column.
template <class Body>
static inline void for_rows(const Splat &s, const Column &c, Body body) {
    float dy = static_cast<float>(c.row_begin) + 0.5f - s.cy;
    const vf quadratic = 0.5f * s.a * c.dx * c.dx;
    const vf linear = s.b * c.dx;
    if (c.recurrence) {
        vf e = exp(-(quadratic + dy * (linear + 0.5f * s.c * dy)));
        vf r = exp(-(linear + s.c * (dy + 0.5f)));
        for (int row = c.row_begin; row < c.row_end; ++row) {
            body(e);
            e *= r;
            r *= s.k;
        }
    } else {
        for (int row = c.row_begin; row < c.row_end; ++row, dy += 1.0f)
            body(exp(-min(quadratic + dy * (linear + 0.5f * s.c * dy), splat(80.0f))));
    }
}

// Columns begin at multiples of kLanes, so that none crosses a strip.
static inline int first_column(const Splat &s) {
    const float begin = max(s.cx - s.half_width - 0.5f, -1.0f);
    return max(static_cast<int>(__builtin_ceilf(begin)), 0) & ~(kLanes - 1);
}

static inline int columns_end(const Splat &s, int width) {
    const float end = min(s.cx + s.half_width - 0.5f, static_cast<float>(width) - 1.0f);
    return static_cast<int>(__builtin_floorf(end)) + 1;
}

static inline int strip_offset(int x, int strip_rows) {
    return x / kStripWidth * strip_rows * kRowFloats + x % kStripWidth;
}

void rasterise(const Splat *splats, const int *list, int count, const Frame &frame, int row_begin,
               int row_end, float *pixels, int strip_rows) {
    for (int n = 0; n < count; ++n) {
        const Splat &s = splats[list[n]];
        const vf red = splat(s.colour[0]), green = splat(s.colour[1]), blue = splat(s.colour[2]);
        const int begin = max(s.row_begin, row_begin), end = min(s.row_end, row_end);
        const int x_end = columns_end(s, frame.width);
        for (int x = first_column(s); x < x_end; x += kLanes) {
            const Column c = column(s, x, begin, end);
            float *p = pixels + strip_offset(x, strip_rows) + (c.row_begin - row_begin) * kRowFloats;
            for_rows(s, c, [&](vf e) {
                const vf w = max(e - kCutoff, vf{});
                store(p, load(p) + red * w);
                store(p + kStripWidth, load(p + kStripWidth) + green * w);
                store(p + 2 * kStripWidth, load(p + 2 * kStripWidth) + blue * w);
                p += kRowFloats;
            });
        }
    }
}

// Sums of the gradient of the whole frame's `pixels` against one splat. The moments about the rows
// of a column are prefix sums of prefix sums: additions alone.
static inline Moments splat_moments(const Splat &s, const Frame &frame, const float *pixels) {
    const vf red = splat(s.colour[0]), green = splat(s.colour[1]), blue = splat(s.colour[2]);
    vf sums[8] = {};
    const int x_end = s.row_begin < s.row_end ? columns_end(s, frame.width) : 0;
    for (int x = first_column(s); x < x_end; x += kLanes) {
        const float *strip = pixels + strip_offset(x, frame.height);
        // Short runs of rows bound the recurrence's rounding.
        for (int begin = s.row_begin; begin < s.row_end; begin += kBandRows) {
            const Column c = column(s, x, begin, min(begin + kBandRows, s.row_end));
            if (c.row_begin >= c.row_end) continue;
            vf r{}, g{}, b{}, p0{}, p1{}, p2{};
            const float *p = strip + c.row_begin * kRowFloats;
            for_rows(s, c, [&](vf e) {
                const vf w = max(e - kCutoff, vf{});
                const vf dr = load(p), dg = load(p + kStripWidth), db = load(p + 2 * kStripWidth);
                r += w * dr;
                g += w * dg;
                b += w * db;
                const vf inside = e > kCutoff ? e : vf{};
                p2 += p1;
                p1 += p0;
                p0 += (red * dr + green * dg + blue * db) * inside;
                p += kRowFloats;
            });
            // With m rows below a pixel inside the run: p1 sums m, p2 sums m (m - 1) / 2.
            const float last = static_cast<float>(c.row_end) - 0.5f - s.cy;
            const vf y = last * p0 - p1;
            sums[0] += r;
            sums[1] += g;
            sums[2] += b;
            sums[3] += p0 * c.dx;
            sums[4] += y;
            sums[5] += p0 * c.dx * c.dx;
            sums[6] += y * c.dx;
            sums[7] += last * (last * p0 - 2.0f * p1) + 2.0f * p2 + p1;
        }
    }
    return {{sum(sums[0]), sum(sums[1]), sum(sums[2])},
            sum(sums[3]), sum(sums[4]), sum(sums[5]), sum(sums[6]), sum(sums[7])};
}
