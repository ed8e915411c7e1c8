// Computes the gradients of the parameters of kLanes Gaussians from the moments of their splats.
// Included by kernels.cpp.

// Writes the gradients of the Gaussians [i, i + count), whose moments are those from `first` on.
// `drawn` is a mask: the gradients of the other lanes are zero.
static inline void deform_backward(const GopArrays &gop, const Frame &frame, const Moments &moments,
                                   int first, vi drawn, int i, int count, const GopArrays &gradient,
                                   float *xy, float *xt_line, float *yt_line) {
    const Deformed d = deform(gop, frame, i, count, true);
    vf moment[8];
    to_columns(moments.of[first], moment);
    const vf mx = moment[3], my = moment[4], mxx = moment[5], mxy = moment[6], myy = moment[7];
    vf offset[kChannels];

    // The centre, from pixels to normalised units, and the polynomial motion.
    const float tau = frame.tau;
    const vf gcentre[2] = {d.inverse_xx * mx + d.inverse_xy * my,
                           d.inverse_xy * mx + d.inverse_yy * my};
    Fields<2> position, linear, quadratic;
    for (int k = 0; k < 2; ++k) {
        const vf g = where(
            drawn,
            gcentre[k] * (d.unit * (0.5f * static_cast<float>(k ? frame.height : frame.width))));
        position.column[k] = g;
        linear.column[k] = g * tau;
        quadratic.column[k] = g * (tau * tau);
        offset[k] = g;
    }
    store_fields<2>(gradient.linear, i, count, linear);
    store_fields<2>(gradient.quadratic, i, count, quadratic);
    const Fields<3> colour = load_fields<3>(gop.colour, i, count);
    const vf share = d.amplitude * d.opacity;
    Fields<3> of_colour;
    for (int k = 0; k < 3; ++k) of_colour.column[k] = where(drawn, share * moment[k]);
    store_fields<3>(gradient.colour, i, count, of_colour);
    // With respect to the logarithm of the amplitude, and of the opacity.
    vf log_amplitude_gradient{};
    if (frame.mean) log_amplitude_gradient = where(drawn, share * load(moments.weight + first));
    for (int k = 0; k < 3; ++k) {
        const vf moving = frame.mean ? vf{} : d.offset[5 + k];
        log_amplitude_gradient += of_colour.column[k] * (colour.column[k] + moving);
        offset[5 + k] = frame.mean ? vf{} : of_colour.column[k];
    }
    vf of_opacity{};
    if (frame.mean) of_opacity = offset[5] = where(drawn & d.opacity_free, log_amplitude_gradient);
    store_fields<1>(gradient.log_opacity, i, count, {{of_opacity}});

    // The covariance, in the coordinate system of its axes, where thin Gaussians lose no precision.
    // With the second moments m, in pixels of the coded frame, and the variances lambda, the
    // gradient is m_ij / (2 lambda_i lambda_j).
    const vf zx = static_cast<float>(frame.coded_width) / static_cast<float>(frame.width) / d.unit;
    const vf zy =
        static_cast<float>(frame.coded_height) / static_cast<float>(frame.height) / d.unit;
    const vf cxx = mxx * (zx * zx), cxy = mxy * (zx * zy), cyy = myy * (zy * zy);
    const vf half = 0.5f * (cxx - cyy);
    const vf moment_along = half * d.cosine + cxy * d.sine;
    const vf moment_across = cxy * d.cosine - half * d.sine;
    offset[4] =
        where(drawn, 2.0f * d.half_difference * moment_across / (d.variance[0] * d.variance[1]));
    store_fields<1>(gradient.rotation, i, count, {{offset[4]}});
    Fields<2> log_scale;
    for (int k = 0; k < 2; ++k) {
        const vf second_moment = 0.5f * (cxx + cyy) + (k ? -moment_along : moment_along);
        const vf inverse = 1.0f / d.variance[k];
        const vf of_variance =
            where(d.wide[k], inverse * (second_moment * inverse - log_amplitude_gradient));
        const vf of_square =
            of_variance + log_amplitude_gradient / (d.scale[k] * d.scale[k] + kDilation);
        offset[2 + k] = where(drawn & (d.scale_sum[k] >= kMinScale), d.scale[k] * of_square);
        log_scale.column[k] = where(drawn, offset[2 + k] * d.scale_base[k]);
    }
    store_fields<2>(gradient.log_scale, i, count, log_scale);

    vf gate{};
    for (int k = 0; k < kChannels; ++k) {
        gate += where(drawn, offset[k] * d.field[k]);
        offset[k] = where(drawn, offset[k] * d.gate);
    }
    store_fields<1>(gradient.indicator, i, count, {{-gate}});
    if (gop.gx > 0 && bits(drawn))
        lookup_backward(gop, frame, d.position, count, offset, xy, xt_line, yt_line, position);
    store_fields<2>(gradient.position, i, count, position);
}
