#include "pool.hpp"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace gsvr {
namespace {

constexpr int kMaxThreads = 256;
// Kernels come in bursts a few microseconds apart: a worker looks for the next one this long
// before it sleeps.
constexpr auto kSpin = std::chrono::microseconds(60);

class Pool {
   public:
    bool try_run(int count, int threads, JobFunction jobs) {
        std::unique_lock<std::mutex> owner(owner_, std::try_to_lock);
        if (!owner.owns_lock()) return false;
        while (static_cast<int>(workers_.size()) < threads - 1)
            workers_.emplace_back([this, seen = generation_.load()] { serve(seen); });
        const int wanted = std::min(threads, count) - 1;
        {
            std::lock_guard<std::mutex> lock(mutex_);
            jobs_ = jobs;
            count_ = count;
            next_ = 0;
            joined_ = 0;
            places_ = wanted;
            ++generation_;
        }
        // Not all: more than the machine has cores may be left from a call that asked for them.
        for (int woken = 0; woken < wanted; ++woken) wake_.notify_one();
        take_jobs(0);
        {
            // A worker that has not come yet is not waited for: the machine may be busy.
            std::lock_guard<std::mutex> lock(mutex_);
            places_ = joined_;
        }
        while (busy_.load(std::memory_order_acquire) != 0) std::this_thread::yield();
        return true;
    }

   private:
    void take_jobs(int worker) {
        for (int job; (job = next_.fetch_add(1)) < count_;) jobs_.run(jobs_.context, job, worker);
    }

    void serve(unsigned seen) {
        for (;;) {
            const auto until = std::chrono::steady_clock::now() + kSpin;
            while (generation_.load(std::memory_order_acquire) == seen &&
                   std::chrono::steady_clock::now() < until) {}
            int worker = 0;
            {
                std::unique_lock<std::mutex> lock(mutex_);
                wake_.wait(lock, [&] { return joined_ < places_ && generation_.load() != seen; });
                seen = generation_.load();
                worker = ++joined_;
                busy_.fetch_add(1);
            }
            take_jobs(worker);
            busy_.fetch_sub(1, std::memory_order_release);
        }
    }

    std::mutex owner_;  // held by the call that the pool works for
    std::mutex mutex_;  // of what follows
    std::condition_variable wake_;
    std::vector<std::thread> workers_;
    JobFunction jobs_{};
    int count_ = 0;
    int joined_ = 0;  // workers that take part in this call
    int places_ = 0;  // for as many
    std::atomic<int> next_{0};
    std::atomic<int> busy_{0};
    std::atomic<unsigned> generation_{0};
};

// Never destroyed: its threads may outlive static destruction. Threads do not survive fork(), so a
// child gets a pool of its own.
Pool &pool() {
    static std::mutex mutex;
    static Pool *current = nullptr;
    static pid_t owner = 0;
    std::lock_guard<std::mutex> lock(mutex);
    if (owner != getpid()) {
        current = new Pool;
        owner = getpid();
    }
    return *current;
}

}  // namespace

int resolve_threads(int requested) {
    if (requested <= 0) {
        const char *text = std::getenv("GSVR_THREADS");
        requested = text ? std::atoi(text) : 0;
    }
    if (requested <= 0) requested = static_cast<int>(std::thread::hardware_concurrency());
    return std::clamp(requested, 1, kMaxThreads);
}

void run_jobs(int count, int threads, JobFunction jobs) {
    if (threads > 1 && count > 1 && pool().try_run(count, threads, jobs)) return;
    for (int job = 0; job < count; ++job) jobs.run(jobs.context, job, 0);
}

}  // namespace gsvr
