#include "threads.h"

#if !defined(_WIN32) && !defined(__wasm__)
#include <sched.h>
#include <signal.h>
#endif

namespace ss {

// The control word of floating point arithmetic; IEEE_WORD has nothing set but the masks of exceptions.
#if defined(__x86_64__)
constexpr uint64_t IEEE_WORD = 0x1F80, FLAGS = 0x3F;
static uint64_t control_word() {
    uint32_t word;
    __asm__ volatile("stmxcsr %0" : "=m"(word));
    return word;
}
static void set_control_word(uint64_t value) {
    const uint32_t word = static_cast<uint32_t>(value);
    __asm__ volatile("ldmxcsr %0" : : "m"(word));
}
#elif defined(__aarch64__)
constexpr uint64_t IEEE_WORD = 0, FLAGS = 0;
static uint64_t control_word() {
    uint64_t word;
    __asm__ volatile("mrs %0, fpcr" : "=r"(word));
    return word;
}
static void set_control_word(uint64_t word) { __asm__ volatile("msr fpcr, %0" : : "r"(word)); }
#else
constexpr uint64_t IEEE_WORD = 0, FLAGS = 0;
static uint64_t control_word() { return IEEE_WORD; }
static void set_control_word(uint64_t) {}
#endif

IeeeArithmetic::IeeeArithmetic() : before_(control_word()) {
    if ((before_ & ~FLAGS) != IEEE_WORD) set_control_word(IEEE_WORD);
}

IeeeArithmetic::~IeeeArithmetic() {
    if ((before_ & ~FLAGS) != IEEE_WORD) set_control_word(before_);
}

void pause_thread(int tries) {
    if (tries < 100) {
#if defined(__x86_64__)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        __asm__ volatile("yield");
#endif
        return;
    }
#if defined(_WIN32)
    SwitchToThread();
#elif !defined(__wasm__)
    sched_yield();
#endif
}

// Work of one call of `run`, on the stack of its caller.
struct ThreadPool::Job {
    Task task;
    const void* context;
    int count, threads;
    const Canceller& canceller;
    int next = 0;  // first index that no thread has begun
    int busy = 0;  // threads of the pool that work on it; guarded by the lock
    Job* after = nullptr;
    bool taken[MAX_THREADS] = {};

    bool has_more() const { return __atomic_load_n(&next, __ATOMIC_RELAXED) < count && !canceller.is_set(); }

    // Runs an index that no thread has begun; returns whether there was one.
    bool run_next() {
        const int index = has_more() ? __atomic_fetch_add(&next, 1, __ATOMIC_RELAXED) : count;
        if (index < count) run_one(index);
        return index < count;
    }

    void run_one(int index) {
        int thread = 0;
        while (__atomic_exchange_n(&taken[thread], true, __ATOMIC_ACQUIRE)) thread = (thread + 1) % threads;
        const IeeeArithmetic arithmetic;
        task(context, index, thread);
        __atomic_store_n(&taken[thread], false, __ATOMIC_RELEASE);
    }
};

static int core_count() {
#if defined(__wasm__)
    return 1;
#elif defined(_WIN32)
    return static_cast<int>(GetActiveProcessorCount(ALL_PROCESSOR_GROUPS));
#else
#if defined(__linux__)
    cpu_set_t cores;  // those that this process may run on
    if (sched_getaffinity(0, sizeof cores, &cores) == 0) return CPU_COUNT(&cores);
#endif
    return static_cast<int>(sysconf(_SC_NPROCESSORS_ONLN));
#endif
}

ThreadPool::ThreadPool(const ss_options& options)
    : threads_(clamp(options.threads ? options.threads : core_count(), 1, MAX_THREADS)),
      parallel_for_(options.parallel_for),
      user_(options.user) {}

void ThreadPool::run(int count, Task task, const void* context, Canceller& canceller) {
    Job job{task, context, count, threads_, canceller};
    if (parallel_for_ && threads_ > 1 && count > 1 && !canceller.is_set()) {
        parallel_for_(
            user_,
            [](void* of, int index) {
                Job& job = *static_cast<Job*>(of);
                if (!job.canceller.is_set()) job.run_one(index);
            },
            &job, count);
        return canceller.ask();
    }
    const bool shares = threads_ > 1 && count > 1;
    if (shares) {
        start_threads();
        Guard guard(lock_);
        job.after = jobs_;
        jobs_ = &job;
        lock_.notify();
    }
    while (job.run_next()) canceller.ask();
    if (!shares) return;
    Guard guard(lock_);
    for (Job** at = &jobs_; *at; at = &(*at)->after)
        if (*at == &job) {
            *at = job.after;
            break;
        }
    while (job.busy) {  // meanwhile, help with the jobs of its tasks
        if (Job* other = job_with_more(&canceller)) help(*other);
        else lock_.wait();
    }
}

ThreadPool::Job* ThreadPool::job_with_more(const Canceller* canceller) {
    Job* job = jobs_;
    while (job && !(job->has_more() && (!canceller || canceller == &job->canceller))) job = job->after;
    return job;
}

// Runs what no thread has begun. The lock is held before and afterwards.
void ThreadPool::help(Job& job) {
    job.busy++;
    lock_.unlock();
    while (job.run_next()) {}
    lock_.lock();
    if (--job.busy == 0) lock_.notify();
}

void ThreadPool::work() {
    Guard guard(lock_);
    while (!ends_) {
        if (Job* job = job_with_more(nullptr)) help(*job);
        else lock_.wait();
    }
}

#if defined(__wasm__)

void ThreadPool::start_threads() {}

ThreadPool::~ThreadPool() {}

#elif defined(_WIN32)

void ThreadPool::start_threads() {
    Guard guard(lock_);
    while (started_ < threads_ - 1) {
        handles_[started_] = CreateThread(nullptr, 0, thread_main, this, 0, nullptr);
        if (!handles_[started_]) break;  // fewer threads are enough
        started_++;
    }
}

DWORD WINAPI ThreadPool::thread_main(void* pool) {
    static_cast<ThreadPool*>(pool)->work();
    return 0;
}

ThreadPool::~ThreadPool() {
    {
        Guard guard(lock_);
        ends_ = true;
        lock_.notify();
    }
    for (int k = 0; k < started_; k++) {
        WaitForSingleObject(handles_[k], INFINITE);
        CloseHandle(handles_[k]);
    }
}

#else

void ThreadPool::start_threads() {
    constexpr pid_t RENEWED = -1;
    const pid_t own = getpid();
    for (pid_t owner = __atomic_load_n(&process_, __ATOMIC_ACQUIRE); owner != own;
         owner = __atomic_load_n(&process_, __ATOMIC_ACQUIRE)) {
        // in a forked child there are no threads, and one that is gone may hold the lock
        if (owner == RENEWED ||
            !__atomic_compare_exchange_n(&process_, &owner, RENEWED, false, __ATOMIC_ACQUIRE, __ATOMIC_RELAXED))
            continue;
        started_ = 0;
        jobs_ = nullptr;
        new (&lock_) Lock;
        __atomic_store_n(&process_, own, __ATOMIC_RELEASE);
    }
    Guard guard(lock_);
    if (started_ == threads_ - 1) return;
    // Signals are the program's: a thread of ours would run a handler, or end the process, while the program blocks them.
    // Those of faults stay, for crash reporters, and for sandboxes, whose SIGSYS would end the process if it were blocked.
    sigset_t blocked, before;
    sigfillset(&blocked);
    constexpr int FAULTS[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGTRAP, SIGABRT, SIGSYS};
    for (int fault : FAULTS) sigdelset(&blocked, fault);
    pthread_sigmask(SIG_BLOCK, &blocked, &before);
    while (started_ < threads_ - 1 && pthread_create(&handles_[started_], nullptr, thread_main, this) == 0) started_++;
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

void* ThreadPool::thread_main(void* pool) {
    static_cast<ThreadPool*>(pool)->work();
    return nullptr;
}

ThreadPool::~ThreadPool() {
    if (process_ != getpid()) return;
    {
        Guard guard(lock_);
        ends_ = true;
        lock_.notify();
    }
    for (int k = 0; k < started_; k++) pthread_join(handles_[k], nullptr);
}

#endif

}  // namespace ss
