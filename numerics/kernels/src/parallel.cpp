#include "parallel.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#endif
#if defined(__linux__)
#include <sched.h>
#endif

namespace mesh_motion {
namespace {

struct Job {
    Index count;
    void* context;
    void (*task)(void*, Index);
    std::mutex failed_once;
    std::atomic<bool> failed{false};
    std::exception_ptr error;

    void attempt(Index block) {
        try {
            task(context, block);
        } catch (...) {
            const std::lock_guard lock(failed_once);
            if (!error) error = std::current_exception();
            failed = true;
        }
    }
};

/// Blocks of a job that one thread takes first; other threads take them when their own are done.
struct alignas(cache_line) Share {
    std::atomic<Index> next;
    Index end;
};

/// A hint to the processor that this thread waits.
inline void pause() {
#if defined(__x86_64__) || defined(_M_X64)
    __builtin_ia32_pause();
#else
    std::this_thread::yield();
#endif
}

/// Threads that sleep until there is a job. They do one job at a time; a second caller meanwhile works alone.
///
/// A thread has the same share of the blocks in each loop, so the data that it wrote is in its own cache when it reads
/// it: on cores without a common cache, conjugate gradients take twice as long if any free thread takes the next block.
///
/// A motion is a hundred short loops, and to wake a thread takes as long as many of them: so after a job a thread looks
/// out for the next job for a while before it sleeps, and a caller does the same while it waits for its threads.
class Pool {
  public:
    /// Returns false if the threads are busy with another job.
    bool run(Job& job, int threads) {
        const std::unique_lock only(one_job_, std::try_to_lock);
        if (!only) return false;
        {
            const std::lock_guard lock(state_);
            while (started_ < threads - 1) std::thread([this, own = ++started_] { serve(own); }).detach();
            if (static_cast<int>(shares_.size()) < threads) shares_ = std::vector<Share>(threads);
            shared_by_ = threads;
            for (int t = 0; t < threads; ++t) {
                shares_[t].next.store(job.count * t / threads, std::memory_order_relaxed);
                shares_[t].end = job.count * (t + 1) / threads;
            }
            job_ = &job;
            places_ = threads - 1;
        }
        if (sleeping_ > 0) wake_.notify_all();
        work(job, 0);
        {
            const std::lock_guard lock(state_);
            places_ = 0;  // do not wait for threads that have not begun: on a busy machine this takes milliseconds
        }
        look_out([this] { return busy_ == 0; });
        std::unique_lock lock(state_);
        idle_.wait(lock, [this] { return busy_ == 0; });
        job_ = nullptr;
        return true;
    }

  private:
    static constexpr auto looking = std::chrono::microseconds(50);

    template <class Come>
    static void look_out(Come&& come) {
        const auto end = std::chrono::steady_clock::now() + looking;
        while (!come() && std::chrono::steady_clock::now() < end) pause();
    }

    /// First the thread's own share, then the remaining blocks of the others.
    void work(Job& job, int own) {
        for (int k = 0; k < shared_by_; ++k) {
            Share& share = shares_[(own + k) % shared_by_];
            for (Index block; (block = share.next.fetch_add(1, std::memory_order_relaxed)) < share.end && !job.failed;)
                job.attempt(block);
        }
    }

    [[noreturn]] void serve(int own) {
        for (;;) {
            look_out([this] { return places_ > 0; });
            std::unique_lock lock(state_);
            if (places_ == 0) {
                ++sleeping_;
                wake_.wait(lock);
                --sleeping_;
                if (places_ == 0) continue;  // the thread wakes too late for a short loop, but in time for the next one
            }
            --places_;
            ++busy_;
            Job& job = *job_;
            lock.unlock();
            work(job, own);
            lock.lock();
            if (--busy_ == 0) idle_.notify_one();
        }
    }

    std::mutex one_job_, state_;
    std::condition_variable wake_, idle_;
    Job* job_ = nullptr;
    std::vector<Share> shares_;  // the number of threads in use; changed only while no thread is busy
    int shared_by_ = 0, started_ = 0;
    std::atomic<int> sleeping_ = 0, places_ = 0, busy_ = 0;  // changed under the lock, read without it
};

/// Never destroyed: its threads may outlive static objects. A forked child has no threads and makes a new pool.
Pool* pool = nullptr;

void new_pool() { pool = new Pool; }

const bool prepared = [] {
    new_pool();
#if defined(__unix__) || defined(__APPLE__)
    pthread_atfork(nullptr, nullptr, new_pool);
#endif
    return true;
}();

thread_local int limit = 0;
thread_local bool inside = false;

}  // namespace

int available_threads() {
    static const int available = [] {
        if (const char* value = std::getenv("MESH_MOTION_THREADS")) return std::max(1, std::atoi(value));
#if defined(__linux__)
        cpu_set_t cores;
        if (sched_getaffinity(0, sizeof cores, &cores) == 0) return std::max(1, CPU_COUNT(&cores));
#endif
        return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
    }();
    return available;
}

int get_threads() { return limit ? limit : available_threads(); }

void set_threads(int threads) {
    require(1 <= threads && threads <= available_threads(), "expected 1 thread to as many as are available");
    limit = threads;
}

void run_blocks(Index count, void* context, void (*task)(void*, Index)) {
    if (count <= 0) return;
    Job job{count, context, task, {}, {}, {}};
    const int threads = static_cast<int>(std::min<Index>(get_threads(), count));
    const bool nested = std::exchange(inside, true);
    if (nested || threads <= 1 || !pool->run(job, threads))
        for (Index block = 0; block < count && !job.failed; ++block) job.attempt(block);
    inside = nested;
    if (job.error) std::rethrow_exception(job.error);
}

}  // namespace mesh_motion
