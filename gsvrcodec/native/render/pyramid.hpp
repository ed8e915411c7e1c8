// Upsamples a pyramid level to the next finer one, and the adjoint. Included by kernels.cpp.
//
// Bilinear interpolation to twice the size. Along each axis, a fine pixel is 3/4 of the coarse
// pixel that contains it plus 1/4 of the coarse neighbour nearest to it. The loops go strip by
// strip and from top to bottom, so that each coarse strip and the two fine strips it covers are
// read and written once.

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

// The gradient of coarse pixels along one axis, from those of the two fine pixels of each, and of
// the two fine neighbours of those.
template <class Vector>
static inline Vector downsampled(Vector even, Vector odd, Vector back, Vector ahead) {
    return 0.75f * (even + odd) + 0.25f * (back + ahead);
}

// The adjoint of upsampling along x: the channels of an even row and of the next.
struct DownsampledRows {
    v8 upper[kSums], lower[kSums];
};

// The two fine strips that a coarse strip covers, and their neighbours. At the edge of the picture,
// upsampling repeats the outermost coarse pixel: the outermost fine pixel takes the place of the
// missing one.
class FineStrips {
   public:
    FineStrips(const Pixels &fine, int width, int strip)
        : fine_(fine),
          left_(2 * strip),
          has_right_(left_ + 1 < strips(width)),
          has_after_(left_ + 2 < strips(width)),
          before_(fine.strip_offset(left_ - 1) - fine.strip_offset(left_)),
          right_(fine.strip_offset(left_ + 1) - fine.strip_offset(left_)),
          after_(fine.strip_offset(left_ + 2) - fine.strip_offset(left_)),
          end_(width - left_ * kStripWidth) {}

    // Of an even row, and the next if there is one.
    DownsampledRows rows(int row, bool has_next) const {
        DownsampledRows rows;
        const float *p = strip_row(fine_, left_, row);
        for (int c = 0; c < kSums; ++c, p += kChannelFloats) {
#if GSVR_LANES == 16
            const vf both = step(p);
            rows.upper[c] = __builtin_shufflevector(both, both, 0, 1, 2, 3, 4, 5, 6, 7);
            rows.lower[c] = __builtin_shufflevector(both, both, 8, 9, 10, 11, 12, 13, 14, 15);
            if (!has_next) rows.lower[c] = v8{};
#else
            rows.upper[c] = step(p);
            rows.lower[c] = has_next ? step(p + kStepFloats) : v8{};
#endif
        }
        return rows;
    }

   private:
    // Whether the coarse strip has the last pixel of a row, and that covers two fine pixels.
    bool is_last() const { return end_ <= 2 * kStripWidth && end_ % 2 == 0; }

#if GSVR_LANES == 16
    // Both rows of a vector step.
    vf step(const float *p) const {
        const vf a = load(p), b = has_right_ ? load(p + right_) : vf{};
        const vf even = __builtin_shufflevector(a, b, 0, 2, 4, 6, 16, 18, 20, 22, 8, 10, 12, 14, 24,
                                                26, 28, 30);
        const vf odd = __builtin_shufflevector(a, b, 1, 3, 5, 7, 17, 19, 21, 23, 9, 11, 13, 15, 25,
                                               27, 29, 31);
        const vf edge =
            __builtin_shufflevector(a, a, 0, 0, 0, 0, 0, 0, 0, 0, 8, 8, 8, 8, 8, 8, 8, 8);
        const vf before = left_ ? load(p + before_) : edge,
                 after = has_after_ ? load(p + after_) : vf{};
        const vf back = __builtin_shufflevector(before, odd, 7, 16, 17, 18, 19, 20, 21, 22, 15, 24,
                                                25, 26, 27, 28, 29, 30);
        vf ahead = __builtin_shufflevector(even, after, 1, 2, 3, 4, 5, 6, 7, 16, 9, 10, 11, 12, 13,
                                           14, 15, 24);
        if (is_last())
            for (int k : {end_ / 2 - 1, end_ / 2 - 1 + kStripWidth}) ahead[k] = odd[k];
        return downsampled(even, odd, back, ahead);
    }
#else
    v8 step(const float *p) const {
        const v8 a = load8(p), b = has_right_ ? load8(p + right_) : v8{};
        const float before = left_ ? p[before_ + kStripWidth - 1] : p[0];
        const float after = has_after_ ? p[after_] : 0.0f;
        const v8 even = __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14);
        const v8 odd = __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15);
        const v8 back = __builtin_shufflevector(before - v8{}, odd, 0, 8, 9, 10, 11, 12, 13, 14);
        v8 ahead = __builtin_shufflevector(even, after - v8{}, 1, 2, 3, 4, 5, 6, 7, 8);
        if (is_last()) ahead[end_ / 2 - 1] = odd[end_ / 2 - 1];
        return downsampled(even, odd, back, ahead);
    }
#endif

    const Pixels &fine_;
    const int left_;
    const bool has_right_, has_after_;
    const std::ptrdiff_t before_, right_, after_;  // from the left strip
    const int end_;                                // of the row, in pixels from the left strip
};

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
        const FineStrips strips(fine, fine_width, strip);
        const auto at = [&](int row) {
            return row < rows.end && !zero ? strips.rows(row, row + 1 < rows.end)
                                           : DownsampledRows{};
        };
        const auto put = [&](float *p, int channel_stride, int c, v8 v) {
            store8(p + c * channel_stride, (v8)((i8)v & inside));
        };
        int row = rows.begin / 2;
        DownsampledRows here = at(2 * row);
        v8 above[kSums];
        float *edge = edges + strip * kRowFloats;
        for (int c = 0; c < kSums; ++c) {
            above[c] = rows.begin ? v8{} : here.upper[c];
            put(edge, kStripWidth, c, 0.25f * here.upper[c]);
        }
        for (; 2 * row < rows.end; ++row) {
            // Below the picture, upsampling repeats the last row: that row takes the missing place.
            const bool bottom = row == last_row && fine_height % 2 == 0;
            const DownsampledRows next = at(2 * row + 2);
            float *p = strip_row(coarse, strip, row);
            for (int c = 0; c < kSums; ++c) {
                const v8 below = bottom ? here.lower[c] : next.upper[c];
                put(p, kChannelFloats, c,
                    downsampled(here.upper[c], here.lower[c], above[c], below));
                above[c] = here.lower[c];
            }
            here = next;
        }
        for (int c = 0; c < kSums; ++c)
            put(edge + count * kRowFloats, kStripWidth, c, 0.25f * above[c]);
        // The rows below the picture in the last vector.
        for (; row % kVectorRows; ++row)
            for (int c = 0; c < kSums; ++c)
                put(strip_row(coarse, strip, row), kChannelFloats, c, v8{});
    }
}
