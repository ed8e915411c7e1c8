// Cuts the splats of a block into segments, kLanes splats at a time. Included by kernels.cpp.
//
// A segment is the part of a splat's ellipse in one tile and in kVectorColumns neighbouring pixel
// columns. A vector covers kVectorColumns x kVectorRows pixels, and a segment is a vertical run of
// vectors. The loop over the vectors of a segment ends in a branch that the processor mispredicts.
// So the ends and the first vectors of many segments are computed first, in loops without such
// branches, and the segments are processed afterwards.

constexpr int kVectorColumns = kLanes < kStripWidth ? kLanes : kStripWidth;
constexpr int kVectorRows = kLanes / kVectorColumns;
// Rows of a band. The rounding error of the recurrence grows with the square of its steps, so a
// band has a fixed number of vectors.
constexpr int kBandRows = 32 * kVectorRows;

// The weights down a column of pixels follow the recurrence e(y+1) = e(y) r(y), r(y+1) = r(y)
// decay. The recurrence cannot start from an e that underflows, as with thin tilted Gaussians. A
// segment with an exponent above this limit computes an exponential for each vector instead.
constexpr float kRecurrenceLimit = 86.0f;
constexpr float kEnd = kSupport * kLog2E;  // the exponent, to the base 2, at a splat's edge

template <int... Lane>
constexpr vi lane_index(std::integer_sequence<int, Lane...>) {
    return vi{Lane...};
}
static constexpr vi kLaneIndex = lane_index(AllLanes{});

// The range of pixels whose centres lie between two edges, clamped to [0, size]: first_inside gives
// its begin from the lower edge, end_inside its end from the upper edge. When an edge is within
// rounding of a pixel's centre, the range may have one pixel too many, but never one too few.
static inline vi first_inside(vf edge, vf size) {
    return truncate(min(max(edge + (0.9999f - 0.5f), vf{}), size));
}
static inline vi end_inside(vf edge, vf size) {
    return truncate(min(max(edge + 0.5f, vf{}), size));
}

// Segments that are ready to be processed.
struct alignas(64) Segments {
    static constexpr int kCapacity = 128;
    float dx[kCapacity], u[kCapacity];  // of the first pixel, see Splats
    int x[kCapacity], row[kCapacity];   // of the first pixel; row is a multiple of kVectorRows
    int steps[kCapacity];               // number of vectors, negative if the recurrence is not used
    int splat[kCapacity];               // of the block
    vf e[kCapacity], r[kCapacity];      // the recurrence at the first vector
    int count;
};

// Appends one segment for each lane of `mask`; there must be room for kLanes segments.
static inline void append(Segments &c, unsigned mask, vf dx, vf u, vi x, vi row, vi steps,
                          vi lane) {
    const int n = c.count;
    c.count += __builtin_popcount(mask);
#if defined(__AVX512F__)
    const auto put = [&](void *to, __m512i v) {
        _mm512_storeu_si512(to, _mm512_maskz_compress_epi32(static_cast<__mmask16>(mask), v));
    };
    put(c.dx + n, (__m512i)dx);
    put(c.u + n, (__m512i)u);
    put(c.x + n, (__m512i)x);
    put(c.row + n, (__m512i)row);
    put(c.steps + n, (__m512i)steps);
    put(c.splat + n, (__m512i)lane);
#else
    alignas(64) float dxs[kLanes], us[kLanes];
    alignas(64) int xs[kLanes], rows[kLanes], counts[kLanes], lanes[kLanes];
    store(dxs, dx);
    store(us, u);
    store(xs, x);
    store(rows, row);
    store(counts, steps);
    store(lanes, lane);
    for (int to = n; mask; mask &= mask - 1, ++to) {
        const int l = __builtin_ctz(mask);
        c.dx[to] = dxs[l];
        c.u[to] = us[l];
        c.x[to] = xs[l];
        c.row[to] = rows[l];
        c.steps[to] = counts[l];
        c.splat[to] = lanes[l];
    }
#endif
}

// The offsets of a vector's pixels from its first pixel.
template <int... Lane>
constexpr vf pixel_x(std::integer_sequence<int, Lane...>) {
    return vf{static_cast<float>(Lane % kVectorColumns)...};
}
template <int... Lane>
constexpr vf pixel_y(std::integer_sequence<int, Lane...>) {
    return vf{static_cast<float>(Lane / kVectorColumns)...};
}
static constexpr vf kPixelX = pixel_x(AllLanes{});
static constexpr vf kPixelY = pixel_y(AllLanes{});

// u (see Splats) of the pixels of a segment's first vector.
static inline vf segment_u(const Splats &s, const Segments &c, int n) {
    return (c.u[n] + kPixelY) - s.slope[c.splat[n]] * kPixelX;
}

// Computes the first vectors of the collected segments, calls process(), and empties the list.
template <class Process>
static inline void flush(const Splats &s, Segments &c, Process process) {
    for (int n = 0; n < c.count; ++n) {
        const float down = s.down[c.splat[n]];
        const vf dx = c.dx[n] + kPixelX, u = segment_u(s, c, n);
        c.e[n] = exp2(-(s.across[c.splat[n]] * dx * dx + down * u * u));
        c.r[n] = exp2((-2.0f * kVectorRows * down) * (u + 0.5f * kVectorRows));
    }
    process();
    c.count = 0;
}

// Collects the segments of a block's splats, of one layer and one tile, in `c`, and calls process()
// each time `c` is full and once at the end. The order of the segments depends only on the
// arguments.
template <class Process>
static inline void for_segments(const Splats &s, int layer, Tile tile, Segments &c,
                                Process process) {
    c.count = 0;
    for (int half = 0; half < kBlock; half += kLanes) {
        const vi begin = max(load(s.row_begin + half), broadcast(tile.rows.begin));
        const vi end = min(load(s.row_end + half), broadcast(tile.rows.end));
        const vi present = (begin < end) & (load(s.layer + half) == layer);
        if (!bits(present)) continue;
        const vf cx = load(s.cx + half), cy = load(s.cy + half), slope = load(s.slope + half);
        const vf across = load(s.across + half), down = load(s.down + half);
        const vf bend = 1.0f / down, lowest_dx = load(s.lowest_dx + half);
        const vf row_first = to_float(begin), row_last = to_float(end);
        const vi x_end = min(load(s.x_end + half), broadcast(tile.columns.end));
        for (vi x = max(load(s.x_begin + half), broadcast(tile.columns.begin));
             bits(present & (x < x_end)); x += kVectorColumns) {
            const vf first = to_float(x) + 0.5f - cx,
                     last = first + static_cast<float>(kVectorColumns - 1);
            // Within [first, last], the ellipse reaches its largest y at dx = lowest_dx, or at the
            // end of the interval nearest to lowest_dx; its smallest y likewise at -lowest_dx.
            const vf low_at = min(max(lowest_dx, first), last),
                     high_at = min(max(-lowest_dx, first), last);
            const vf low =
                cy + slope * low_at + sqrt(max(kEnd - across * low_at * low_at, vf{}) * bend);
            const vf high =
                cy + slope * high_at - sqrt(max(kEnd - across * high_at * high_at, vf{}) * bend);
            const vi top =
                truncate(min(max(high + (0.9999f - 0.5f), row_first), row_last)) & -kVectorRows;
            const vi bottom = truncate(min(max(low + 0.5f, row_first), row_last));
            const vi active = present & (x < x_end) & (top < bottom);
            const vi steps = (bottom - top + (kVectorRows - 1)) / kVectorRows;
            // The exponent at the corners of the segment.
            const vf dy = to_float(top) + 0.5f - cy;
            const vf tall = to_float(steps * kVectorRows - 1);
            const vf u0 = dy - slope * first, u1 = dy - slope * last;
            const vf reach =
                max(max(absolute(u0), absolute(u1)), max(absolute(u0 + tall), absolute(u1 + tall)));
            const vf wide = max(absolute(first), absolute(last));
            const vi holds = across * wide * wide + down * reach * reach < kRecurrenceLimit;
            if (c.count + kLanes > Segments::kCapacity) flush(s, c, process);
            append(c, bits(active), first, u0, x, top, holds ? steps : -steps, kLaneIndex + half);
        }
    }
    flush(s, c, process);
}

// Calls body(e) for each vector of a segment from top to bottom; e is the weight before the
// cut-off.
template <class Body>
static inline void for_steps(const Splats &s, const Segments &c, int n, Body body) {
    const int l = c.splat[n];
    int steps = c.steps[n];
    if (__builtin_expect(steps > 0, 1)) {
        vf e = c.e[n], r = c.r[n];
        const float decay = s.decay[l];
        for (; steps > 0; --steps) {
            body(e);
            e *= r;
            r *= decay;
        }
    } else {
        const vf dx = c.dx[n] + kPixelX;
        const vf fixed = s.across[l] * dx * dx;
        vf u = segment_u(s, c, n);
        for (; steps < 0; ++steps, u += static_cast<float>(kVectorRows))
            body(exp2(-min(fixed + s.down[l] * u * u, broadcast(120.0f))));
    }
}
