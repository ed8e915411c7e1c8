// The columns of a block's splats, kLanes splats at a time. Included by kernels.cpp.
//
// A column is kColumns neighbouring pixels wide and runs down one band; a vector covers kRows of
// its rows. Finding where it starts and ends costs more than a few of its rows, so it is done for
// kLanes splats together.

constexpr int kColumns = kLanes < kStripWidth ? kLanes : kStripWidth;
constexpr int kRows = kLanes / kColumns;
// Rows of a band: errors of the recurrence grow with the square of its steps.
constexpr int kBandRows = 32 * kRows;

// The recurrence e(y+1) = e(y) r(y), r(y+1) = r(y) decay cannot start from an e that underflows
// (thin tilted Gaussians): a column with a larger exponent takes an exponential a row instead.
constexpr float kRecurrenceLimit = 60.0f;

template <int... Lane>
constexpr vi lane_index(std::integer_sequence<int, Lane...>) {
    return vi{Lane...};
}
static constexpr vi kLaneIndex = lane_index(AllLanes{});

// First pixel, and one past the last, whose centre is at or beyond (before) an edge, kept in
// [0, size]. Near a whole number they may take one pixel too many, never one too few.
static inline vi first_inside(vf edge, float size) {
    return truncate(min(max(edge + (0.9999f - 0.5f), vf{}), splat(size)));
}
static inline vi end_inside(vf edge, float size) {
    return truncate(min(max(edge + 0.5f, vf{}), splat(size)));
}

struct Column {
    float dx, u;      // of its first pixel, see Splats
    int x, row;       // of its first pixel; row is a multiple of kRows
    int steps;        // vectors
    bool recurrence;  // whether the recurrence holds
};

// Calls body(lane of the block, column) for every column of the block in band rows [begin, end).
template <class Body>
static inline void for_columns(const Splats &s, Extent band, Body body) {
    for (int half = 0; half < kBlock; half += kLanes) {
        const vi begin = max(load(s.row_begin + half), splat(band.begin));
        const vi end = min(load(s.row_end + half), splat(band.end));
        const vi present = begin < end;
        if (!bits(present)) continue;
        const vf cx = load(s.cx + half), cy = load(s.cy + half), slope = load(s.slope + half);
        const vf across = load(s.across + half), down = load(s.down + half);
        const vf low_x = load(s.low_x + half);
        const vf row_first = to_float(begin), row_last = to_float(end);
        const vi x_end = load(s.x_end + half);
        alignas(64) float dx[kLanes], u[kLanes];
        alignas(64) int xs[kLanes], rows[kLanes], steps[kLanes];
        for (vi x = load(s.x_begin + half); bits(present & (x < x_end)); x += kColumns) {
            const vf first = to_float(x) + 0.5f - cx, last = first + static_cast<float>(kColumns - 1);
            // The ellipse's lower and upper edge over [first, last] are extreme where its vertical
            // extremes are, or at the end nearest to them.
            const vf low_at = min(max(low_x, first), last), high_at = min(max(-low_x, first), last);
            const vf low = cy + slope * low_at + sqrt(max(kSupport - across * low_at * low_at, vf{}) / down);
            const vf high = cy + slope * high_at - sqrt(max(kSupport - across * high_at * high_at, vf{}) / down);
            const vi top = truncate(min(max(high + (0.9999f - 0.5f), row_first), row_last)) & -kRows;
            const vi bottom = truncate(min(max(low + 0.5f, row_first), row_last));
            const vi active = present & (x < x_end) & (top < bottom);
            const vi count = (bottom - top + (kRows - 1)) / kRows;
            // The exponent at the corners of the column.
            const vf dy = to_float(top) + 0.5f - cy;
            const vf tall = to_float(count * kRows - 1);
            const vf u0 = dy - slope * first, u1 = dy - slope * last;
            const vf reach = max(max(absolute(u0), absolute(u1)), max(absolute(u0 + tall), absolute(u1 + tall)));
            const vf wide = max(absolute(first), absolute(last));
            const unsigned recurrent = bits(across * wide * wide + down * reach * reach < kRecurrenceLimit);
            store(dx, first);
            store(u, u0);
            store(xs, x);
            store(rows, top);
            store(steps, count);
            for (unsigned todo = bits(active); todo; todo &= todo - 1) {
                const int l = __builtin_ctz(todo);
                body(half + l, Column{dx[l], u[l], xs[l], rows[l], steps[l], (recurrent >> l & 1) != 0});
            }
        }
    }
}

// Offsets of a vector's pixels from its first.
template <int... Lane>
constexpr vf pixel_x(std::integer_sequence<int, Lane...>) {
    return vf{static_cast<float>(Lane % kColumns)...};
}
template <int... Lane>
constexpr vf pixel_y(std::integer_sequence<int, Lane...>) {
    return vf{static_cast<float>(Lane / kColumns)...};
}
static constexpr vf kPixelX = pixel_x(AllLanes{});
static constexpr vf kPixelY = pixel_y(AllLanes{});

// Calls body(e), e = exp(-exponent), for each vector down a column.
template <class Body>
static inline void for_steps(const Splats &s, int l, const Column &c, Body body) {
    const vf dx = c.dx + kPixelX;
    vf u = (c.u + kPixelY) - s.slope[l] * kPixelX;
    const vf fixed = -(s.across[l] * dx * dx);
    const float down = s.down[l];
    if (__builtin_expect(c.recurrence, 1)) {
        vf e = exp(fixed - down * u * u);
        vf r = exp((-2.0f * kRows * down) * (u + 0.5f * kRows));
        const float decay = s.decay[l];
        for (int step = c.steps; step > 0; --step) {
            body(e);
            e *= r;
            r *= decay;
        }
    } else {
        for (int step = c.steps; step > 0; --step, u += static_cast<float>(kRows))
            body(exp(max(fixed - down * u * u, splat(-80.0f))));
    }
}
