// Rasterises splats, and the gradient of rasterisation. Included by kernels.cpp.

// Distances in floats: from one channel of a vector to the next, and from one vector of a segment
// to the next.
constexpr int kChannelFloats = kVectorRows * kStripWidth;
constexpr int kStepFloats = kVectorRows * kRowFloats;

static inline float *first_pixel(const Pixels &pixels, const Segments &c, int n) {
    const unsigned x = static_cast<unsigned>(c.x[n]);
    return pixels.data + pixels.strip_offset(static_cast<int>(x / kStripWidth)) +
           (c.row[n] - pixels.first_row) * kRowFloats + x % kStripWidth;
}

static inline void add_segment(const Splats &s, const Segments &c, int n, const Pixels &pixels) {
    const int l = lane_of(c, n);
    const float red = s.colour[0][l], green = s.colour[1][l], blue = s.colour[2][l];
    const float share = s.colour[3][l];
    float *p = first_pixel(pixels, c, n);
    for_steps(s, c, n, [&](vf e) {
        const vf w = max(e - kCutoff, vf{});
        store(p, load(p) + red * w);
        store(p + kChannelFloats, load(p + kChannelFloats) + green * w);
        store(p + 2 * kChannelFloats, load(p + 2 * kChannelFloats) + blue * w);
        store(p + 3 * kChannelFloats, load(p + 3 * kChannelFloats) + share * w);
        p += kStepFloats;
    });
}

void rasterise(const SplatLayer &layer, Tile tile, Pixels pixels) {
    const FlushDenormals flush;
    Segments c;
    const auto add = [&] {
        for (int n = 0; n < c.count; ++n) add_segment(block_of(layer, c, n), c, n, pixels);
    };
    for_segments(layer, tile, c, [](int) {}, add);
}

// Adds the moments of one segment to the moments of its splat; `pixels` is the gradient of the
// pixels, and the lanes are summed later. Moments along y need no multiplications: they are prefix
// sums.
static inline void add_moments(const Splats &s, const Segments &c, int n, const Pixels &pixels,
                               vf *total) {
    const int l = lane_of(c, n);
    const float red = s.colour[0][l], green = s.colour[1][l], blue = s.colour[2][l];
    const float share = s.colour[3][l];
    vf r = total[0], g = total[1], b = total[2], a = total[8], p0{}, p1{}, p2{};
    const float *p = first_pixel(pixels, c, n);
    for_steps(s, c, n, [&](vf e) {
        const vf w = max(e - kCutoff, vf{});
        const vf dr = load(p), dg = load(p + kChannelFloats), db = load(p + 2 * kChannelFloats);
        const vf da = load(p + 3 * kChannelFloats);
        r += w * dr;
        g += w * dg;
        b += w * db;
        a += w * da;
        p2 += p1;
        p1 += p0;
        p0 += where(e > kCutoff, e) * (red * dr + green * dg + blue * db + share * da);
        p += kStepFloats;
    });
    // A vector with m vectors below it is counted m times in p1 and m (m - 1) / 2 times in p2.
    const int steps = c.steps[n] > 0 ? c.steps[n] : -c.steps[n];
    const vf x = c.dx[n] + kPixelX;
    const vf last =
        (static_cast<float>(c.row[n] + (steps - 1) * kVectorRows) + 0.5f - s.cy[l]) + kPixelY;
    const vf y = last * p0 - kVectorRows * p1;
    total[0] = r;
    total[1] = g;
    total[2] = b;
    total[3] += p0 * x;
    total[4] += y;
    total[5] += p0 * x * x;
    total[6] += y * x;
    total[7] += last * (last * p0 - 2.0f * kVectorRows * p1) +
                (kVectorRows * kVectorRows) * (2.0f * p2 + p1);
    total[8] = a;
}

void gather_moments(const SplatLayer &layer, Tile tile, Pixels pixels, Moments *moments) {
    const FlushDenormals flush;
    Segments c;
    const auto moments_of = [&](int block) -> Moments & {
        return moments[layer.slot(block, tile.rows)];
    };
    const auto enter = [&](int block) {
        if (layer.first(block, tile)) moments_of(block) = {};
    };
    // The lanes of the segments of a splat, which follow each other, are summed once.
    const auto gather = [&] {
        for (int n = 0; n < c.count;) {
            const int splat = c.splat[n];
            const Splats &s = block_of(layer, c, n);
            vf total[9] = {};
            for (; n < c.count && c.splat[n] == splat; ++n) add_moments(s, c, n, pixels, total);
            Moments &own = moments_of(splat / kBlock);
            float *of = own.of[splat % kBlock];
            store8(of, load8(of) + sums(total));
            own.weight[splat % kBlock] += sum(total[8]);
        }
    };
    for_segments(layer, tile, c, enter, gather);
}

void backward(const GopArrays &gop, const Frame &frame, const SplatLayer (&layers)[kLayers],
              const Moments *moments, int begin, int end, const GopArrays &gradient, float *xy,
              float *xt_line, float *yt_line) {
    const FlushDenormals flush;
    for (int block = begin; block < end; ++block) {
        const Splats &s = layers[0].splats[block];
        Moments total = {};
        for (const SplatLayer &layer : layers) {
            const BlockBox &box = layer.boxes[block];
            const Moments *part = moments + box.slot;
            for (int slot = 0; slot < block_bands(box, layer.band_rows); ++slot, ++part)
                for (int l = 0; l < kBlock; ++l) {
                    store8(total.of[l], load8(total.of[l]) + load8(part->of[l]));
                    total.weight[l] += part->weight[l];
                }
        }
        for (int l = 0; l < kBlock; l += kLanes) {
            const int i = block * kBlock + l, count = min(gop.n - i, kLanes);
            if (count <= 0) break;
            const vi drawn = load(s.row_begin + l) < load(s.row_end + l);
            deform_backward(gop, frame, total, l, drawn, i, count, gradient, xy, xt_line, yt_line);
        }
    }
}
