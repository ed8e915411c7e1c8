// Vectors of GSVR_LANES floats, by the compiler's vector extensions: one source for all instruction
// sets, with intrinsics where the extensions compile to slow code. Included by source files that
// are compiled for each set, inside a namespace of the set. Without the namespaces, the linker
// could merge an inline function of two sets, and a processor would run instructions that it lacks.

typedef float vf __attribute__((vector_size(GSVR_LANES * 4)));
typedef int vi __attribute__((vector_size(GSVR_LANES * 4)));
typedef unsigned vu __attribute__((vector_size(GSVR_LANES * 4)));
typedef float vf_unaligned __attribute__((vector_size(GSVR_LANES * 4), aligned(4), may_alias));
typedef int vi_unaligned __attribute__((vector_size(GSVR_LANES * 4), aligned(4), may_alias));
typedef float v8 __attribute__((vector_size(32)));
typedef int i8 __attribute__((vector_size(32)));
typedef float v8_unaligned __attribute__((vector_size(32), aligned(4), may_alias));
constexpr int kLanes = GSVR_LANES;

static inline vf load(const float *p) { return *reinterpret_cast<const vf_unaligned *>(p); }
static inline vi load(const int *p) { return *reinterpret_cast<const vi_unaligned *>(p); }
static inline void store(float *p, vf v) { *reinterpret_cast<vf_unaligned *>(p) = v; }
static inline void store(int *p, vi v) { *reinterpret_cast<vi_unaligned *>(p) = v; }
static inline v8 load8(const float *p) { return *reinterpret_cast<const v8_unaligned *>(p); }
static inline void store8(float *p, v8 v) { *reinterpret_cast<v8_unaligned *>(p) = v; }
static inline vf broadcast(float x) { return x - vf{}; }
static inline vi broadcast(int x) { return x - vi{}; }
static inline float max(float a, float b) { return a > b ? a : b; }
static inline float min(float a, float b) { return a < b ? a : b; }
static inline int max(int a, int b) { return a > b ? a : b; }
static inline int min(int a, int b) { return a < b ? a : b; }
static inline vi max(vi a, vi b) { return a > b ? a : b; }
static inline vi min(vi a, vi b) { return a < b ? a : b; }

// v clamped to [0, most]; 0 where v is NaN.
static inline v8 clamped(v8 v, float most) {
    const v8 zero{}, limit = most - zero;
#if defined(__AVX2__)
    return (v8)_mm256_min_ps(_mm256_max_ps((__m256)v, (__m256)zero), (__m256)limit);
#else
    const v8 positive = v > zero ? v : zero;
    return positive < limit ? positive : limit;
#endif
}

// max and min return b where a is NaN. bits returns the sign bits of the lanes of a mask.
#if defined(__AVX512F__)
static inline vf max(vf a, vf b) { return (vf)_mm512_max_ps((__m512)a, (__m512)b); }
static inline vf min(vf a, vf b) { return (vf)_mm512_min_ps((__m512)a, (__m512)b); }
static inline vf sqrt(vf a) { return (vf)_mm512_sqrt_ps((__m512)a); }
static inline unsigned bits(vi mask) { return _mm512_movepi32_mask((__m512i)mask); }
#elif defined(__AVX2__)
static inline vf max(vf a, vf b) { return (vf)_mm256_max_ps((__m256)a, (__m256)b); }
static inline vf min(vf a, vf b) { return (vf)_mm256_min_ps((__m256)a, (__m256)b); }
static inline vf sqrt(vf a) { return (vf)_mm256_sqrt_ps((__m256)a); }
static inline unsigned bits(vi mask) {
    return static_cast<unsigned>(_mm256_movemask_ps((__m256)mask));
}
#elif defined(__SSE2__)
static inline vf max(vf a, vf b) { return (vf)_mm_max_ps((__m128)a, (__m128)b); }
static inline vf min(vf a, vf b) { return (vf)_mm_min_ps((__m128)a, (__m128)b); }
static inline vf sqrt(vf a) { return (vf)_mm_sqrt_ps((__m128)a); }
static inline unsigned bits(vi mask) {
    return static_cast<unsigned>(_mm_movemask_ps((__m128)mask));
}
#else
static inline vf max(vf a, vf b) { return a > b ? a : b; }
static inline vf min(vf a, vf b) { return a < b ? a : b; }
static inline vf sqrt(vf a) {
    vf r;
    for (int i = 0; i < kLanes; ++i) r[i] = __builtin_sqrtf(a[i]);
    return r;
}
static inline unsigned bits(vi mask) {
    unsigned r = 0;
    for (int i = 0; i < kLanes; ++i) r |= (mask[i] < 0 ? 1u : 0u) << i;
    return r;
}
#endif

static inline vf to_float(vi v) { return __builtin_convertvector(v, vf); }
static inline vi truncate(vf v) { return __builtin_convertvector(v, vi); }
static inline vf absolute(vf v) { return (vf)((vi)v & 0x7fffffff); }
static inline vi is_finite(vf v) { return v - v == 0.0f; }
static inline vf where(vi mask, vf v) { return (vf)((vi)v & mask); }

// While an object of this class exists, the processor treats denormal numbers as zero. Computing
// with them is slow, and their values do not matter.
class FlushDenormals {
#if defined(__SSE2__)
   public:
    FlushDenormals() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | 0x8040); }
    ~FlushDenormals() { _mm_setcsr(saved_); }

   private:
    unsigned saved_;
#elif defined(__aarch64__)
   public:
    FlushDenormals() {
        __asm__ volatile("mrs %0, fpcr" : "=r"(saved_));
        __asm__ volatile("msr fpcr, %0" : : "r"(saved_ | (1ul << 24)));
    }
    ~FlushDenormals() { __asm__ volatile("msr fpcr, %0" : : "r"(saved_)); }

   private:
    unsigned long saved_;
#else
   public:
    ~FlushDenormals() {}
#endif
};

// 2^x for x in [-126, 127]; relative error below 2e-7.
static inline vf exp2(vf x) {
    constexpr float kRound = 12582912.0f;  // 1.5 * 2^23: adding this rounds to an integer
    const vf rounded = x + kRound;
    const vf f = x - (rounded - kRound);
    vf p = 1.327646680e-3f * f + 9.675541293e-3f;
    p = p * f + 5.550713290e-2f;
    p = p * f + 2.402211972e-1f;
    p = p * f + 6.931469671e-1f;
    p = p * f + 1.0f;
    return (vf)((vu)p + ((vu)rounded << 23));
}

// sin and cos of x; absolute error below 1e-6 for |x| up to about 1e4.
static inline void sincos(vf x, vf &sine, vf &cosine) {
    constexpr float kRound = 12582912.0f;
    const vf quarter = x * 0.636619772367581f + kRound;
    const vf n = quarter - kRound;
    const vf r = ((x - n * 1.5703125f) - n * 4.837512969970703e-4f) - n * 7.549789948768648e-8f;
    const vf z = r * r;
    const vf s = r + r * z * (-1.6666654611e-1f + z * (8.3321608736e-3f + z * -1.9515295891e-4f));
    const vf c =
        1.0f - 0.5f * z +
        z * z * (4.166664568298827e-2f + z * (-1.388731625493765e-3f + z * 2.443315711809948e-5f));
    const vu q = (vu)quarter;
    const vi swap = (q & 1) != 0;
    const vf a = swap ? c : s;
    const vf b = swap ? s : c;
    sine = (q & 2) != 0 ? -a : a;
    cosine = ((q + 1) & 2) != 0 ? -b : b;
}
