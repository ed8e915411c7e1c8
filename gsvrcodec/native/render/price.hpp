// Slopes of prices of bits. Included by kernels.cpp.

void price(float *value, const float *usual, const float *step, const float *change,
           const float *fresh, std::int64_t n) {
    const FlushDenormals flush;
    for (std::int64_t i = 0; i < n; i += kLanes) {
        const auto slope = [&](vf x) {
            const vf size = 1.0f / (absolute(x) + load(step + i));
            return where(x > vf{}, size) - where(x < vf{}, size);
        };
        const vf own = load(value + i);
        store(value + i,
              load(change + i) * slope(own) + load(fresh + i) * slope(own - load(usual + i)));
    }
}

void sum_shifted(const float *values, int shift, int times, float *sums, std::int64_t n) {
    for (std::int64_t i = 0; i < n; i += kLanes) {
        vf sum{};
        for (int k = 0; k < times; ++k)
            sum += load(values + i + static_cast<std::int64_t>(k) * shift);
        store(sums + i, sum);
    }
}
