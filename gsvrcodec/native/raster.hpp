// Rasterisation of splats and its gradient. Included by kernels.cpp.

constexpr int kChannelFloats = kRows * kStripWidth;  // from one channel to the next
constexpr int kStepFloats = kRows * kRowFloats;      // from one vector of a column to the next

static inline float *pixel(const Pixels &pixels, int x, int row) {
    return pixels.data + (x / kStripWidth) * (static_cast<std::ptrdiff_t>(pixels.rows) * kRowFloats) +
           (row - pixels.first_row) * static_cast<std::ptrdiff_t>(kRowFloats) + x % kStripWidth;
}

void rasterise(const Splats *splats, const Extent *extents, int blocks, Extent band, Pixels pixels) {
    const FlushDenormals flush;
    for (int block = 0; block < blocks; ++block) {
        if (extents[block].begin >= band.end || extents[block].end <= band.begin) continue;
        const Splats &s = splats[block];
        for_columns(s, band, [&](int l, const Column &c) {
            const float red = s.colour[0][l], green = s.colour[1][l], blue = s.colour[2][l];
            float *p = pixel(pixels, c.x, c.row);
            for_steps(s, l, c, [&](vf e) {
                const vf w = max(e - kCutoff, vf{});
                store(p, load(p) + red * w);
                store(p + kChannelFloats, load(p + kChannelFloats) + green * w);
                store(p + 2 * kChannelFloats, load(p + 2 * kChannelFloats) + blue * w);
                p += kStepFloats;
            });
        });
    }
}

// Adds the sums of the gradient `pixels` over one column to a splat's moments. The moments about
// its rows are prefix sums of prefix sums: additions alone.
static inline void add_moments(const Splats &s, int l, const Column &c, const Pixels &pixels,
                               Moments &moments) {
    const float red = s.colour[0][l], green = s.colour[1][l], blue = s.colour[2][l];
    vf r{}, g{}, b{}, p0{}, p1{}, p2{};
    const float *p = pixel(pixels, c.x, c.row);
    for_steps(s, l, c, [&](vf e) {
        const vf w = max(e - kCutoff, vf{});
        const vf dr = load(p), dg = load(p + kChannelFloats), db = load(p + 2 * kChannelFloats);
        r += w * dr;
        g += w * dg;
        b += w * db;
        p2 += p1;
        p1 += p0;
        p0 += where(e > kCutoff, e) * (red * dr + green * dg + blue * db);
        p += kStepFloats;
    });
    // With m vectors below a pixel in its column: p1 sums m, p2 sums m (m - 1) / 2.
    const vf x = c.dx + kPixelX;
    const vf last = (static_cast<float>(c.row + (c.steps - 1) * kRows) + 0.5f - s.cy[l]) + kPixelY;
    const vf y = last * p0 - kRows * p1;
    const vf yy = last * (last * p0 - 2.0f * kRows * p1) + (kRows * kRows) * (2.0f * p2 + p1);
    const vf parts[8] = {r, g, b, p0 * x, y, p0 * x * x, y * x, yy};
    store8(moments.colour, load8(moments.colour) + sums(parts));
}

void backward(const Model &model, const Frame &frame, const Splats *splats, const Extent *extents,
              Pixels pixels, int begin, int end, const Model &gradient, float *xy, float *xt_line,
              float *yt_line) {
    const FlushDenormals flush;
    for (int block = begin; block < end; ++block) {
        const Splats &s = splats[block];
        Moments moments[kBlock] = {};
        const Extent extent = extents[block];
        for (int row = extent.begin / kBandRows * kBandRows; row < extent.end; row += kBandRows)
            for_columns(s, {row, min(row + kBandRows, frame.height)}, [&](int l, const Column &c) {
                add_moments(s, l, c, pixels, moments[l]);
            });
        for (int l = 0; l < kBlock; l += kLanes) {
            const int i = block * kBlock + l, count = min(model.n - i, kLanes);
            if (count <= 0) break;
            const vi drawn = load(s.row_begin + l) < load(s.row_end + l);
            deform_backward(model, frame, moments + l, drawn, i, count, gradient, xy, xt_line, yt_line);
        }
    }
}
