# gsvr_add_kernels(<name> <source>...) compiles the sources once for each instruction set, with
# GSVR_ISA and GSVR_LANES (floats of a vector) defined, and collects the objects in <name>_OBJECTS.

set(GSVR_X86_64 OFF)
if(CMAKE_SYSTEM_PROCESSOR STREQUAL "x86_64")
  set(GSVR_X86_64 ON)
  add_compile_definitions(GSVR_X86_64)
endif()

function(gsvr_add_kernels_of_isa name isa lanes sources)
  add_library(${name}_${isa} OBJECT ${sources})
  target_compile_definitions(${name}_${isa} PRIVATE GSVR_ISA=${isa} GSVR_LANES=${lanes})
  target_compile_options(${name}_${isa} PRIVATE
    -O3 -ffp-contract=fast -fno-math-errno -fno-trapping-math -fno-signed-zeros
    # The headers of GCC 12's intrinsics raise the two warnings that are off.
    -Wall -Wextra -Wno-uninitialized -Wno-maybe-uninitialized
    ${ARGN})
  set(${name}_OBJECTS ${${name}_OBJECTS} $<TARGET_OBJECTS:${name}_${isa}> PARENT_SCOPE)
endfunction()

function(gsvr_add_kernels name)
  set(${name}_OBJECTS)
  gsvr_add_kernels_of_isa(${name} portable 4 "${ARGN}" -Wno-psabi)
  if(GSVR_X86_64)
    gsvr_add_kernels_of_isa(${name} avx2 8 "${ARGN}" -mavx2 -mfma)
    gsvr_add_kernels_of_isa(${name} avx512 16 "${ARGN}" -mavx2 -mfma -mavx512f -mavx512vl
      -mavx512bw -mavx512dq -mprefer-vector-width=512)
  endif()
  set(${name}_OBJECTS ${${name}_OBJECTS} PARENT_SCOPE)
endfunction()
