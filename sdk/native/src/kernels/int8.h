// Layers of the int8 network; supersampler_export.quantize describes the quantization.
//
// Images are bytes, channels last. A layer sums products of bytes exactly, and converts the sums to bytes by a scale and
// a bias of each output. The sums of several outputs of PIXELS_AT_ONCE pixels stay in registers.
#pragma once

#include "../network.h"
#include "colors.h"

namespace ss::SS_ISA {

// Adds to each lane the four products of its unsigned and signed bytes.
SS_INLINE I dot4(I total, I bytes, I weights) {
#if defined(__AVX512VNNI__)
    return (I)_mm512_dpbusd_epi32((__m512i)total, (__m512i)bytes, (__m512i)weights);
#elif defined(__AVXVNNI__)
    return (I)_mm256_dpbusd_avx_epi32((__m256i)total, (__m256i)bytes, (__m256i)weights);
#elif defined(__AVX2__)
    const __m256i u = (__m256i)bytes, s = (__m256i)weights, low = _mm256_set1_epi16(0xFF);
    __m256i even = _mm256_madd_epi16(_mm256_and_si256(u, low), _mm256_srai_epi16(_mm256_slli_epi16(s, 8), 8));
    __m256i odd = _mm256_madd_epi16(_mm256_srli_epi16(u, 8), _mm256_srai_epi16(s, 8));
    return total + (I)even + (I)odd;
#elif defined(__ARM_FEATURE_DOTPROD)
    const int8x16_t s = (int8x16_t)weights, half = vdupq_n_s8(64);
    int32x4_t offset = vdotq_s32(vdotq_s32((int32x4_t)total, half, s), half, s);  // of the bytes less 128
    return (I)vdotq_s32(offset, (int8x16_t)(bytes ^ static_cast<int32_t>(0x80808080)), s);
#elif defined(__wasm__)
    const v128_t u = (v128_t)bytes, s = (v128_t)weights;
    const v128_t even =
        wasm_i32x4_dot_i16x8(wasm_v128_and(u, wasm_i16x8_splat(0xFF)), wasm_i16x8_shr(wasm_i16x8_shl(s, 8), 8));
    const v128_t odd = wasm_i32x4_dot_i16x8(wasm_u16x8_shr(u, 8), wasm_i16x8_shr(s, 8));
    return total + (I)even + (I)odd;
#else
    for (int k = 0; k < 32; k += 8) total += (bytes >> k & 255) * (weights << (24 - k) >> 24);
    return total;
#endif
}

SS_INLINE I load_words(const void* from) { return load_as<I>(from); }
SS_INLINE I spread_word(const uint8_t* from) { return spread(load_as<int32_t>(from)); }

// Converts sums of W outputs to bytes, rounded and clamped.
SS_INLINE I to_bytes(I total, const Layer& layer, int output) {
    F value = to_float(total) * load(layer.scale + output) + load(layer.bias + output);
    return to_int(clamped(value, 0.0f, 255.0f) + 0.5f);
}

constexpr int VECTORS = W == 4 ? 4 : 2;  // of outputs that are summed at once

// Images that a 1x1 convolution reads: `words` words of each pixel, pixels `pitch` bytes apart.
struct Input {
    const uint8_t* pixels;
    int pitch, words;
};

template <int n>
SS_INLINE void add_products(const Input& input, const int8_t* weights, I (&sums)[n][VECTORS]) {
    for (int k = 0; k < input.words; k++) {
        I w[VECTORS];
        for (int v = 0; v < VECTORS; v++) w[v] = load_words(weights + 4 * (BLOCK_OUTPUTS * k + v * W));
        for (int p = 0; p < n; p++) {
            I x = spread_word(input.pixels + p * input.pitch + 4 * k);
            for (int v = 0; v < VECTORS; v++) sums[p][v] = dot4(sums[p][v], x, w[v]);
        }
    }
}

// Computes a 1x1 convolution of a row of pixels, whose channels may be in two images. Nothing is written after a row of
// at least PIXELS_AT_ONCE pixels: other threads may read it.
SS_INLINE void pointwise_row(Input one, Input two, const Layer& layer, uint8_t* out, int out_pitch, int width) {
    for (int first = 0; first < width; first += PIXELS_AT_ONCE) {
        const int p = min(first, max(width - PIXELS_AT_ONCE, 0));
        const Input a = {one.pixels + p * one.pitch, one.pitch, one.words},
                    b = {two.pixels + p * two.pitch, two.pitch, two.words};
        for (int output = 0; output < BLOCK_OUTPUTS * layer.blocks; output += VECTORS * W) {
            const int block = output / BLOCK_OUTPUTS, within = output % BLOCK_OUTPUTS;
            const int8_t* weights =
                layer.weights + 4 * (static_cast<ptrdiff_t>(block) * layer.words * BLOCK_OUTPUTS + within);
            I sums[PIXELS_AT_ONCE][VECTORS] = {};
            add_products(a, weights, sums);
            if (b.words) add_products(b, weights + 4 * a.words * BLOCK_OUTPUTS, sums);
            for (int k = 0; k < PIXELS_AT_ONCE; k++)
                for (int v = 0; v < VECTORS; v++)
                    store(out + (p + k) * out_pitch + output + v * W, to_bytes(sums[k][v], layer, output + v * W));
        }
    }
}
SS_INLINE void pointwise_row(Input one, const Layer& layer, uint8_t* out, int out_pitch, int width) {
    pointwise_row(one, Input{one.pixels, 0, 0}, layer, out, out_pitch, width);
}

// Computes a depthwise 3x3 convolution of a row; rows: from the left neighbour on. weights: (channels / 16, 3, 16) words,
// a column of three weights for each channel.
SS_INLINE void depthwise_row(const uint8_t* const (&rows)[3], int pitch, const Layer& layer, int channels, uint8_t* out,
                             int width) {
    for (int c = 0; c < channels; c += W) {
        const int8_t* weights = layer.weights + 4 * (3 * (c / LANES * LANES) + c % LANES);
        const I left = load_words(weights), middle = load_words(weights + 4 * LANES),
                right = load_words(weights + 8 * LANES);
        const F scale = load(layer.scale + c), bias = load(layer.bias + c);
        const uint8_t *above = rows[0] + c, *here = rows[1] + c, *below = rows[2] + c;
        // three rows of W channels; each word holds the three bytes of a channel
        auto column = [&](int at) __attribute__((always_inline)) {
            return load(above + at) | load(here + at) << 8 | load(below + at) << 16;
        };
        I a = column(0), b = column(pitch);
        for (int p = 0; p < width; p++) {
            prefetch(below + (p + 16) * pitch);
            I d = column((p + 2) * pitch);
            I total = dot4(dot4(dot4(I{}, a, left), b, middle), d, right);
            store(out + p * channels + c, to_int(clamped(to_float(total) * scale + bias, 0.0f, 255.0f) + 0.5f));
            a = b;
            b = d;
        }
    }
}

// Pools 2x2 pixels by maximum.
SS_INLINE void pool_row(const uint8_t* x, int pitch, int row, int channels, uint8_t* out, int width) {
    for (int p = 0; p < width; p++)
        for (int c = 0; c < channels; c += 16) {
            typedef uint8_t B16 __attribute__((vector_size(16)));
            const uint8_t* at = x + 2 * p * pitch + c;
            B16 a = load_as<B16>(at), b = load_as<B16>(at + pitch), d = load_as<B16>(at + row),
                e = load_as<B16>(at + row + pitch);
            a = a > b ? a : b;
            d = d > e ? d : e;
            store_as(out + p * channels + c, a > d ? a : d);
        }
}

}  // namespace ss::SS_ISA
