// Looks up the tri-plane at the positions of kLanes Gaussians, and the gradient of the lookup.
// Included by kernels.cpp.

// The two neighbouring cells of a line of cells that a coordinate lies between, and their weights.
struct Cells {
    vi low, high;
    vf low_weight, high_weight;
    vi inside;  // mask: the coordinate was not clamped, so the gradient of the position is not zero
};

static inline Cells cells(vf position, int size) {
    const vf u = (position + 1.0f) * (0.5f * static_cast<float>(size - 1));
    // max() comes first: it turns NaN into 0.
    const vf clamped = min(max(u, vf{}), broadcast(static_cast<float>(size - 1)));
    Cells c;
    c.low = truncate(clamped);
    c.high = min(c.low + 1, broadcast(size - 1));
    c.high_weight = clamped - to_float(c.low);
    c.low_weight = 1.0f - c.high_weight;
    c.inside = u == clamped;
    return c;
}

// The cells of kLanes Gaussians, as indices of floats in the grids, and the weights of the cells.
struct alignas(64) Lookup {
    int xy[4][kLanes];  // cells top left, top right, bottom left, bottom right
    int x[2][kLanes], y[2][kLanes];
    float xy_weight[4][kLanes], x_weight[2][kLanes], y_weight[2][kLanes];
    vi x_inside, y_inside;
};

static inline void find(const GopArrays &gop, const Fields<2> &position, Lookup &at) {
    const Cells x = cells(position.column[0], gop.gx), y = cells(position.column[1], gop.gy);
    const vi columns[2] = {x.low, x.high}, rows[2] = {y.low, y.high};
    const vf column_weights[2] = {x.low_weight, x.high_weight};
    const vf row_weights[2] = {y.low_weight, y.high_weight};
    for (int k = 0; k < 2; ++k) {
        store(at.x[k], columns[k] * kChannels);
        store(at.y[k], rows[k] * kChannels);
        store(at.x_weight[k], column_weights[k]);
        store(at.y_weight[k], row_weights[k]);
    }
    for (int k = 0; k < 4; ++k) {
        store(at.xy[k], (rows[k / 2] * gop.gx + columns[k % 2]) * kChannels);
        store(at.xy_weight[k], row_weights[k / 2] * column_weights[k % 2]);
    }
    at.x_inside = x.inside;
    at.y_inside = y.inside;
}

// The values of the three planes for one Gaussian, all eight channels; the field is their product.
struct Factors {
    v8 xy, xt, yt;
};

static inline Factors factors(const GopArrays &gop, const Frame &frame, const Lookup &at, int l) {
    return {(load8(gop.xy + at.xy[0][l]) * at.xy_weight[0][l] +
             load8(gop.xy + at.xy[1][l]) * at.xy_weight[1][l]) +
                (load8(gop.xy + at.xy[2][l]) * at.xy_weight[2][l] +
                 load8(gop.xy + at.xy[3][l]) * at.xy_weight[3][l]),
            load8(frame.xt_line + at.x[0][l]) * at.x_weight[0][l] +
                load8(frame.xt_line + at.x[1][l]) * at.x_weight[1][l],
            load8(frame.yt_line + at.y[0][l]) * at.y_weight[0][l] +
                load8(frame.yt_line + at.y[1][l]) * at.y_weight[1][l]};
}

static inline void lookup(const GopArrays &gop, const Frame &frame, const Fields<2> &position,
                          vf *offset) {
    Lookup at;
    find(gop, position, at);
    alignas(64) float rows[kLanes * kChannels];
    for (int l = 0; l < kLanes; ++l) {
        const Factors f = factors(gop, frame, at, l);
        store8(rows + l * kChannels, f.xy * f.xt * f.yt);
    }
    to_columns(rows, offset);
}

// Adds the gradient of the looked-up values to the gradients of the grids and of the positions. The
// gradient of the lanes from `count` on must be zero.
static inline void lookup_backward(const GopArrays &gop, const Frame &frame,
                                   const Fields<2> &position, int count, const vf *offset_gradient,
                                   float *xy, float *xt_line, float *yt_line,
                                   Fields<2> &position_gradient) {
    Lookup at;
    find(gop, position, at);
    alignas(64) float rows[kLanes * kChannels];
    to_rows(offset_gradient, rows);
    const auto add = [](float *p, v8 v) { store8(p, load8(p) + v); };
    vf moved[2] = {};
    for (int l = 0; l < count; ++l) {
        const Factors f = factors(gop, frame, at, l);
        const v8 gradient = load8(rows + l * kChannels);
        const v8 gxy = gradient * (f.xt * f.yt);
        const v8 gxt = gradient * (f.xy * f.yt);
        const v8 gyt = gradient * (f.xy * f.xt);
        for (int k = 0; k < 4; ++k) add(xy + at.xy[k][l], gxy * at.xy_weight[k][l]);
        for (int k = 0; k < 2; ++k) {
            add(xt_line + at.x[k][l], gxt * at.x_weight[k][l]);
            add(yt_line + at.y[k][l], gyt * at.y_weight[k][l]);
        }
        const v8 top_left = load8(gop.xy + at.xy[0][l]), top_right = load8(gop.xy + at.xy[1][l]);
        const v8 left = load8(gop.xy + at.xy[2][l]), right = load8(gop.xy + at.xy[3][l]);
        const v8 along_x =
            (top_right - top_left) * at.y_weight[0][l] + (right - left) * at.y_weight[1][l];
        const v8 along_y =
            (left - top_left) * at.x_weight[0][l] + (right - top_right) * at.x_weight[1][l];
        const v8 xt = load8(frame.xt_line + at.x[1][l]) - load8(frame.xt_line + at.x[0][l]);
        const v8 yt = load8(frame.yt_line + at.y[1][l]) - load8(frame.yt_line + at.y[0][l]);
        moved[0][l] = sum8(gxy * along_x + gxt * xt);
        moved[1][l] = sum8(gxy * along_y + gyt * yt);
    }
    position_gradient.column[0] +=
        where(at.x_inside, moved[0] * (0.5f * static_cast<float>(gop.gx - 1)));
    position_gradient.column[1] +=
        where(at.y_inside, moved[1] * (0.5f * static_cast<float>(gop.gy - 1)));
}
