// One step of Adam. Included by kernels.cpp.

void adam(float *value, const float *gradient, float *mean, float *square, const float *pace,
          std::int64_t n, const float *rate, int period, const AdamRule &rule, float correction) {
    const FlushDenormals flush;
    const float beta1 = rule.beta1, beta2 = rule.beta2, epsilon = rule.epsilon;
    const vf agreeing = broadcast(rule.agreeing), opposing = broadcast(rule.opposing);
    std::int64_t at = 0;  // position in `rate`, which has `period` vectors and repeats
    const auto step = [&](float *p, const float *g, float *m, float *v, const float *f, vf lr) {
        const vf gradients = load(g);
        const vf means = load(m) * beta1 + gradients * (1.0f - beta1);
        const vf squares = load(v) * beta2 + gradients * gradients * (1.0f - beta2);
        store(m, means);
        store(v, squares);
        if (f) lr *= load(f);
        lr *= means * gradients > 0.0f ? agreeing : opposing;
        store(p, load(p) - lr * means / (sqrt(squares * correction) + epsilon));
    };
    std::int64_t i = 0;
    for (; i + kLanes <= n; i += kLanes) {
        step(value + i, gradient + i, mean + i, square + i, pace ? pace + i : nullptr,
             load(rate + at));
        at += kLanes;
        if (at == static_cast<std::int64_t>(period) * kLanes) at = 0;
    }
    if (i == n) return;
    float p[5][kLanes] = {};
    const int left = static_cast<int>(n - i);
    for (int k = 0; k < left; ++k) {
        p[0][k] = value[i + k];
        p[1][k] = gradient[i + k];
        p[2][k] = mean[i + k];
        p[3][k] = square[i + k];
        p[4][k] = pace ? pace[i + k] : 1.0f;
    }
    step(p[0], p[1], p[2], p[3], p[4], load(rate + at));
    for (int k = 0; k < left; ++k) {
        value[i + k] = p[0][k];
        mean[i + k] = p[2][k];
        square[i + k] = p[3][k];
    }
}
