// Which instruction set's kernels are in use.
#pragma once

#include <string>
#include <vector>

#include "kernels.hpp"

namespace gsvr {

// The sets this machine can run, best first.
std::vector<std::string> usable_isas();

// The kernels in use: at first the best, or what GSVR_ISA names; else what use_isa() named last.
// Both throw std::runtime_error when the name is unknown or the set not to be had here.
const Kernels &kernels();
void use_isa(const std::string &name);

}  // namespace gsvr
