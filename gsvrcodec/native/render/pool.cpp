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
// The calls of one frame follow each other within microseconds. A worker polls for the next call
// for this long before it sleeps.
constexpr auto kSpin = std::chrono::microseconds(60);

class Pool {
   public:
    bool try_run(int count, int threads, JobFunction function) {
        std::unique_lock<std::mutex> owner(owner_, std::try_to_lock);
        if (!owner.owns_lock()) return false;
        while (static_cast<int>(workers_.size()) < threads - 1)
            workers_.emplace_back([this, seen = generation_.load()] { serve(seen); });
        const int wanted = std::min(threads, count) - 1;
        {
            std::lock_guard<std::mutex> lock(mutex_);
            function_ = function;
            count_ = count;
            next_ = 0;
            joined_ = 0;
            places_ = wanted;
            ++generation_;
        }
        // Wakes no more workers than this call wants: earlier calls may have created more.
        for (int woken = 0; woken < wanted; ++woken) wake_.notify_one();
        take_jobs(0);
        {
            // All jobs are taken. Workers that have not joined yet, on a busy machine, are not
            // waited for and must not join any more.
            std::lock_guard<std::mutex> lock(mutex_);
            places_ = joined_;
        }
        while (busy_.load(std::memory_order_acquire) != 0) std::this_thread::yield();
        return true;
    }

   private:
    void take_jobs(int worker) {
        for (int job; (job = next_.fetch_add(1)) < count_;)
            function_.run(function_.context, job, worker);
    }

    void serve(unsigned seen) {
        for (;;) {
            const auto until = std::chrono::steady_clock::now() + kSpin;
            while (generation_.load(std::memory_order_acquire) == seen &&
                   std::chrono::steady_clock::now() < until) {
            }
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

    std::mutex owner_;  // held by the call that uses the pool
    std::mutex mutex_;  // guards the members below
    std::condition_variable wake_;
    std::vector<std::thread> workers_;
    JobFunction function_{};
    int count_ = 0;
    int joined_ = 0;  // workers that have joined the call
    int places_ = 0;  // workers that may join the call
    std::atomic<int> next_{0};
    std::atomic<int> busy_{0};
    std::atomic<unsigned> generation_{0};
};

// The pool is never destroyed, since its threads may outlive static destruction. Threads do not
// survive fork(), so that a child process gets a new pool.
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

void run_jobs(int count, int threads, JobFunction function) {
    if (threads > 1 && count > 1 && pool().try_run(count, threads, function)) return;
    for (int job = 0; job < count; ++job) function.run(function.context, job, 0);
}

}  // namespace gsvr
