// The choice of the instruction set whose kernels are in use.
#pragma once

#include <string>
#include <vector>

#include "kernels.hpp"

namespace gsvr {

// The instruction sets that this machine supports, fastest first.
std::vector<std::string> usable_isas();

// The kernels in use: those of the instruction set of the last use_isa() or, before any use_isa(),
// of the environment variable GSVR_ISA or else of the fastest set. Both functions throw
// std::runtime_error if the name is unknown or this machine does not support the set.
const Kernels &kernels();
void use_isa(const std::string &name);

}  // namespace gsvr
