#include "core.h"

#include <stdarg.h>
#include <stdio.h>
#ifdef _WIN32
#include <windows.h>
#else
#include <time.h>
#endif

namespace ss {

constexpr size_t PAGE = 4096;

ss_status fail(ss_error* error, ss_status status, const char* format, ...) {
    if (!error) return status;
    va_list values;
    va_start(values, format);
    vsnprintf(error->message, sizeof error->message, format, values);
    va_end(values);
    return status;
}

double seconds_now() {
#ifdef _WIN32
    LARGE_INTEGER ticks, rate;
    QueryPerformanceCounter(&ticks);
    QueryPerformanceFrequency(&rate);
    return static_cast<double>(ticks.QuadPart) / static_cast<double>(rate.QuadPart);
#else
    timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
#endif
}

void* Arena::taken(size_t count) {
    // large arrays begin in different sets of the caches, although the system aligns all of them to pages
    const size_t shift = count < PAGE ? 0 : blocks_++ * 13 % (PAGE / LINE) * LINE;
    const size_t bytes = sizeof(Block) + shift + count + 3 * LINE;
    Block* block = static_cast<Block*>(allocator_.take(bytes));
    if (!block) {
        failed_ = true;
        return nullptr;
    }
    *block = {last_, bytes};
    last_ = block;
    bytes_ += bytes + Allocator::ALIGNED;
    const uintptr_t first = (reinterpret_cast<uintptr_t>(block + 1) + shift + LINE - 1) / LINE * LINE;
    void* memory = reinterpret_cast<void*>(first);
    return allocator_.zeroes ? memory : memset(memory, 0, count + LINE);
}

}  // namespace ss
