// A small thread pool: one per process, created on first use, no OpenMP.
#pragma once

#include <type_traits>

namespace gsvr {

// Threads that a call asking for `requested` (0 = GSVR_THREADS, else all cores) may use.
int resolve_threads(int requested);

// A reference to a callable: unlike std::function it never allocates.
struct JobFunction {
    void *context;
    void (*run)(void *context, int job, int worker);
};

void run_jobs(int count, int threads, JobFunction jobs);

// Calls body(job, worker) for every job in [0, count), on at most `threads` threads, and waits.
// `worker` is in [0, threads) and no two running bodies of one call share it. When another call
// holds the pool, or threads is 1, the jobs run on the calling thread. Bodies must not throw.
template <class Body>
void parallel_for(int count, int threads, Body &&body) {
    run_jobs(count, threads, {&body, [](void *context, int job, int worker) {
                                  (*static_cast<std::remove_reference_t<Body> *>(context))(job,
                                                                                           worker);
                              }});
}

}  // namespace gsvr
