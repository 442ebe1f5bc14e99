// Half floats of the working memory: finite numbers, of either sign.
#pragma once

#include "colors.h"

namespace ss::SS_ISA {

typedef uint16_t H __attribute__((vector_size(2 * W)));

#if defined(__AVX512F__)
SS_INLINE F from_half(H v) { return (F)_mm512_cvtph_ps((__m256i)v); }
SS_INLINE H to_half(F v) { return (H)_mm512_cvtps_ph((__m512)v, _MM_FROUND_TO_NEAREST_INT); }
#elif defined(__AVX2__)
SS_INLINE F from_half(H v) { return (F)_mm256_cvtph_ps((__m128i)v); }
SS_INLINE H to_half(F v) { return (H)_mm256_cvtps_ph((__m256)v, _MM_FROUND_TO_NEAREST_INT); }
#elif defined(__aarch64__)
SS_INLINE F from_half(H v) { return (F)vcvt_f32_f16((float16x4_t)v); }
SS_INLINE H to_half(F v) { return (H)vcvt_f16_f32((float32x4_t)v); }
#else
SS_INLINE F from_half(H v) {
    I bits = __builtin_convertvector(v, I);
    return float_of(bits_of(float_of((bits & 0x7FFF) << 13) * 0x1p112f) | (bits & 0x8000) << 16);
}
SS_INLINE H to_half(F v) {  // ties to even; subnormal numbers round as floats do
    I bits = bits_of(absolute(v) * 0x1p-112f);
    bits = (bits + 0xFFF + (bits >> 13 & 1)) >> 13 | (bits_of(v) >> 16 & 0x8000);
    return __builtin_convertvector(bits, H);
}
#endif

// For numbers converted from half floats: clang would compare them as half floats, lane by lane.
SS_INLINE I is_positive(F v) { return bits_of(v) > 0; }

SS_INLINE F load_half(const uint16_t* from) { return from_half(load_as<H>(from)); }
SS_INLINE void stream_half(uint16_t* to, F v) { stream_as(to, to_half(v)); }

}  // namespace ss::SS_ISA
