// Named arrays in one run of bytes: the file of a model, and a saved state.
//
// The bytes are a magic number, arrays one after the other, and a checksum of all before it. An array is a header and
// its values in C order, filled up to a multiple of eight bytes. All numbers are little-endian.
#pragma once

#include "core.h"

namespace ss {

enum class ArrayType : uint32_t { FLOAT = 0, INT8 = 1, TEXT = 2 };

struct Array {
    char name[48];  // ends with a zero
    ArrayType type;
    uint32_t axes;
    uint32_t shape[4];
    uint32_t reserved[2];
    const void* values() const { return this + 1; }
    size_t count() const;
    size_t bytes() const { return count() * (type == ArrayType::FLOAT ? 4 : 1); }
};
static_assert(sizeof(Array) == 80);

class Arrays {
   public:
    // Checks all that readers rely on. `message` then says what is damaged, or is null.
    Arrays(const void* bytes, size_t count);
    const char* message() const { return message_; }
    uint64_t checksum() const { return checksum_; }

    // Returns an array of this type and shape (0: any extent); null where there is none.
    const Array* find(const char* name, ArrayType type, uint32_t a, uint32_t b = 1, uint32_t c = 1,
                      uint32_t d = 1) const;
    // Returns the first array, or the one after another one; null after the last.
    const Array* next(const Array* array) const;

   private:
    const char* begin_;
    const char* end_;
    const char* message_ = nullptr;
    uint64_t checksum_ = 0;
};

constexpr size_t ARRAYS_OVERHEAD = 16;  // bytes around arrays: a magic number, a checksum
constexpr size_t filled_up(size_t bytes) { return (bytes + 7) / 8 * 8; }

char* begin_arrays(void* bytes);             // writes what comes first; returns where the first array begins
void end_arrays(void* bytes, size_t count);  // writes the checksum

}  // namespace ss
