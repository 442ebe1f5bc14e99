#include "threads.h"

namespace ss {

// Work of one call of `run`, on the stack of its caller.
struct ThreadPool::Job {
    Task task;
    const void* context;
    int count, threads;
    int next = 0;  // index that no thread has begun
    int busy = 0;  // threads of the pool that work on it; guarded by the lock
    Job* after = nullptr;
    bool taken[MAX_THREADS] = {};

    bool has_more() const { return __atomic_load_n(&next, __ATOMIC_RELAXED) < count; }

    // Runs indices until there are none.
    void run() {
        while (has_more()) {
            int index = __atomic_fetch_add(&next, 1, __ATOMIC_RELAXED);
            if (index < count) run_one(index);
        }
    }

    void run_one(int index) {
        int thread = 0;
        while (__atomic_exchange_n(&taken[thread], true, __ATOMIC_ACQUIRE)) thread = (thread + 1) % threads;
        task(context, index, thread);
        __atomic_store_n(&taken[thread], false, __ATOMIC_RELEASE);
    }
};

static int core_count() {
#ifdef _WIN32
    return static_cast<int>(GetActiveProcessorCount(ALL_PROCESSOR_GROUPS));
#else
    return static_cast<int>(sysconf(_SC_NPROCESSORS_ONLN));
#endif
}

ThreadPool::ThreadPool(const ss_options& options)
    : threads_(clamp(options.threads ? options.threads : core_count(), 1, MAX_THREADS)),
      parallel_for_(options.parallel_for),
      user_(options.user) {}

void ThreadPool::run_task(int count, Task task, const void* context) {
    if (threads_ == 1 || count == 1) {
        for (int index = 0; index < count; index++) task(context, index, 0);
        return;
    }
    Job job{task, context, count, threads_};
    if (parallel_for_) {
        parallel_for_(user_, [](void* of, int index) { static_cast<Job*>(of)->run_one(index); }, &job, count);
        return;
    }
    start_threads();
    {
        Guard guard(lock_);
        job.after = jobs_;
        jobs_ = &job;
        lock_.notify();
    }
    job.run();
    Guard guard(lock_);
    for (Job** at = &jobs_; *at; at = &(*at)->after)
        if (*at == &job) {
            *at = job.after;
            break;
        }
    while (job.busy) lock_.wait();
}

void ThreadPool::work() {
    Guard guard(lock_);
    while (!ends_) {
        Job* job = jobs_;
        while (job && !job->has_more()) job = job->after;
        if (!job) {
            lock_.wait();
            continue;
        }
        job->busy++;
        lock_.unlock();
        job->run();
        lock_.lock();
        if (--job->busy == 0) lock_.notify();
    }
}

#ifdef _WIN32

void ThreadPool::start_threads() {
    Guard guard(lock_);
    while (started_ < threads_ - 1) {
        handles_[started_] = CreateThread(nullptr, 0, thread_main, this, 0, nullptr);
        if (!handles_[started_]) break;  // fewer will do
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
    if (process_ != getpid()) {  // a forked child: it has no threads, and the lock may be held by one that is gone
        process_ = getpid();
        started_ = 0;
        jobs_ = nullptr;
        new (&lock_) Lock;
    }
    Guard guard(lock_);
    while (started_ < threads_ - 1 && pthread_create(&handles_[started_], nullptr, thread_main, this) == 0) started_++;
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
