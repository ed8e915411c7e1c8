#include "isa.hpp"

#include <atomic>
#include <cstdlib>
#include <stdexcept>

namespace gsvr {
namespace {

std::vector<const Kernels *> usable() {
    std::vector<const Kernels *> sets;
#ifdef GSVR_X86_64
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq"))
        sets.push_back(&kKernels_avx512);
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        sets.push_back(&kKernels_avx2);
#endif
    sets.push_back(&kKernels_portable);
    return sets;
}

const Kernels *find(const std::string &name, const char *source) {
    std::string names;
    for (const Kernels *k : usable()) {
        if (name == k->isa) return k;
        names += std::string(names.empty() ? "" : ", ") + k->isa;
    }
    throw std::runtime_error(source + name + " is not available here: use one of " + names);
}

std::atomic<const Kernels *> current{nullptr};

}  // namespace

std::vector<std::string> usable_isas() {
    std::vector<std::string> names;
    for (const Kernels *k : usable()) names.push_back(k->isa);
    return names;
}

const Kernels &kernels() {
    const Kernels *k = current.load();
    if (!k) {
        const char *wanted = std::getenv("GSVR_ISA");
        k = wanted && *wanted ? find(wanted, "GSVR_ISA=") : usable().front();
        current.store(k);
    }
    return *k;
}

void use_isa(const std::string &name) { current.store(find(name, "instruction set ")); }

}  // namespace gsvr
