#include "arrays.h"

namespace ss {

static constexpr char MAGIC[8] = {'s', 's', 'a', 'r', 'r', 'a', 'y', '1'};

// The CRC-32 of zlib, four bits at a time.
static uint64_t checksum_of(const void* bytes, size_t count) {
    static constexpr uint32_t TABLE[16] = {0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4,
                                           0x4DB26158, 0x5005713C, 0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
                                           0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C};
    uint32_t sum = ~0u;
    for (size_t k = 0; k < count; k++) {
        sum ^= static_cast<const uint8_t*>(bytes)[k];
        sum = sum >> 4 ^ TABLE[sum & 15];
        sum = sum >> 4 ^ TABLE[sum & 15];
    }
    return ~sum;
}

size_t Array::count() const {
    size_t total = 1;
    for (uint32_t axis = 0; axis < axes; axis++) total *= shape[axis];
    return total;
}

static bool is_sound(const Array& array, size_t room) {
    if (array.name[0] == 0 || memchr(array.name, 0, sizeof array.name) == nullptr) return false;
    if (array.type > ArrayType::TEXT || array.axes < 1 || array.axes > 4) return false;
    uint64_t count = 1;
    for (uint32_t axis = 0; axis < array.axes; axis++) {
        count *= array.shape[axis];
        if (array.shape[axis] == 0 || count > room) return false;  // no more than 2^32 times `room`: no overflow
    }
    return filled_up(array.bytes()) <= room;
}

char* begin_arrays(void* bytes) {
    memcpy(bytes, MAGIC, sizeof MAGIC);
    return static_cast<char*>(bytes) + sizeof MAGIC;
}

void end_arrays(void* bytes, size_t count) {
    const uint64_t sum = checksum_of(bytes, count - sizeof sum);
    memcpy(static_cast<char*>(bytes) + count - sizeof sum, &sum, sizeof sum);
}

Arrays::Arrays(const void* bytes, size_t count) : begin_(static_cast<const char*>(bytes)), end_(begin_) {
    if (count < sizeof MAGIC + 8 || count % 8 || memcmp(bytes, MAGIC, sizeof MAGIC) != 0) {
        message_ = "they do not begin as arrays of this library do";
        return;
    }
    memcpy(&checksum_, begin_ + count - 8, 8);
    if (checksum_ != checksum_of(bytes, count - 8)) {
        message_ = "their checksum differs";
        return;
    }
    const char* end = begin_ + count - 8;
    begin_ += sizeof MAGIC;
    for (const char* at = begin_; at != end;) {
        size_t room = static_cast<size_t>(end - at);
        const Array* array = reinterpret_cast<const Array*>(at);
        if (room < sizeof(Array) || !is_sound(*array, room - sizeof(Array))) {
            message_ = "an array is damaged";
            return;
        }
        at += sizeof(Array) + filled_up(array->bytes());
    }
    end_ = end;
}

const Array* Arrays::next(const Array* array) const {
    const char* at = array ? reinterpret_cast<const char*>(array + 1) + filled_up(array->bytes()) : begin_;
    return at < end_ ? reinterpret_cast<const Array*>(at) : nullptr;
}

const Array* Arrays::find(const char* name, ArrayType type, uint32_t a, uint32_t b, uint32_t c, uint32_t d) const {
    const uint32_t shape[] = {a, b, c, d};
    for (const Array* array = next(nullptr); array; array = next(array)) {
        if (strcmp(array->name, name) != 0 || array->type != type) continue;
        bool fits = true;
        for (uint32_t axis = 0; axis < 4; axis++) {
            uint32_t extent = axis < array->axes ? array->shape[axis] : 1;
            fits = fits && (shape[axis] == 0 || shape[axis] == extent);
        }
        return fits ? array : nullptr;
    }
    return nullptr;
}

}  // namespace ss
