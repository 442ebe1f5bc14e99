// Memory, errors, time, sizes and rectangles: what all of the library uses.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "constants.h"
#include "supersampler.h"

// Placement, without the header <new>, whose other operators are of the C++ runtime.
inline void* operator new(size_t, void* place) noexcept { return place; }

namespace ss {

constexpr int LANES = 16;  // rows of pixels are padded to a multiple of it: the largest vector
constexpr int PAD = 16;    // columns before and after a row of samples, so that neighbourhoods need no bounds checks
constexpr int LINE = 64;   // bytes of a cache line

struct Size {
    int width, height;
    bool operator==(const Size&) const = default;
};

// Rows y0 to y1 - 1, columns x0 to x1 - 1.
struct Rect {
    int y0, y1, x0, x1;
};

template <class T>
constexpr T min(T a, T b) {
    return b < a ? b : a;
}
template <class T>
constexpr T max(T a, T b) {
    return a < b ? b : a;
}
template <class T>
constexpr T clamp(T value, T low, T high) {
    return min(max(value, low), high);
}
// Rounds to a byte, where 255 stands for 1; NaN counts as 0.
constexpr uint8_t to_unorm8(float value) {
    return value > 0.0f ? static_cast<uint8_t>(min(value, 1.0f) * 255.0f + 0.5f) : 0;
}
constexpr float usable_motion(float motion) {
    return motion >= -FINITE_MOTION && motion <= FINITE_MOTION ? clamp(motion, -MAX_MOTION, MAX_MOTION) : 0.0f;
}
constexpr float usable_depth(float depth) { return depth >= 0.0f && depth <= MAX_DEPTH ? depth : UNKNOWN_DEPTH; }
constexpr int divided_up(int count, int by) { return (count + by - 1) / by; }
constexpr int up_to(int count, int multiple) { return divided_up(count, multiple) * multiple; }
constexpr Size half_of(Size size) { return {divided_up(size.width, 2), divided_up(size.height, 2)}; }

// Returns `status`, with a message.
ss_status fail(ss_error* error, ss_status status, const char* format, ...) __attribute__((format(printf, 3, 4)));

// An argument of the interface.
struct Given {
    const char* name;
    const void* pointer;
};
// Checks that no argument is NULL.
template <size_t N>
ss_status check_given(const Given (&arguments)[N], ss_error* error) {
    for (const Given& argument : arguments)
        if (!argument.pointer) return fail(error, SS_BAD_ARGUMENT, "%s is NULL", argument.name);
    return SS_OK;
}

// Checks that each array that is written is in memory of its own: neither that of another one, nor of one that is read,
// `whose` are those. NULL is no array.
template <size_t M, size_t N>
ss_status check_memory(const Given (&written)[M], const Given (&read)[N], ss_error* error, const char* whose = "") {
    auto refused = [&](const Given& to, const Given& use, const char* of) {
        return fail(error, SS_BAD_ARGUMENT, "%s is in the memory of %s%s; want memory that nothing else uses", to.name,
                    use.name, of);
    };
    for (size_t k = 0; k < M; k++) {
        if (!written[k].pointer) continue;
        for (size_t other = k + 1; other < M; other++)
            if (written[k].pointer == written[other].pointer) return refused(written[k], written[other], "");
        for (const Given& use : read)
            if (written[k].pointer == use.pointer) return refused(written[k], use, whose);
    }
    return SS_OK;
}

inline ss_status succeed(ss_error* error) {
    if (error) error->message[0] = 0;
    return SS_OK;
}

double seconds_now();  // since an arbitrary instant

struct Allocator {
    static constexpr size_t ALIGNED = 8;  // and the spare bytes of each allocation
    void* (*allocate)(void* user, size_t bytes);
    void (*release)(void* user, void* memory, size_t bytes);
    void* user;
    bool zeroes;  // whether memory is zero: then the system maps pages as they are written, and none is cleared twice

    // Returns memory at a multiple of ALIGNED, whatever the address of the caller's; NULL where there is none. The byte
    // before it has their distance.
    void* take(size_t bytes) const {
        uint8_t* memory = static_cast<uint8_t*>(allocate(user, bytes + ALIGNED));
        if (!memory) return nullptr;
        const uint8_t distance = static_cast<uint8_t>(ALIGNED - reinterpret_cast<uintptr_t>(memory) % ALIGNED);
        memory[distance - 1] = distance;
        return memory + distance;
    }
    void give_back(void* memory, size_t bytes) const {
        uint8_t* const taken = static_cast<uint8_t*>(memory);
        release(user, taken - taken[-1], bytes + ALIGNED);
    }
};

// Arrays that are freed together. Each starts at a cache line of its own, is zero, and has a spare line after it.
class Arena {
   public:
    explicit Arena(const Allocator& allocator) : allocator_(allocator) {}
    ~Arena() {
        while (last_) {
            Block* block = last_;
            last_ = block->before;
            allocator_.give_back(block, block->bytes);
        }
    }
    Arena(const Arena&) = delete;

    // Returns an array; NULL where there is no memory, and `failed` says so from then on.
    template <class T>
    T* take(size_t count) {
        return static_cast<T*>(taken(count * sizeof(T)));
    }
    bool failed() const { return failed_; }
    size_t bytes() const { return bytes_; }
    const Allocator& allocator() const { return allocator_; }

   private:
    struct Block {
        Block* before;
        size_t bytes;
    };
    void* taken(size_t count);

    Allocator allocator_;
    Block* last_ = nullptr;
    size_t bytes_ = 0, blocks_ = 0;
    bool failed_ = false;
};

// Objects that live in memory of an allocator.
template <class T, class... Values>
T* create(const Allocator& allocator, Values&&... values) {
    static_assert(alignof(T) <= Allocator::ALIGNED);
    void* memory = allocator.take(sizeof(T));
    return memory ? new (memory) T{static_cast<Values&&>(values)...} : nullptr;
}
template <class T>
void destroy(const Allocator& allocator, T* object) {
    if (!object) return;
    object->~T();
    allocator.give_back(object, sizeof(T));
}

}  // namespace ss
