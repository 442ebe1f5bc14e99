/* Values drawn from the bytes of a fuzzer. */
#ifndef INPUT_H
#define INPUT_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "supersampler.h"

typedef struct Input {
    const uint8_t* at;
    size_t left;
    uint32_t random;
} Input;

static uint32_t next_random(Input* in) {
    in->random = in->random * 1664525u + 1013904223u;
    return in->random ^ in->random >> 15;
}

/* A number from 0 to below - 1; 0 where no bytes are left. */
static int pick(Input* in, int below) {
    if (!in->left) return 0;
    in->left--;
    in->random += *in->at;
    return *in->at++ % below;
}

static float pick_float(Input* in) {
    static const float hostile[] = {0.0f,    -0.0f,    1.0f,     -1.0f,    0.5f,  1e-45f, 1e-30f,   1e30f,
                                    3.4e38f, -3.4e38f, 65504.0f, 65520.0f, 0.18f, 1e6f,   INFINITY, NAN};
    const int index = pick(in, 17);
    return index < 16 ? hostile[index] : (float)(next_random(in) >> 8) * 0x1p-24f;
}

/* A value of an image: a number in [0, scale]; or in `hostile` of 256 cases one of any bits. */
static float value_of(Input* in, int hostile, float scale) {
    float value;
    uint32_t bits = next_random(in);
    if ((int)(next_random(in) >> 8 & 255) >= hostile) return (float)(bits >> 8) * 0x1p-24f * scale;
    memcpy(&value, &bits, 4);
    return value;
}

/* An image in memory of exactly its size, with any strides. The caller frees `*memory`. */
static ss_image image_of(Input* in, void** memory, int width, int height, int channels, int writable, float scale) {
    static const ptrdiff_t sizes[] = {4, 2, 1};
    ss_image image;
    const int order = pick(in, 4), hostile = writable ? 0 : pick(in, 256);
    memset(&image, 0, sizeof image);
    image.type = (ss_type)pick(in, writable ? 3 : 2);
    const ptrdiff_t size = sizes[image.type];
    const size_t values = (size_t)width * height * channels;
    const ptrdiff_t extra = order == 1 ? size * (1 + pick(in, 3)) : 0; /* between pixels */
    const size_t bytes = values * size + (size_t)width * height * extra;
    char* data = *memory = malloc(bytes);
    for (size_t k = 0; k < bytes / size && !writable; k++) {
        const float value = value_of(in, hostile, scale);
        const uint16_t half = (uint16_t)(hostile ? next_random(in) : 0x3800 | (next_random(in) & 0x3FF));
        memcpy(data + k * size, size == 4 ? (const void*)&value : (const void*)&half, (size_t)size);
    }
    image.data = data;
    if (order == 1) image.pixel_stride = channels * size + extra;
    if (order == 2)
        image.channel_stride = (ptrdiff_t)width * height * size, image.pixel_stride = size,
        image.row_stride = width * size;
    if (order == 3)
        image.row_stride = -(ptrdiff_t)width * channels * size,
        image.data = data + (ptrdiff_t)(height - 1) * width * channels * size;
    return image;
}

/* Ends the program if a value of an image is negative or not finite. */
static void check_image(const ss_image* image, const void* memory, size_t values) {
    for (size_t k = 0; k < values && image->type == SS_FLOAT32 && !image->pixel_stride; k++) {
        const float value = ((const float*)memory)[k];
        if (!(value >= 0.0f && value <= 3.4e38f)) abort();
    }
}

/* The CRC-32 of zip. */
static uint32_t checksum_of(const uint8_t* bytes, size_t count) {
    uint32_t sum = ~0u;
    for (size_t k = 0; k < count; k++) {
        sum ^= bytes[k];
        for (int bit = 0; bit < 8; bit++) sum = sum >> 1 ^ (sum & 1 ? 0xEDB88320u : 0);
    }
    return ~sum;
}

#endif
