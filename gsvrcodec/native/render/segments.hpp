// Cuts splats into segments, kLanes at a time. Included by kernels.cpp.
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
    int splat[kCapacity];               // of the layer
    vf e[kCapacity], r[kCapacity];      // the recurrence at the first vector
    int count;
};

// Appends one segment for each lane of `mask`; there must be room for kLanes segments.
static inline void append(Segments &c, unsigned mask, vf dx, vf u, vi x, vi row, vi steps,
                          vi splat) {
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
    put(c.splat + n, (__m512i)splat);
#else
    alignas(64) float dxs[kLanes], us[kLanes];
    alignas(64) int xs[kLanes], rows[kLanes], counts[kLanes], splats[kLanes];
    store(dxs, dx);
    store(us, u);
    store(xs, x);
    store(rows, row);
    store(counts, steps);
    store(splats, splat);
    for (int to = n; mask; mask &= mask - 1, ++to) {
        const int l = __builtin_ctz(mask);
        c.dx[to] = dxs[l];
        c.u[to] = us[l];
        c.x[to] = xs[l];
        c.row[to] = rows[l];
        c.steps[to] = counts[l];
        c.splat[to] = splats[l];
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

// The block of a segment's splat, and its place there.
static inline const Splats &block_of(const SplatLayer &layer, const Segments &c, int n) {
    return layer.splats[c.splat[n] / kBlock];
}
static inline int lane_of(const Segments &c, int n) { return c.splat[n] % kBlock; }

// u (see Splats) of the pixels of a segment's first vector.
static inline vf segment_u(const Splats &s, const Segments &c, int n) {
    return (c.u[n] + kPixelY) - s.slope[lane_of(c, n)] * kPixelX;
}

// Computes the first vectors of the collected segments, calls process(), and empties the list.
template <class Process>
static inline void flush(const SplatLayer &layer, Segments &c, Process process) {
    for (int n = 0; n < c.count; ++n) {
        const Splats &s = block_of(layer, c, n);
        const float across = s.across[lane_of(c, n)], down = s.down[lane_of(c, n)];
        const vf dx = c.dx[n] + kPixelX, u = segment_u(s, c, n);
        c.e[n] = exp2(-(across * dx * dx + down * u * u));
        c.r[n] = exp2((-2.0f * kVectorRows * down) * (u + 0.5f * kVectorRows));
    }
    process();
    c.count = 0;
}

// Of each lane the value of the splat of a block whose number the lane holds.
#if defined(__AVX512F__)
static inline vi of_splats(const int *values, vi splat) {
    return (vi)_mm512_permutexvar_epi32((__m512i)splat, (__m512i)load(values));
}
#elif defined(__AVX2__)
static inline vi of_splats(const int *values, vi splat) {
    const __m256i low = _mm256_permutevar8x32_epi32((__m256i)load(values), (__m256i)splat);
    const __m256i high = _mm256_permutevar8x32_epi32((__m256i)load(values + 8), (__m256i)splat);
    return splat > 7 ? (vi)high : (vi)low;
}
#else
static inline vi of_splats(const int *values, vi splat) {
    vi v;
    for (int i = 0; i < kLanes; ++i) v[i] = values[splat[i]];
    return v;
}
#endif
static inline vf of_splats(const float *values, vi splat) {
    return (vf)of_splats(reinterpret_cast<const int *>(values), splat);
}

// Columns of a block's splats that may have segments: of which splat, and from which pixel on.
struct alignas(64) Columns {
    static constexpr int kCapacity = 8 * kLanes;
    int splat[kCapacity + kLanes], x[kCapacity + kLanes];
    int row_begin[kBlock], row_end[kBlock];  // of the splats in the tile
    int count;
};

// Collects the segments of the columns in `c`, calls process() each time `c` is full, and empties
// the list of columns.
template <class Process>
static inline void cut(const SplatLayer &layer, int block, Columns &columns, Segments &c,
                       Process process) {
    const Splats &s = layer.splats[block];
    // The lanes of the last vector that have no column need a splat too.
    store(columns.splat + columns.count, vi{});
    store(columns.x + columns.count, vi{});
    for (int n = 0; n < columns.count; n += kLanes) {
        const vi splat = load(columns.splat + n), x = load(columns.x + n);
        const vf cx = of_splats(s.cx, splat), cy = of_splats(s.cy, splat);
        const vf slope = of_splats(s.slope, splat), lowest_dx = of_splats(s.lowest_dx, splat);
        const vf across = of_splats(s.across, splat), down = of_splats(s.down, splat);
        const vf bend = 1.0f / down;
        const vf row_first = to_float(of_splats(columns.row_begin, splat));
        const vf row_last = to_float(of_splats(columns.row_end, splat));
        const vf first = to_float(x) + 0.5f - cx,
                 last = first + static_cast<float>(kVectorColumns - 1);
        // Within [first, last], the ellipse reaches its largest y at dx = lowest_dx, or at the end
        // of the interval nearest to lowest_dx; its smallest y likewise at -lowest_dx.
        const vf low_at = min(max(lowest_dx, first), last),
                 high_at = min(max(-lowest_dx, first), last);
        const vf low =
            cy + slope * low_at + sqrt(max(kEnd - across * low_at * low_at, vf{}) * bend);
        const vf high =
            cy + slope * high_at - sqrt(max(kEnd - across * high_at * high_at, vf{}) * bend);
        const vi top =
            truncate(min(max(high + (0.9999f - 0.5f), row_first), row_last)) & -kVectorRows;
        const vi bottom = truncate(min(max(low + 0.5f, row_first), row_last));
        const vi active = (kLaneIndex < broadcast(columns.count - n)) & (top < bottom);
        const vi steps = (bottom - top + (kVectorRows - 1)) / kVectorRows;
        // The exponent at the corners of the segment.
        const vf dy = to_float(top) + 0.5f - cy;
        const vf tall = to_float(steps * kVectorRows - 1);
        const vf u0 = dy - slope * first, u1 = dy - slope * last;
        const vf reach =
            max(max(absolute(u0), absolute(u1)), max(absolute(u0 + tall), absolute(u1 + tall)));
        const vf wide = max(absolute(first), absolute(last));
        const vi holds = across * wide * wide + down * reach * reach < kRecurrenceLimit;
        if (c.count + kLanes > Segments::kCapacity) flush(layer, c, process);
        append(c, bits(active), first, u0, x, top, holds ? steps : -steps, splat + block * kBlock);
    }
    columns.count = 0;
}

// Collects the segments of a block's splats in a tile in `c`, those of a splat one after another;
// calls process() each time `c` is full.
template <class Process>
static inline void collect(const SplatLayer &layer, int block, Tile tile, Segments &c,
                           Process process) {
    const Splats &s = layer.splats[block];
    alignas(64) int x_begin[kBlock], x_end[kBlock];
    Columns columns;
    unsigned present = 0;
    for (int l = 0; l < kBlock; l += kLanes) {
        const vi begin = max(load(s.row_begin + l), broadcast(tile.rows.begin));
        const vi end = min(load(s.row_end + l), broadcast(tile.rows.end));
        store(columns.row_begin + l, begin);
        store(columns.row_end + l, end);
        store(x_begin + l, max(load(s.x_begin + l), broadcast(tile.columns.begin)));
        store(x_end + l, min(load(s.x_end + l), broadcast(tile.columns.end)));
        present |= bits((begin < end) & (load(s.layer + l) == layer.index)) << l;
    }
    columns.count = 0;
    for (; present; present &= present - 1) {
        const int l = __builtin_ctz(present);
        // A whole vector is written, whose last lanes the next splat overwrites.
        for (int x = x_begin[l]; x < x_end[l]; x += kLanes * kVectorColumns) {
            if (columns.count > Columns::kCapacity - kLanes) cut(layer, block, columns, c, process);
            store(columns.splat + columns.count, broadcast(l));
            store(columns.x + columns.count, x + kVectorColumns * kLaneIndex);
            columns.count += min((x_end[l] - x + kVectorColumns - 1) / kVectorColumns, kLanes);
        }
    }
    cut(layer, block, columns, c, process);
}

// Collects the segments of the blocks of a layer in a tile in `c`, and calls process() each time
// `c` is full and once at the end. Calls enter(block) before the first of each block.
template <class Enter, class Process>
static inline void for_segments(const SplatLayer &layer, Tile tile, Segments &c, Enter enter,
                                Process process) {
    c.count = 0;
    for (int block = layer.begin; block < layer.end; ++block) {
        if (!layer.boxes[block].touches(tile)) continue;
        enter(block);
        collect(layer, block, tile, c, process);
    }
    flush(layer, c, process);
}

// Calls body(e) for each vector of a segment from top to bottom; e is the weight before the
// cut-off.
template <class Body>
static inline void for_steps(const Splats &s, const Segments &c, int n, Body body) {
    const int l = lane_of(c, n);
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
