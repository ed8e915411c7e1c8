// Deformation at one time and projection to the frame, kLanes Gaussians at a time.
// Included by kernels.cpp.

// Where a Gaussian reads the grids: cells and weights of its bilinear lookups.
struct Lookup {
    int x0, x1, y0, y1;
    float fx, fy;
    bool x_inside, y_inside;  // not clamped to the border: the lookup moves with the position
};

struct Cell {
    int low, high;
    float weight;
    bool inside;
};

static inline Cell cell(float position, int size) {
    const float u = (position + 1.0f) * 0.5f * static_cast<float>(size - 1);
    // Comparisons in this order send NaN to the border.
    const float clamped = u > 0.0f ? (u < static_cast<float>(size - 1) ? u : size - 1.0f) : 0.0f;
    const int low = static_cast<int>(clamped);
    return {low, min(low + 1, size - 1), clamped - static_cast<float>(low), u == clamped};
}

static inline Lookup lookup(const Model &model, int i) {
    const Cell x = cell(model.position[2 * i], model.gx);
    const Cell y = cell(model.position[2 * i + 1], model.gy);
    return {x.low, x.high, y.low, y.high, x.weight, y.weight, x.inside, y.inside};
}

static inline v8 mix(v8 a, v8 b, float t) { return a + (b - a) * t; }

// The three factors of the tri-plane's offsets, for eight channels at once.
struct Factors {
    v8 xy, xt, yt;
};

static inline Factors factors(const Model &model, const Frame &frame, const Lookup &at) {
    const float *top = model.xy + at.y0 * model.gx * kChannels;
    const float *bottom = model.xy + at.y1 * model.gx * kChannels;
    const int x0 = at.x0 * kChannels, x1 = at.x1 * kChannels;
    return {mix(mix(load8(top + x0), load8(top + x1), at.fx),
                mix(load8(bottom + x0), load8(bottom + x1), at.fx), at.fy),
            mix(load8(frame.xt_line + x0), load8(frame.xt_line + x1), at.fx),
            mix(load8(frame.yt_line + at.y0 * kChannels), load8(frame.yt_line + at.y1 * kChannels),
                at.fy)};
}

// Column `column` of `count` rows of an (N, width) array, zero beyond.
static inline vf gather(const float *array, int width, int column, int count) {
    vf v{};
    for (int l = 0; l < count; ++l) v[l] = array[l * width + column];
    return v;
}

static inline void scatter(float *array, int width, int column, int count, vf v) {
    for (int l = 0; l < count; ++l) array[l * width + column] = v[l];
}

// What projection and its gradient both need of kLanes Gaussians.
struct Deformed {
    vf offset[kChannels];  // of the tri-plane
    vf scale_base[2];      // exp(log_scale)
    vf scale_sum[2];       // before the minimum is applied
    vf scale[2];
    vf sine, cosine;       // of twice the angle
    vf spread;             // (s0^2 - s1^2) / 2
    vf gate;               // 1 - alpha
    vf sigma_xx, sigma_xy, sigma_yy;  // px^2 of the rendered frame
    vf inverse_xx, inverse_xy, inverse_yy;
};

static inline Deformed deform(const Model &model, const Frame &frame, int i, int count) {
    Deformed d;
    for (vf &offset : d.offset) offset = vf{};
    if (model.gx > 0) {
        alignas(64) float values[kLanes * kChannels] = {};
        for (int l = 0; l < count; ++l) {
            const Factors f = factors(model, frame, lookup(model, i + l));
            store8(values + l * kChannels, f.xy * f.xt * f.yt);
        }
        for (int k = 0; k < kChannels; ++k) d.offset[k] = gather(values, kChannels, k, kLanes);
    }
    for (int k = 0; k < 2; ++k) {
        const vf log_scale = gather(model.log_scale + 2 * i, 2, k, count);
        d.scale_base[k] = exp(max(min(log_scale, splat(20.0f)), splat(-20.0f)));
        d.scale_sum[k] = d.scale_base[k] + d.offset[2 + k];
        d.scale[k] = max(d.scale_sum[k], splat(kMinScale));
    }
    sincos(2.0f * (gather(model.rotation + i, 1, 0, count) + d.offset[4]), d.sine, d.cosine);
    d.gate = 1.0f - gather(model.alpha + i, 1, 0, count);

    const vf s0 = d.scale[0] * d.scale[0], s1 = d.scale[1] * d.scale[1];
    const vf mean = 0.5f * (s0 + s1) + kDilation;
    d.spread = 0.5f * (s0 - s1);
    const float zx = static_cast<float>(frame.width) / static_cast<float>(frame.coded_width);
    const float zy = static_cast<float>(frame.height) / static_cast<float>(frame.coded_height);
    d.sigma_xx = (mean + d.spread * d.cosine) * (zx * zx);
    d.sigma_xy = d.spread * d.sine * (zx * zy);
    d.sigma_yy = (mean - d.spread * d.cosine) * (zy * zy);
    // The determinant from the axes: the products of a thin Gaussian's entries would cancel.
    const vf inverse_det = 1.0f / ((s0 + kDilation) * (s1 + kDilation) * (zx * zx * zy * zy));
    d.inverse_xx = d.sigma_yy * inverse_det;
    d.inverse_xy = -d.sigma_xy * inverse_det;
    d.inverse_yy = d.sigma_xx * inverse_det;
    return d;
}

void project(const Model &model, const Frame &frame, int begin, int end, Splat *splats) {
    const float tau = frame.tau, tau2 = tau * tau;
    for (int i = begin; i < end; i += kLanes) {
        const int count = min(kLanes, end - i);
        const Deformed d = deform(model, frame, i, count);
        vf centre[2];
        for (int k = 0; k < 2; ++k) {
            const vf mu = gather(model.position + 2 * i, 2, k, count) +
                          gather(model.linear + 2 * i, 2, k, count) * tau +
                          gather(model.quadratic + 2 * i, 2, k, count) * tau2 +
                          d.gate * d.offset[k];
            centre[k] = (mu + 1.0f) * (0.5f * static_cast<float>(k ? frame.height : frame.width));
        }
        const vf k = exp(-min(d.inverse_yy, splat(80.0f)));
        const vf half_width = sqrt(2.0f * kSupport * d.sigma_xx);
        const vf half_height = sqrt(2.0f * kSupport * d.sigma_yy);
        const vf slope = d.sigma_xy / d.sigma_xx;
        const vf top = d.sigma_xy / d.sigma_yy * half_height;
        const vf bend = 1.0f / (d.sigma_xx * d.inverse_yy);
        for (int l = 0; l < count; ++l) {
            Splat &s = splats[i + l];
            s = {centre[0][l], centre[1][l], d.inverse_xx[l], d.inverse_xy[l], d.inverse_yy[l], k[l],
                 half_width[l], slope[l], top[l], bend[l],
                 {0.0f, 0.0f, 0.0f}, 0, 0};
            for (int c = 0; c < 3; ++c)
                s.colour[c] = model.colour[3 * (i + l) + c] + d.offset[5 + c][l];
            // Written so that NaN and infinity anywhere make an empty splat.
            constexpr float kFar = 1e6f;
            const float reach_x = half_width[l], reach_y = half_height[l];
            const bool finite = reach_x < kFar && reach_y < kFar && s.cx > -kFar && s.cx < kFar &&
                                s.cy > -kFar && s.cy < kFar && bend[l] < kFar * kFar &&
                                s.colour[0] - s.colour[0] == 0.0f &&
                                s.colour[1] - s.colour[1] == 0.0f &&
                                s.colour[2] - s.colour[2] == 0.0f;
            if (!finite || s.cx + reach_x < 0.0f || s.cx - reach_x > static_cast<float>(frame.width))
                continue;
            s.row_begin = max(static_cast<int>(__builtin_ceilf(s.cy - reach_y - 0.5f)), 0);
            s.row_end = min(static_cast<int>(__builtin_floorf(s.cy + reach_y - 0.5f)) + 1, frame.height);
        }
    }
}

// Adds the gradient of the offsets of one Gaussian to the grids and to its position.
static inline void lookup_backward(const Model &model, const Frame &frame, int i, v8 offset_gradient,
                                   float *xy, float *xt_line, float *yt_line, float *position) {
    const Lookup at = lookup(model, i);
    const Factors f = factors(model, frame, at);
    const v8 gxy = offset_gradient * f.xt * f.yt;
    const v8 gxt = offset_gradient * f.xy * f.yt;
    const v8 gyt = offset_gradient * f.xy * f.xt;
    const auto add = [](float *p, v8 v) { store8(p, load8(p) + v); };
    const int x0 = at.x0 * kChannels, x1 = at.x1 * kChannels;
    const int y0 = at.y0 * kChannels, y1 = at.y1 * kChannels;
    add(xy + y0 * model.gx + x0, gxy * ((1.0f - at.fx) * (1.0f - at.fy)));
    add(xy + y0 * model.gx + x1, gxy * (at.fx * (1.0f - at.fy)));
    add(xy + y1 * model.gx + x0, gxy * ((1.0f - at.fx) * at.fy));
    add(xy + y1 * model.gx + x1, gxy * (at.fx * at.fy));
    add(xt_line + x0, gxt * (1.0f - at.fx));
    add(xt_line + x1, gxt * at.fx);
    add(yt_line + y0, gyt * (1.0f - at.fy));
    add(yt_line + y1, gyt * at.fy);
    const float *top = model.xy + y0 * model.gx, *bottom = model.xy + y1 * model.gx;
    if (at.x_inside) {
        const v8 slope = mix(load8(top + x1) - load8(top + x0),
                             load8(bottom + x1) - load8(bottom + x0), at.fy);
        const v8 line = load8(frame.xt_line + x1) - load8(frame.xt_line + x0);
        position[0] += sum8(gxy * slope + gxt * line) * (0.5f * static_cast<float>(model.gx - 1));
    }
    if (at.y_inside) {
        const v8 slope = mix(load8(bottom + x0) - load8(top + x0),
                             load8(bottom + x1) - load8(top + x1), at.fx);
        const v8 line = load8(frame.yt_line + y1) - load8(frame.yt_line + y0);
        position[1] += sum8(gxy * slope + gyt * line) * (0.5f * static_cast<float>(model.gy - 1));
    }
}

static inline void deform_backward(const Model &model, const Frame &frame, const Splat *splats,
                                   const Moments *moments, int i, int count, const Model &gradient,
                                   float *xy, float *xt_line, float *yt_line) {
    const Deformed d = deform(model, frame, i, count);
    constexpr int kWidth = sizeof(Moments) / sizeof(float);
    const auto moment = [&](int column) {
        return gather(&moments[0].colour[0], kWidth, column, count);
    };
    const vf mx = moment(3), my = moment(4), mxx = moment(5), mxy = moment(6), myy = moment(7);
    const vf a = d.inverse_xx, b = d.inverse_xy, c = d.inverse_yy;
    vf offset[kChannels];

    // Centre: px to normalised units, then along the motion.
    const float tau = frame.tau;
    vf galpha{}, gposition[2];
    const vf gcentre[2] = {a * mx + b * my, b * mx + c * my};
    for (int k = 0; k < 2; ++k) {
        gposition[k] = gcentre[k] * (0.5f * static_cast<float>(k ? frame.height : frame.width));
        scatter(gradient.position + 2 * i, 2, k, count, gposition[k]);
        scatter(gradient.linear + 2 * i, 2, k, count, gposition[k] * tau);
        scatter(gradient.quadratic + 2 * i, 2, k, count, gposition[k] * (tau * tau));
        offset[k] = d.gate * gposition[k];
        galpha -= gposition[k] * d.offset[k];
    }
    scatter(gradient.alpha + i, 1, 0, count, galpha);
    for (int k = 0; k < 3; ++k) {
        offset[5 + k] = moment(k);
        scatter(gradient.colour + 3 * i, 3, k, count, offset[5 + k]);
    }

    // Covariance, along its own axes (no cancellation when it is thin): the second moments m in
    // pixels of the coded frame give the gradient m_ij / (2 lambda_i lambda_j).
    const float zx = static_cast<float>(frame.coded_width) / static_cast<float>(frame.width);
    const float zy = static_cast<float>(frame.coded_height) / static_cast<float>(frame.height);
    const vf cxx = mxx * (zx * zx), cxy = mxy * (zx * zy), cyy = myy * (zy * zy);
    const vf half = 0.5f * (cxx - cyy);
    const vf along = half * d.cosine + cxy * d.sine;
    const vf across = cxy * d.cosine - half * d.sine;
    const vf lambda0 = d.scale[0] * d.scale[0] + kDilation;
    const vf lambda1 = d.scale[1] * d.scale[1] + kDilation;
    offset[4] = 2.0f * d.spread * across / (lambda0 * lambda1);
    scatter(gradient.rotation + i, 1, 0, count, offset[4]);
    for (int k = 0; k < 2; ++k) {
        const vf lambda = k ? lambda1 : lambda0;
        const vf moment = 0.5f * (cxx + cyy) + (k ? -along : along);
        const vf gscale = d.scale_sum[k] >= kMinScale ? d.scale[k] * moment / (lambda * lambda) : vf{};
        offset[2 + k] = gscale;
        scatter(gradient.log_scale + 2 * i, 2, k, count, gscale * d.scale_base[k]);
    }

    if (model.gx == 0) return;
    alignas(64) float values[kLanes * kChannels] = {};
    for (int k = 0; k < kChannels; ++k) scatter(values, kChannels, k, kLanes, offset[k]);
    for (int l = 0; l < count; ++l) {
        if (splats[i + l].row_begin >= splats[i + l].row_end) continue;
        lookup_backward(model, frame, i + l, load8(values + l * kChannels), xy, xt_line, yt_line,
                        gradient.position + 2 * (i + l));
    }
}
