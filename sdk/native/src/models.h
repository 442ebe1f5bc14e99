// The shipped models, which are part of the library.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace ss {

struct ShippedModel {
    const char* name;  // null: the end of the list
    const uint8_t* bytes;
    size_t count;
};
extern const ShippedModel SHIPPED_MODELS[];

}  // namespace ss
