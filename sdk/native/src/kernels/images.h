// Reading and writing of the caller's images, of any type and strides.
#pragma once

#include "colors.h"

namespace ss::SS_ISA {

SS_INLINE float half_to_float(uint16_t half) {
    uint32_t magnitude = static_cast<uint32_t>(half & 0x7FFF) << 13, sign = static_cast<uint32_t>(half & 0x8000) << 16;
    float value = __builtin_bit_cast(float, magnitude) * 0x1p112f;  // of subnormal numbers, too
    uint32_t bits = magnitude >= 0x0F800000 ? magnitude | 0x7F800000 : __builtin_bit_cast(uint32_t, value);
    return __builtin_bit_cast(float, bits | sign);
}

// The nearest half float in [-MAX_HALF, MAX_HALF]; ties to even. A call, as code inside of kernels changes which of their
// products GCC contracts to multiply-adds, and so the last bit of images.
[[maybe_unused, gnu::noinline]] static uint16_t half_of_float(float value) {
    const uint32_t sign = __builtin_bit_cast(uint32_t, value) >> 16 & 0x8000;
    float scaled = min(MAX_HALF, __builtin_fabsf(value)) * 0x1p-112f;  // subnormal floats round as subnormal halves
    uint32_t bits = __builtin_bit_cast(uint32_t, scaled);
    return static_cast<uint16_t>((bits + 0xFFF + (bits >> 13 & 1)) >> 13 | sign);
}

SS_INLINE float value_at(const View& image, const char* at) {
    return image.type == SS_FLOAT16 ? half_to_float(load_as<uint16_t>(at)) : load_as<float>(at);
}

// Returns a row as packed floats: that of the image itself, or converted to `scratch`.
[[maybe_unused]] static const float* packed_row(const View& image, int channels, int y, int width, float* scratch) {
    const char* row = image.data + y * image.row;
    if (image.type == SS_FLOAT32 && image.is_packed<float>(channels)) return reinterpret_cast<const float*>(row);
    for (int x = 0; x < width; x++)
        for (int c = 0; c < channels; c++)
            scratch[channels * x + c] = value_at(image, row + x * image.pixel + c * image.channel);
    return scratch;
}

// Returns where W pixels from x on can be loaded: in the row, or in `tail`, where the last pixel is repeated.
template <int channels>
SS_INLINE const float* whole_vector(const float* row, int x, int width, float (&tail)[channels * W]) {
    if (x + W <= width) return row + channels * x;
    for (int k = 0; k < W; k++)
        for (int c = 0; c < channels; c++) tail[channels * k + c] = row[channels * min(x + k, width - 1) + c];
    return tail;
}

SS_INLINE void store_value(const View& image, char* at, float value) {
    if (image.type == SS_FLOAT32) return store_as(at, value);
    if (image.type == SS_FLOAT16) return store_as(at, half_of_float(value));
    *reinterpret_cast<uint8_t*>(at) = to_unorm8(value);
}

// Writes up to W pixels from x on, before `end`, finite and >= 0.
SS_INLINE void write_rgb(const View& image, int y, int x, int end, F3 color) {
    char* row = const_cast<char*>(image.data) + y * image.row;
    if (x + W <= end && image.type == SS_FLOAT32 && image.is_packed<float>(3)) {
        float* to = reinterpret_cast<float*>(row) + 3 * x;
        return is_aligned(to) ? stream_rgb(to, color) : store_rgb(to, color);
    }
    float values[3 * W];
    store_rgb(values, color);
    for (int k = 0; k < min(W, end - x); k++)
        for (int c = 0; c < 3; c++)
            store_value(image, row + (x + k) * image.pixel + c * image.channel, values[3 * k + c]);
}

SS_INLINE void write_plane(const View& image, int y, int x, int end, F value) {
    char* row = const_cast<char*>(image.data) + y * image.row;
    if (x + W <= end && image.type == SS_FLOAT32 && image.is_packed<float>(1))
        return store(reinterpret_cast<float*>(row) + x, value);
    float values[W];
    store(values, value);
    for (int k = 0; k < min(W, end - x); k++) store_value(image, row + (x + k) * image.pixel, values[k]);
}

// Writes up to W pixels of three values to a history.
SS_INLINE void write_pixels3(float* pixels, int width, int y, int x, int end, F3 color) {
    float* to = pixels + 3 * (static_cast<ptrdiff_t>(y) * width + x);
    if (x + W <= end) return is_aligned(to) ? stream_rgb(to, color) : store_rgb(to, color);
    float values[3 * W];
    store_rgb(values, color);
    memcpy(to, values, sizeof(float) * 3 * (end - x));
}

// Writes pixels of the image: of the history's units, times the pre-exposure of the frame.
SS_INLINE void write_image(const Target& target, int y, int x, int end, F3 color) {
    if (target.pre_exposure != 1.0f) color = color * target.pre_exposure;
    write_rgb(target.image, y, x, end, color);
}

}  // namespace ss::SS_ISA
