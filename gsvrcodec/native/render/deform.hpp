// Deforms kLanes Gaussians at a time to one frame's time and projects them to their pyramid levels
// (spec sections 8.2 and 8.4). Included by kernels.cpp.

// Values of kLanes Gaussians that both the projection and its gradient need.
struct Deformed {
    Fields<2> position;
    vf field[kChannels];   // product of the three planes, one value for each channel
    vf offset[kChannels];  // field * (1 - dynamic indicator)
    vf scale_base[2];      // exp(log_scale)
    vf scale_sum[2];       // scale_base + offset, before the minimum
    vf scale[2];
    vi level;
    vf unit;         // 2^-level
    vi wide[2];      // mask: the variance is above the minimum
    vf variance[2];  // along the Gaussian's axes, px^2 of the coded frame
    vf amplitude;
    vf opacity;                       // of a mean; 1 of a sum
    vi opacity_free;                  // mask: the log-opacity is within its bounds
    vi finite;                        // mask: the lane holds a Gaussian, and its scales are finite
    vf sine, cosine;                  // of twice the rotation angle
    vf half_difference;               // half the difference of the two variances
    vf gate;                          // 1 - dynamic indicator
    vf sigma_xx, sigma_xy, sigma_yy;  // px^2 of the level
    vf inverse_xx, inverse_xy, inverse_yy;
};

// The field of Gaussians that the tri-plane has no effect on is not looked up, unless
// `whole_field`: the gradient of their indicators needs it.
static inline Deformed deform(const GopArrays &gop, const Frame &frame, int i, int count,
                              bool whole_field) {
    Deformed d;
    d.finite = kLaneIndex < broadcast(count);
    d.position = load_fields<2>(gop.position, i, count);
    d.gate = 1.0f - load_fields<1>(gop.indicator, i, count).column[0];
    if (gop.gx > 0 && (whole_field || bits(d.gate != 0.0f)))
        lookup(gop, frame, d.position, d.field);
    else
        for (vf &value : d.field) value = vf{};
    for (int k = 0; k < kChannels; ++k) d.offset[k] = d.gate * d.field[k];
    const Fields<2> log_scale = load_fields<2>(gop.log_scale, i, count);
    for (int k = 0; k < 2; ++k) {
        d.scale_base[k] =
            exp2(kLog2E * max(min(log_scale.column[k], broadcast(20.0f)), broadcast(-20.0f)));
        d.scale_sum[k] = d.scale_base[k] + d.offset[2 + k];
        d.scale[k] = max(d.scale_sum[k], broadcast(kMinScale));
        // max() has turned NaN into the smallest scale, but such a Gaussian must not be drawn.
        d.finite &= is_finite(log_scale.column[k]) & is_finite(d.offset[2 + k]);
    }
    sincos(2.0f * (load_fields<1>(gop.rotation, i, count).column[0] + d.offset[4]), d.sine,
           d.cosine);

    const vf least = min(log_scale.column[0], log_scale.column[1]);
    d.level = vi{};
    for (int level = 1; level < kLevels; ++level)
        d.level -= (vi)(least >= frame.level_log_scale[level]);
    d.unit = (vf)((127 - d.level) << 23);
    const vi above = d.level > 0;
    const vf area = 1.0f / (d.unit * d.unit * (frame.zoom * frame.zoom));
    const float antialias = kAntialias * max(1.0f / (frame.zoom * frame.zoom) - 1.0f, 0.0f);
    const vf widening = above ? -kUpsampling * area : broadcast(kDilation + antialias);
    const vf floor = where(above, kMinVariance * area);
    vf ratio = broadcast(1.0f);
    for (int k = 0; k < 2; ++k) {
        const vf square = d.scale[k] * d.scale[k];
        d.wide[k] = square + widening > floor;
        d.variance[k] = max(square + widening, floor);
        ratio *= (square + kDilation) / d.variance[k];
    }
    d.amplitude = sqrt(ratio);
    const vf log_opacity =
        load_fields<1>(gop.log_opacity, i, count).column[0] + (frame.mean ? d.offset[5] : vf{});
    const vf bounded =
        max(min(log_opacity, broadcast(kMostLogOpacity)), broadcast(-kMostLogOpacity));
    d.opacity_free = bounded == log_opacity;
    d.opacity = frame.mean ? exp2(kLog2E * bounded) : broadcast(1.0f);
    // min() has turned NaN into the largest opacity, but such a Gaussian must not be drawn.
    if (frame.mean) d.finite &= is_finite(log_opacity);
    const vf mean = 0.5f * (d.variance[0] + d.variance[1]);
    d.half_difference = 0.5f * (d.variance[0] - d.variance[1]);
    const vf zx =
        d.unit * (static_cast<float>(frame.width) / static_cast<float>(frame.coded_width));
    const vf zy =
        d.unit * (static_cast<float>(frame.height) / static_cast<float>(frame.coded_height));
    d.sigma_xx = (mean + d.half_difference * d.cosine) * (zx * zx);
    d.sigma_xy = d.half_difference * d.sine * (zx * zy);
    d.sigma_yy = (mean - d.half_difference * d.cosine) * (zy * zy);
    // The determinant is the product of the variances along the axes. The products of the
    // covariances of a thin Gaussian would cancel.
    const vf inverse_det = 1.0f / (d.variance[0] * d.variance[1] * (zx * zx * zy * zy));
    d.inverse_xx = d.sigma_yy * inverse_det;
    d.inverse_xy = -d.sigma_xy * inverse_det;
    d.inverse_yy = d.sigma_xx * inverse_det;
    return d;
}

// A mask: the Gaussians that look the same at all times.
static inline vi is_static(const GopArrays &gop, vf gate, const Fields<2> &linear,
                           const Fields<2> &quadratic) {
    vi still = (vi)(gate == 0.0f) | (gop.gx > 0 ? vi{} : ~vi{});
    for (int k = 0; k < 2; ++k)
        still &= (vi)(linear.column[k] == 0.0f) & (vi)(quadratic.column[k] == 0.0f);
    return still;
}

// Projects the Gaussians [i, i + count), count <= kLanes, to the entries of `out` from l on.
static inline void project_lanes(const GopArrays &gop, const Frame &frame, int i, int count,
                                 Splats &out, int l) {
    const Deformed d = deform(gop, frame, i, count, false);
    const Fields<2> linear = load_fields<2>(gop.linear, i, count);
    const Fields<2> quadratic = load_fields<2>(gop.quadratic, i, count);
    const Fields<3> colour = load_fields<3>(gop.colour, i, count);
    const vf width = d.unit * static_cast<float>(frame.width);
    const vf height = d.unit * static_cast<float>(frame.height);
    const vi round_up = (1 << d.level) - 1;
    const vf columns = to_float((frame.width + round_up) >> d.level);
    const vf rows = to_float((frame.height + round_up) >> d.level);
    vf centre[2];
    for (int k = 0; k < 2; ++k) {
        const vf mu = d.position.column[k] + linear.column[k] * frame.tau +
                      quadratic.column[k] * (frame.tau * frame.tau) + d.offset[k];
        centre[k] = (mu + 1.0f) * (0.5f * (k ? height : width));
    }
    const vf reach_x = sqrt(2.0f * kSupport * d.sigma_xx),
             reach_y = sqrt(2.0f * kSupport * d.sigma_yy);
    const vf slope = d.sigma_xy / d.sigma_xx;
    const vf across = 0.5f * kLog2E / d.sigma_xx, down = 0.5f * kLog2E * d.inverse_yy;

    // These comparisons are false for NaN, so that NaN or infinity in any parameter gives an empty
    // splat. The limits keep all later sums of squares finite.
    constexpr float kFar = 1e6f;
    vi drawn = d.finite & (reach_x < kFar) & (reach_y < kFar) & (absolute(centre[0]) < kFar) &
               (absolute(centre[1]) < kFar) & (absolute(slope) < kFar) & (across < kFar * kFar) &
               (down < kFar * kFar) & (centre[0] + reach_x >= 0.0f) &
               (centre[0] - reach_x <= columns);
    const vf share = d.amplitude * d.opacity;
    for (int k = 0; k < 3; ++k) {
        const vf c = share * (colour.column[k] + (frame.mean ? vf{} : d.offset[5 + k]));
        drawn &= is_finite(c);
        store(out.colour[k] + l, c);
    }
    store(out.colour[3] + l, share);

    store(out.cx + l, centre[0]);
    store(out.cy + l, centre[1]);
    store(out.slope + l, slope);
    store(out.across + l, across);
    store(out.down + l, down);
    store(out.decay + l, exp2(-min((2.0f * kVectorRows * kVectorRows) * down, broadcast(120.0f))));
    store(out.lowest_dx + l, d.sigma_xy / d.sigma_yy * reach_y);
    store(out.x_begin + l, first_inside(centre[0] - reach_x, columns) & -kVectorColumns & drawn);
    store(out.x_end + l, end_inside(centre[0] + reach_x, columns) & drawn);
    store(out.row_begin + l, first_inside(centre[1] - reach_y, rows) & drawn);
    store(out.row_end + l, end_inside(centre[1] + reach_y, rows) & drawn);
    const vi still = is_static(gop, d.gate, linear, quadratic);
    store(out.layer + l, d.level + (frame.separate_static ? still & kLevels : vi{}));
}

void project(const GopArrays &gop, const Frame &frame, int begin, int end, Splats *splats,
             BlockBox *boxes) {
    const FlushDenormals flush;
    for (int block = begin; block < end; ++block) {
        Splats &out = splats[block];
        for (int l = 0; l < kBlock; l += kLanes) {
            const int i = block * kBlock + l;
            project_lanes(gop, frame, i, max(min(gop.n - i, kLanes), 0), out, l);
        }
        unsigned layers = 0;
        for (int l = 0; l < kBlock; ++l) layers |= 1u << out.layer[l];
        BlockBox *own = boxes + block;
        for (int layer = 0; layer < kLayers; ++layer, own += blocks(gop)) {
            own->rows = own->columns = {0, 0};
            if (!(layers >> layer & 1)) continue;
            Range rows{frame.height, 0}, columns{frame.width, 0};
            for (int l = 0; l < kBlock; ++l) {
                const bool drawn = (out.row_begin[l] < out.row_end[l]) &
                                   (out.x_begin[l] < out.x_end[l]) & (out.layer[l] == layer);
                rows.begin = drawn ? min(rows.begin, out.row_begin[l]) : rows.begin;
                rows.end = drawn ? max(rows.end, out.row_end[l]) : rows.end;
                columns.begin = drawn ? min(columns.begin, out.x_begin[l]) : columns.begin;
                columns.end = drawn ? max(columns.end, out.x_end[l]) : columns.end;
            }
            own->rows = rows;
            own->columns = columns;
        }
    }
}

double static_share(const GopArrays &gop) {
    double of_static = 0.0, of_all = 0.0;
    for (int i = 0; i < gop.n; i += kLanes) {
        const int count = min(gop.n - i, kLanes);
        const Fields<2> log_scale = load_fields<2>(gop.log_scale, i, count);
        vf log_area{}, least = broadcast(static_cast<float>(kLevels));
        for (int k = 0; k < 2; ++k) {
            const vf scale =
                max(min(kLog2E * log_scale.column[k], broadcast(20.0f)), broadcast(0.0f));
            log_area += scale;
            least = min(least, scale);
        }
        const vi level = min(truncate(least), broadcast(kLevels - 1));
        const vf area =
            where(kLaneIndex < broadcast(count), exp2(log_area - 2.0f * to_float(level)));
        const vf gate = 1.0f - load_fields<1>(gop.indicator, i, count).column[0];
        const vi still = is_static(gop, gate, load_fields<2>(gop.linear, i, count),
                                   load_fields<2>(gop.quadratic, i, count));
        of_all += static_cast<double>(sum(area));
        of_static += static_cast<double>(sum(where(still, area)));
    }
    return of_all > 0.0 ? of_static / of_all : 0.0;
}
