// A small thread pool without OpenMP: one for each process, created on first use.
#pragma once

#include <type_traits>

namespace gsvr {

// The number of threads for a call: `requested`. 0 means the environment variable GSVR_THREADS or,
// without the variable, the number of cores.
int resolve_threads(int requested);

// A reference to a callable. Unlike std::function, it never allocates memory.
struct JobFunction {
    void *context;
    void (*run)(void *context, int job, int worker);
};

void run_jobs(int count, int threads, JobFunction function);

// Calls body(job, worker) for each job in [0, count), on at most `threads` threads, and returns
// when all are done. `worker` is in [0, threads), and bodies that run at the same time have
// different workers. If `threads` is 1, or another call is using the pool, all jobs run on the
// calling thread. The body must not throw.
template <class Body>
void parallel_for(int count, int threads, Body &&body) {
    run_jobs(count, threads, {&body, [](void *context, int job, int worker) {
                                  (*static_cast<std::remove_reference_t<Body> *>(context))(job,
                                                                                           worker);
                              }});
}

}  // namespace gsvr
