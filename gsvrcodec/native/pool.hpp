// A small thread pool: one per process, created on first use, no OpenMP.
#pragma once

#include <functional>

namespace gsvr {

// Threads that a call asking for `requested` (0 = GSVR_THREADS, else all cores) may use.
int resolve_threads(int requested);

// Calls body(job, worker) for every job in [0, jobs), on at most `threads` threads, and waits.
// `worker` is in [0, threads) and no two running bodies of one call share it. When another call
// holds the pool, or threads is 1, the jobs run on the calling thread.
void parallel_for(int jobs, int threads, const std::function<void(int job, int worker)> &body);

}  // namespace gsvr
