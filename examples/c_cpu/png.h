/* Linear images as bytes for a display, and as PNG files, without a library. */
#ifndef PNG_H
#define PNG_H

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* Converts (pixels, 3) linear RGB to sRGB bytes: exposure, tone curve c / (1 + max(c)), encoding. */
static void to_display(const float* image, size_t pixels, float exposure, uint8_t* rgb) {
    for (size_t k = 0; k < pixels; k++, image += 3, rgb += 3) {
        const float brightest = fmaxf(image[0], fmaxf(image[1], image[2])) * exposure;
        for (int c = 0; c < 3; c++) {
            const float light = image[c] * exposure / (1.0f + brightest);
            const float shown = light <= 0.0031308f ? 12.92f * light : 1.055f * powf(light, 1.0f / 2.4f) - 0.055f;
            rgb[c] = (uint8_t)(shown * 255.0f + 0.5f);
        }
    }
}

static void put_big_endian(uint8_t* to, uint32_t value) {
    for (int k = 0; k < 4; k++) to[k] = (uint8_t)(value >> (24 - 8 * k));
}

/* Writes a chunk: its length, type, data and CRC-32. data has 4 bytes before it for the type. */
static void write_chunk(FILE* file, const char* type, uint8_t* data, size_t count) {
    uint8_t word[4];
    uint32_t sum = ~0u;
    for (int k = 0; k < 4; k++) data[k - 4] = (uint8_t)type[k];
    for (size_t k = 0; k < count + 4; k++) {
        sum ^= data[k - 4];
        for (int bit = 0; bit < 8; bit++) sum = sum >> 1 ^ (sum & 1 ? 0xEDB88320u : 0);
    }
    put_big_endian(word, (uint32_t)count);
    fwrite(word, 1, 4, file);
    fwrite(data - 4, 1, count + 4, file);
    put_big_endian(word, ~sum);
    fwrite(word, 1, 4, file);
}

/* Writes (height, width, 3) bytes, each row as a block of zlib that is stored as it is: large files, little code. Rows
 * may have 21,844 pixels. Returns 1, or 0 where the file cannot be written. */
static int write_png(const char* path, const uint8_t* rgb, int width, int height) {
    const size_t row = 3 * (size_t)width + 1, block = row + 5;
    uint8_t* data = (uint8_t*)malloc(4 + 2 + block * height + 4);
    uint8_t header[4 + 13] = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 8, 2}, end[4];
    FILE* file = data ? fopen(path, "wb") : NULL;
    if (!file) {
        free(data);
        return 0;
    }
    uint8_t* to = data + 4;
    uint32_t a = 1, b = 0; /* Adler-32 */
    *to++ = 0x78, *to++ = 0x01;
    for (int y = 0; y < height; y++) {
        *to++ = y + 1 == height;
        *to++ = (uint8_t)row, *to++ = (uint8_t)(row >> 8), *to++ = (uint8_t)~row, *to++ = (uint8_t)(~row >> 8);
        for (size_t k = 0; k < row; k++) {
            *to = k ? rgb[(size_t)y * (row - 1) + k - 1] : 0; /* 0: the row is not filtered */
            a = (a + *to++) % 65521, b = (b + a) % 65521;
        }
    }
    put_big_endian(to, b << 16 | a);
    put_big_endian(header + 4, (uint32_t)width);
    put_big_endian(header + 8, (uint32_t)height);
    fwrite("\x89PNG\r\n\x1a\n", 1, 8, file);
    write_chunk(file, "IHDR", header + 4, 13);
    write_chunk(file, "IDAT", data + 4, 2 + block * height + 4);
    write_chunk(file, "IEND", end + 4, 0);
    free(data);
    return fclose(file) == 0;
}

#endif
