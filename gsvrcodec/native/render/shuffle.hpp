// Conversion between interleaved arrays and vectors, transposes, and sums over lanes. Included by
// kernels.cpp.

// Column `Column` of an interleaved array of kLanes rows and Width columns; v is the array.
template <int Width, int Column, int... Lane>
static inline vf pick(const vf *v, std::integer_sequence<int, Lane...>) {
    if constexpr (Width == 1) return v[0];
    if constexpr (Width == 2) return __builtin_shufflevector(v[0], v[1], (2 * Lane + Column)...);
    if constexpr (Width == 3) {
        const vf t = __builtin_shufflevector(
            v[0], v[1], (3 * Lane + Column < 2 * kLanes ? 3 * Lane + Column : -1)...);
        return __builtin_shufflevector(
            t, v[2], (3 * Lane + Column < 2 * kLanes ? Lane : 3 * Lane + Column - kLanes)...);
    }
}

// The inverse: vector `Part` of the interleaved array that has the columns v.
template <int Width, int Part, int... Lane>
static inline vf weave(const vf *v, std::integer_sequence<int, Lane...>) {
    if constexpr (Width == 1) return v[0];
    if constexpr (Width == 2)
        return __builtin_shufflevector(
            v[0], v[1], ((Part * kLanes + Lane) / 2 + (Part * kLanes + Lane) % 2 * kLanes)...);
    if constexpr (Width == 3) {
        const vf t = __builtin_shufflevector(
            v[0], v[1],
            ((Part * kLanes + Lane) % 3 == 2
                 ? -1
                 : (Part * kLanes + Lane) / 3 + (Part * kLanes + Lane) % 3 * kLanes)...);
        return __builtin_shufflevector(
            t, v[2],
            ((Part * kLanes + Lane) % 3 == 2 ? (Part * kLanes + Lane) / 3 + kLanes : Lane)...);
    }
}

using AllLanes = std::make_integer_sequence<int, kLanes>;

template <int Width>
struct Fields {
    vf column[Width];
};

// Loads the rows [i, i + count) of an (N, Width) array; the lanes from `count` on are zero.
template <int Width>
static inline Fields<Width> load_fields(const float *array, int i, int count) {
    float padded[Width * kLanes];
    const float *p = array + static_cast<std::ptrdiff_t>(i) * Width;
    if (count < kLanes) {
        for (int k = 0; k < Width * kLanes; ++k) padded[k] = k < count * Width ? p[k] : 0.0f;
        p = padded;
    }
    vf v[Width];
    for (int k = 0; k < Width; ++k) v[k] = load(p + k * kLanes);
    Fields<Width> f;
    f.column[0] = pick<Width, 0>(v, AllLanes{});
    if constexpr (Width > 1) f.column[1] = pick<Width, 1>(v, AllLanes{});
    if constexpr (Width > 2) f.column[2] = pick<Width, 2>(v, AllLanes{});
    return f;
}

// Stores the rows [i, i + count) of an (N, Width) array.
template <int Width>
static inline void store_fields(float *array, int i, int count, const Fields<Width> &f) {
    vf v[Width];
    v[0] = weave<Width, 0>(f.column, AllLanes{});
    if constexpr (Width > 1) v[1] = weave<Width, 1>(f.column, AllLanes{});
    if constexpr (Width > 2) v[2] = weave<Width, 2>(f.column, AllLanes{});
    float *p = array + static_cast<std::ptrdiff_t>(i) * Width;
    if (count == kLanes) {
        for (int k = 0; k < Width; ++k) store(p + k * kLanes, v[k]);
        return;
    }
    float padded[Width * kLanes];
    for (int k = 0; k < Width; ++k) store(padded + k * kLanes, v[k]);
    for (int k = 0; k < count * Width; ++k) p[k] = padded[k];
}

static inline v8 low_halves(v8 a, v8 b) {
    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11);
}
static inline v8 high_halves(v8 a, v8 b) {
    return __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15);
}

#if GSVR_LANES == 4

static inline void transpose(vf *r) {
    const vf a = __builtin_shufflevector(r[0], r[1], 0, 4, 1, 5);
    const vf b = __builtin_shufflevector(r[0], r[1], 2, 6, 3, 7);
    const vf c = __builtin_shufflevector(r[2], r[3], 0, 4, 1, 5);
    const vf d = __builtin_shufflevector(r[2], r[3], 2, 6, 3, 7);
    r[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
    r[1] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
    r[2] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
    r[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
}

// Converts an array of kLanes rows and eight columns to eight vectors, and back.
static inline void to_columns(const float *rows, vf *columns) {
    for (int half = 0; half < 2; ++half) {
        for (int l = 0; l < 4; ++l) columns[4 * half + l] = load(rows + 8 * l + 4 * half);
        transpose(columns + 4 * half);
    }
}

static inline void to_rows(const vf *columns, float *rows) {
    for (int half = 0; half < 2; ++half) {
        vf r[4] = {columns[4 * half], columns[4 * half + 1], columns[4 * half + 2],
                   columns[4 * half + 3]};
        transpose(r);
        for (int l = 0; l < 4; ++l) store(rows + 8 * l + 4 * half, r[l]);
    }
}

// The sums over the lanes of eight vectors.
static inline v8 sums(const vf *v) {
    vf r[8] = {v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]};
    transpose(r);
    transpose(r + 4);
    return __builtin_shufflevector((r[0] + r[1]) + (r[2] + r[3]), (r[4] + r[5]) + (r[6] + r[7]), 0,
                                   1, 2, 3, 4, 5, 6, 7);
}

#else

static inline v8 low_pairs(v8 a, v8 b) {
    return __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13);
}
static inline v8 high_pairs(v8 a, v8 b) {
    return __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
}
static inline v8 low_fours(v8 a, v8 b) {
    return __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13);
}
static inline v8 high_fours(v8 a, v8 b) {
    return __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
}

static inline void transpose(v8 *r) {
    v8 s[8];
    for (int h = 0; h < 8; h += 4) {
        const v8 a = low_pairs(r[h], r[h + 1]), b = high_pairs(r[h], r[h + 1]);
        const v8 c = low_pairs(r[h + 2], r[h + 3]), d = high_pairs(r[h + 2], r[h + 3]);
        s[h] = low_fours(a, c);
        s[h + 1] = high_fours(a, c);
        s[h + 2] = low_fours(b, d);
        s[h + 3] = high_fours(b, d);
    }
    for (int i = 0; i < 4; ++i) {
        r[i] = low_halves(s[i], s[i + 4]);
        r[i + 4] = high_halves(s[i], s[i + 4]);
    }
}

static inline v8 sums8(const v8 *v) {
    v8 a[4], b[2];
    for (int i = 0; i < 4; ++i)
        a[i] = low_pairs(v[2 * i], v[2 * i + 1]) + high_pairs(v[2 * i], v[2 * i + 1]);
    for (int i = 0; i < 2; ++i)
        b[i] = low_fours(a[2 * i], a[2 * i + 1]) + high_fours(a[2 * i], a[2 * i + 1]);
    return low_halves(b[0], b[1]) + high_halves(b[0], b[1]);
}

#if GSVR_LANES == 8

static inline void to_columns(const float *rows, vf *columns) {
    for (int l = 0; l < 8; ++l) columns[l] = load8(rows + 8 * l);
    transpose(columns);
}

static inline void to_rows(const vf *columns, float *rows) {
    v8 r[8];
    for (int k = 0; k < 8; ++k) r[k] = columns[k];
    transpose(r);
    for (int l = 0; l < 8; ++l) store8(rows + 8 * l, r[l]);
}

static inline v8 sums(const vf *v) { return sums8(v); }

#else

static inline v8 low(vf v) { return __builtin_shufflevector(v, v, 0, 1, 2, 3, 4, 5, 6, 7); }
static inline v8 high(vf v) { return __builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15); }

static inline void to_columns(const float *rows, vf *columns) {
    v8 r[16];
    for (int l = 0; l < 16; ++l) r[l] = load8(rows + 8 * l);
    transpose(r);
    transpose(r + 8);
    for (int k = 0; k < 8; ++k)
        columns[k] = __builtin_shufflevector(r[k], r[k + 8], 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11,
                                             12, 13, 14, 15);
}

static inline void to_rows(const vf *columns, float *rows) {
    v8 r[16];
    for (int k = 0; k < 8; ++k) r[k] = low(columns[k]), r[k + 8] = high(columns[k]);
    transpose(r);
    transpose(r + 8);
    for (int l = 0; l < 16; ++l) store8(rows + 8 * l, r[l]);
}

static inline v8 sums(const vf *v) {
    v8 r[8];
    for (int k = 0; k < 8; ++k) r[k] = low(v[k]) + high(v[k]);
    return sums8(r);
}

#endif
#endif

static inline float sum8(v8 v) {
    const v8 fours = v + __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3);
    const v8 pairs = fours + __builtin_shufflevector(fours, fours, 2, 3, 0, 1, 6, 7, 4, 5);
    return pairs[0] + pairs[1];
}

static inline float sum(vf v) {
#if GSVR_LANES == 16
    return sum8(low(v) + high(v));
#elif GSVR_LANES == 8
    return sum8(v);
#else
    return (v[0] + v[1]) + (v[2] + v[3]);
#endif
}
