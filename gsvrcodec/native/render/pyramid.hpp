// Upsamples a pyramid level to the next finer one, and the adjoint. Included by kernels.cpp.
//
// Bilinear interpolation to twice the size. Along each axis, a fine pixel is 3/4 of the coarse
// pixel that contains it plus 1/4 of the coarse neighbour nearest to it. The loops go strip by
// strip and from top to bottom, so that each coarse strip and the two fine strips it covers are
// read and written once.

// Distances in floats from an even row to the next row and to the next even row.
constexpr int kOddRow = kVectorRows == 1 ? kStepFloats : kStripWidth;
constexpr int kEvenRow = kVectorRows == 1 ? 2 * kStepFloats : kStepFloats;

static inline int strips(int width) { return (width + kStripWidth - 1) / kStripWidth; }

// The vector steps that one coarse row becomes.
constexpr int kUpsampledSteps = 2 / kVectorRows;

// One channel of them, of the two fine strips.
struct UpsampledSteps {
    wide left[kUpsampledSteps], right[kUpsampledSteps];
};

#if GSVR_LANES == 16
// One channel of one coarse row of a strip, upsampled along x: those of the left fine strip, then
// those of the right one.
typedef vf UpsampledRow;

// `own` is the row, `before` and `after` its neighbours to the left and to the right, and `last`
// the index of the last pixel of the row that is in the picture.
static inline UpsampledRow upsampled_row(const float *own, const float *before, const float *after,
                                         int last) {
    const i8 lane = {0, 1, 2, 3, 4, 5, 6, 7};
    const v8 a = lane <= last ? load8(own) : own[last] - v8{};
    const v8 outside =
        __builtin_shufflevector(*before - v8{}, *after - v8{}, 0, 8, 0, 0, 0, 0, 0, 0);
    const vf all =
        __builtin_shufflevector(a, outside, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const vf near =
        __builtin_shufflevector(all, all, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7);
    const vf far =
        __builtin_shufflevector(all, all, 8, 1, 0, 2, 1, 3, 2, 4, 3, 5, 4, 6, 5, 7, 6, 9);
    return 0.75f * near + 0.25f * far;
}

static inline UpsampledSteps upsampled_steps(vf above, vf here, vf below) {
    const vf most = 0.75f * here, even = most + 0.25f * above, odd = most + 0.25f * below;
    return {{__builtin_shufflevector(even, odd, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22,
                                     23)},
            {__builtin_shufflevector(even, odd, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28,
                                     29, 30, 31)}};
}
#else
struct UpsampledRow {
    v8 left, right;
};

static inline UpsampledRow upsampled_row(const float *own, const float *before, const float *after,
                                         int last) {
    const i8 lane = {0, 1, 2, 3, 4, 5, 6, 7};
    const v8 a = lane <= last ? load8(own) : own[last] - v8{};
    const v8 down = *before - v8{}, up = *after - v8{};
    const v8 most = 0.75f * a;
    const v8 even = most + 0.25f * __builtin_shufflevector(down, a, 0, 8, 9, 10, 11, 12, 13, 14);
    const v8 odd = most + 0.25f * __builtin_shufflevector(a, up, 1, 2, 3, 4, 5, 6, 7, 8);
    return {__builtin_shufflevector(even, odd, 0, 8, 1, 9, 2, 10, 3, 11),
            __builtin_shufflevector(even, odd, 4, 12, 5, 13, 6, 14, 7, 15)};
}

static inline UpsampledSteps upsampled_steps(const UpsampledRow &above, const UpsampledRow &here,
                                             const UpsampledRow &below) {
    const v8 left = 0.75f * here.left, right = 0.75f * here.right;
    return {{left + 0.25f * above.left, left + 0.25f * below.left},
            {right + 0.25f * above.right, right + 0.25f * below.right}};
}
#endif

// `Behind` reads what lies behind the tile.
template <class Behind>
static inline void upsample_strips(const Pixels &coarse, int coarse_width, int coarse_height,
                                   const Pixels &fine, Tile tile, Base base) {
    const std::ptrdiff_t next = static_cast<std::ptrdiff_t>(coarse.rows) * kRowFloats;
    const Range rows = tile.rows;
    for (int strip = tile.columns.begin / (2 * kStripWidth);
         2 * strip * kStripWidth < tile.columns.end; ++strip) {
        const int last = min(coarse_width - strip * kStripWidth, kStripWidth) - 1;
        const bool right_most = (strip + 1) * kStripWidth >= coarse_width;
        const std::ptrdiff_t before = strip ? kStripWidth - 1 - next : 0;
        const std::ptrdiff_t after = right_most ? last : next;
        const int left = 2 * strip, right = left + ((left + 1) * kStripWidth < tile.columns.end);
        const Behind behind_left(base, left, rows.begin), behind_right(base, right, rows.begin);
        float *out_left = strip_row(fine, left, rows.begin);
        float *out_right = strip_row(fine, right, rows.begin);
        UpsampledRow above[kSums], here[kSums], below[kSums];
        const auto read = [&](int of, UpsampledRow *w) {
            const float *own = strip_row(coarse, strip, of);
            for (int c = 0; c < kSums; ++c, own += kChannelFloats)
                w[c] = upsampled_row(own, own + before, own + after, last);
        };
        int row = rows.begin / 2, step = 0;
        read(max(row - 1, 0), above);
        read(row, here);
        for (; 2 * row < rows.end; ++row, step += kUpsampledSteps) {
            read(min(row + 1, coarse_height - 1), below);
            UpsampledSteps steps[kSums];
            for (int c = 0; c < kSums; ++c) {
                steps[c] = upsampled_steps(above[c], here[c], below[c]);
                above[c] = here[c];
                here[c] = below[c];
            }
            const auto put = [&](const Behind &behind, float *out, auto side) {
                for (int k = 0; k < kUpsampledSteps; ++k) {
                    wide sums[kSums];
                    behind.read(step + k, sums);
                    for (int c = 0; c < kSums; ++c)
                        store_wide(out + (step + k) * kStepFloats + c * kChannelFloats,
                                   sums[c] + (steps[c].*side)[k]);
                }
            };
            put(behind_left, out_left, &UpsampledSteps::left);
            if (left != right) put(behind_right, out_right, &UpsampledSteps::right);
        }
    }
}

void upsample(Pixels coarse, int coarse_width, int coarse_height, Pixels fine, Tile tile,
              Base base) {
    const FlushDenormals flush;
    if (base.pixels)
        upsample_strips<PixelsBehind>(coarse, coarse_width, coarse_height, fine, tile, base);
    else if (base.plate)
        upsample_strips<PlateBehind>(coarse, coarse_width, coarse_height, fine, tile, base);
    else
        upsample_strips<NothingBehind>(coarse, coarse_width, coarse_height, fine, tile, base);
}

// The adjoint of upsampling along x: the channels of one row of a coarse strip, from the row of
// the two fine strips it covers.
struct DownsampledRow {
    v8 sum[kSums];
};

static inline DownsampledRow downsampled_row(const Pixels &fine, int width, int strip, int row) {
    const int first = 2 * strip, count = strips(width);
    const float *left = strip_row(fine, first, row);
    const std::ptrdiff_t own = fine.strip_offset(first);
    const std::ptrdiff_t next = fine.strip_offset(first + 1) - own;
    const std::ptrdiff_t last_before = fine.strip_offset(first - 1) - own + kStripWidth - 1;
    const std::ptrdiff_t first_after = fine.strip_offset(first + 2) - own;
    DownsampledRow n;
    for (int c = 0; c < kSums; ++c, left += kChannelFloats) {
        const v8 a = load8(left), b = first + 1 < count ? load8(left + next) : v8{};
        // The fine pixels just outside the two strips. At the edge of the picture, upsampling
        // repeats the outermost coarse pixel: the outermost fine pixel takes the place of the
        // missing one.
        const float before = first ? left[last_before] : left[0];
        const float after = first + 2 < count ? left[first_after] : 0.0f;
        v8 even = __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14);
        v8 odd = __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15);
        v8 back = __builtin_shufflevector(before - v8{}, odd, 0, 8, 9, 10, 11, 12, 13, 14);
        v8 ahead = __builtin_shufflevector(even, after - v8{}, 1, 2, 3, 4, 5, 6, 7, 8);
        const int end = width - first * kStripWidth;  // of the row, in pixels from the left strip
        if (end <= 2 * kStripWidth && end % 2 == 0) ahead[end / 2 - 1] = odd[end / 2 - 1];
        n.sum[c] = 0.75f * (even + odd) + 0.25f * (back + ahead);
    }
    return n;
}

void downsample(Pixels fine, int fine_width, int fine_height, Tile tile, bool blank, Pixels coarse,
                int coarse_width, float *edges) {
    const FlushDenormals flush;
    const int count = strips(coarse_width);
    const int last_row = (fine_height - 1) / 2;
    const Range rows = tile.rows;
    // The coarse strips for which the fine pixels on the left of a column suffice.
    const auto strips_before = [&](int column) {
        return column < fine_width ? max(column / (2 * kStripWidth) - 1, 0) : count;
    };
    const int end = strips_before(tile.columns.end);
    for (int strip = strips_before(tile.columns.begin); strip < end; ++strip) {
        const i8 lane = {0, 1, 2, 3, 4, 5, 6, 7};
        const i8 inside = lane < coarse_width - strip * kStripWidth;
        // The first coarse strip of a blank tile, too, has a neighbour that may not be zero.
        const bool zero = blank && strip > tile.columns.begin / (2 * kStripWidth);
        const auto at = [&](int row) {
            return row < rows.end && !zero ? downsampled_row(fine, fine_width, strip, row)
                                           : DownsampledRow{};
        };
        const auto put = [&](float *p, int channel_stride, int c, v8 v) {
            store8(p + c * channel_stride, (v8)((i8)v & inside));
        };
        int row = rows.begin / 2;
        DownsampledRow before{}, upper = at(2 * row), lower = at(2 * row + 1);
        float *edge = edges + strip * kRowFloats;
        for (int c = 0; c < kSums; ++c) put(edge, kStripWidth, c, 0.25f * upper.sum[c]);
        if (rows.begin == 0) before = upper;
        for (; 2 * row < rows.end; ++row) {
            // Below the picture, upsampling repeats the last row: that row takes the missing place.
            const bool bottom = row == last_row && fine_height % 2 == 0;
            const bool final = 2 * row + 2 >= rows.end;
            const DownsampledRow after = bottom ? lower : at(2 * row + 2);
            float *p = strip_row(coarse, strip, row);
            for (int c = 0; c < kSums; ++c) {
                put(p, kChannelFloats, c,
                    0.75f * (upper.sum[c] + lower.sum[c]) + 0.25f * (before.sum[c] + after.sum[c]));
                if (final) put(edge + count * kRowFloats, kStripWidth, c, 0.25f * lower.sum[c]);
            }
            before = lower;
            upper = after;
            lower = at(2 * row + 3);
        }
        // The rows below the picture in the last vector.
        for (; row % kVectorRows; ++row)
            for (int c = 0; c < kSums; ++c)
                put(strip_row(coarse, strip, row), kChannelFloats, c, v8{});
    }
}
