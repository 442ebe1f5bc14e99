// A pool that splits work among threads. The result of a row must not depend on how rows are split, so that any number
// of threads computes the same image, bit for bit.
#pragma once

#include "core.h"

#if defined(_WIN32)
#include <windows.h>
#elif !defined(__wasm__)  // one thread there
#include <pthread.h>
#include <unistd.h>
#endif

namespace ss {

constexpr int MAX_THREADS = 256;
constexpr int MAX_BANDS = 4096;
constexpr int PARTS_OF_THREAD = 3;  // a delayed thread leaves parts to others

// Mutex and condition of the system.
class Lock {
   public:
#if defined(__wasm__)
    void lock() {}
    void unlock() {}
    void wait() {}
    void notify() {}
#elif defined(_WIN32)
    void lock() { AcquireSRWLockExclusive(&lock_); }
    void unlock() { ReleaseSRWLockExclusive(&lock_); }
    void wait() { SleepConditionVariableSRW(&changed_, &lock_, INFINITE, 0); }
    void notify() { WakeAllConditionVariable(&changed_); }

   private:
    SRWLOCK lock_ = SRWLOCK_INIT;
    CONDITION_VARIABLE changed_ = CONDITION_VARIABLE_INIT;
#else
    void lock() { pthread_mutex_lock(&lock_); }
    void unlock() { pthread_mutex_unlock(&lock_); }
    void wait() { pthread_cond_wait(&changed_, &lock_); }
    void notify() { pthread_cond_broadcast(&changed_); }

   private:
    pthread_mutex_t lock_ = PTHREAD_MUTEX_INITIALIZER;
    pthread_cond_t changed_ = PTHREAD_COND_INITIALIZER;
#endif
};

#if defined(__wasm__)
using ThreadId = int;
inline ThreadId this_thread() { return 0; }
inline bool is_this_thread(ThreadId) { return true; }
#elif defined(_WIN32)
using ThreadId = DWORD;
inline ThreadId this_thread() { return GetCurrentThreadId(); }
inline bool is_this_thread(ThreadId thread) { return thread == GetCurrentThreadId(); }
#else
using ThreadId = pthread_t;
inline ThreadId this_thread() { return pthread_self(); }
inline bool is_this_thread(ThreadId thread) { return pthread_equal(thread, pthread_self()); }
#endif

struct Guard {
    explicit Guard(Lock& lock) : lock_(lock) { lock_.lock(); }
    ~Guard() { lock_.unlock(); }
    Lock& lock_;
};

// Asks the caller from time to time, on the caller's thread, whether to cancel. Each call has one.
class Canceller {
   public:
    Canceller(int (*asked)(void* user), void* user)
        : asked_(asked), user_(user), next_(asked ? seconds_now() + INTERVAL : 0.0) {}
    Canceller(const Canceller&) = delete;
    bool is_set() const { return __atomic_load_n(&is_set_, __ATOMIC_RELAXED); }
    void ask() {  // in any thread
        if (!asked_ || !is_this_thread(caller_) || is_set() || seconds_now() < next_) return;
        if (asked_(user_)) __atomic_store_n(&is_set_, true, __ATOMIC_RELAXED);
        next_ = seconds_now() + INTERVAL;
    }

   private:
    static constexpr double INTERVAL = 1.0 / 50.0;
    int (*asked_)(void* user);
    void* user_;
    double next_;
    const ThreadId caller_ = this_thread();
    bool is_set_ = false;
};

void pause_thread(int tries);  // in a loop that waits for another thread

// While it exists, its thread computes as IEEE 754 specifies: subnormal numbers, rounding to nearest, no traps.
class IeeeArithmetic {
   public:
    IeeeArithmetic();
    ~IeeeArithmetic();

   private:
    uint64_t before_;
};

// Threads of a model. Several callers may run work at once; each works on its own. A thread that waits for its work
// runs it itself if no other has begun it, so that work ends in a forked child, too, which has none of the threads.
class ThreadPool {
   public:
    explicit ThreadPool(const ss_options& options);
    ~ThreadPool();
    ThreadPool(const ThreadPool&) = delete;

    int threads() const { return threads_; }
    // whether a task may run others; those of the caller's threads may not
    bool nests() const { return !parallel_for_; }

    // Calls task(context, index, thread) for each index from 0 to count - 1, and returns when all calls have returned;
    // see `Workers::run`.
    using Task = void (*)(const void* context, int index, int thread);
    void run(int count, Task task, const void* context, Canceller& canceller);

   private:
    struct Job;

    void start_threads();
    void work();
    Job* job_with_more(const Canceller* canceller);  // of the call of this canceller; null: of any
    void help(Job& job);

    int threads_, started_ = 0;
    bool ends_ = false;
    Job* jobs_ = nullptr;  // those with indices that no thread has begun
    Lock lock_;
    decltype(ss_options::parallel_for) parallel_for_;
    void* user_;
#if defined(_WIN32)
    static DWORD WINAPI thread_main(void* pool);
    HANDLE handles_[MAX_THREADS];
#elif !defined(__wasm__)
    static void* thread_main(void* pool);
    pthread_t handles_[MAX_THREADS];
    pid_t process_ = getpid();
#endif
};

// The threads of a pool, for one call. Once that is cancelled, they begin nothing more.
struct Workers {
    ThreadPool& pool;
    Canceller& canceller;
    bool alone = false;  // whether the calling thread does all of the work

    int threads() const { return alone ? 1 : pool.threads(); }

    // Calls function(index, thread) for each index from 0 to count - 1, and returns when all calls have returned.
    // `thread` is from 0 to threads() - 1; no two calls of this run that overlap in time have the same.
    template <class Function>
    void run(int count, const Function& function) const {
        for (int index = 0; alone && index < count && !canceller.is_set(); index++) {
            function(index, 0);
            canceller.ask();
        }
        if (alone) return;
        pool.run(
            count,
            [](const void* context, int index, int thread) { (*static_cast<const Function*>(context))(index, thread); },
            &function, canceller);
    }

    // Calls function(rect, thread) on parts of rectangles that do not overlap, split at multiples of `multiple` rows.
    template <class Function>
    void run_rects(const Rect* rects, int count, int multiple, const Function& function) const {
        int64_t area = 0;
        for (int k = 0; k < count; k++) area += area_of(rects[k]);
        int parts = threads() == 1 || area == 0 ? 1 : threads() * PARTS_OF_THREAD;
        run(parts, [&](int part, int thread) {
            int64_t before = 0;
            for (int k = 0; k < count; before += area_of(rects[k++])) {
                Rect rect = rects[k];
                int64_t width = max(rect.x1 - rect.x0, 1);
                auto row_at = [&](int end) {  // the first row that belongs to part `end` or a later one
                    int64_t rows = (area * end / parts - before + width * multiple - 1) / (width * multiple);
                    return clamp<int64_t>(rect.y0 + rows * multiple, rect.y0, rect.y1);
                };
                rect.y1 = part + 1 == parts ? rect.y1 : static_cast<int>(row_at(part + 1));
                rect.y0 = part == 0 ? rect.y0 : static_cast<int>(row_at(part));
                if (rect.y0 < rect.y1) function(rect, thread);
            }
        });
    }

    // Calls function(y0, y1, thread) on parts of `rows` rows.
    template <class Function>
    void run_rows(int rows, const Function& function) const {
        Rect rect{0, rows, 0, 1};
        run_rects(&rect, 1, 1, [&](Rect part, int thread) { function(part.y0, part.y1, thread); });
    }

    // Calls function(stage, band, thread) for all stages of all bands of an image. A stage of a band begins after the stage
    // before it has ended on the band and its two neighbours. `kept` bands have buffers: all of them, or more than `stages`.
    //
    // The work is a row of slots, each of which runs the first stage on band `slot`, the second on the one before, and so
    // on; threads take them in order. So a slot needs what the two slots before it have done, which are ahead of it.
    template <class Function>
    void run_bands(int bands, int stages, int kept, const Function& function) const {
        // of each slot: 1 once it has begun, and the number of stages that have ended
        uint8_t progress[MAX_BANDS] = {};
        int next = 0;
        const int slots = bands + stages - 1;
        // Returns whether the slot has begun, and so many stages have ended.
        const auto wait_for = [&](int slot, int ended) {
            for (int tries = 0; slot >= 0 && __atomic_load_n(&progress[slot], __ATOMIC_ACQUIRE) <= ended; tries++) {
                if (canceller.is_set()) return false;
                pause_thread(tries);
            }
            return true;
        };
        run(slots, [&](int, int thread) {
            const int slot = __atomic_fetch_add(&next, 1, __ATOMIC_RELAXED);
            // buffers of the last slot that has read them; all slots before that have ended, too, as slots begin in order
            if (!wait_for(slot - 1, 0) || (kept < bands && !wait_for(slot - kept + stages, stages))) return;
            for (int stage = 0; stage <= stages; stage++) {
                __atomic_store_n(&progress[slot], static_cast<uint8_t>(stage + 1), __ATOMIC_RELEASE);
                if (stage == stages) return;
                if (!wait_for(slot - 1, stage) || !wait_for(slot - 2, stage)) return;
                const int band = slot - stage;
                if (band >= 0 && band < bands) function(stage, band, thread);
            }
        });
    }

   private:
    static int64_t area_of(Rect rect) { return int64_t{rect.y1 - rect.y0} * (rect.x1 - rect.x0); }
};

}  // namespace ss
