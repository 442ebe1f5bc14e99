// Vectors of W lanes, the native width of the instruction set that a file is compiled for.
//
// Kernels are written once, on F (float) and I (int32) of W lanes and on F4 of four. Operators are those of the
// compiler's vector extensions; a scalar operand is broadcast. A comparison gives an I of 0 or -1 per lane, a mask.
// All of this is inlined into kernels: code for one instruction set must never be linked into code for another.
#pragma once

#include <stddef.h>
#include <stdint.h>

#if defined(__x86_64__) || defined(_M_X64)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#elif defined(__wasm__)
#include <wasm_simd128.h>
#endif

#define SS_INLINE static inline __attribute__((always_inline))

namespace ss::SS_ISA {

#if defined(__AVX512F__)
constexpr int W = 16;
#elif defined(__AVX2__)
constexpr int W = 8;
#else
constexpr int W = 4;
#endif

template <class T, T... K>
struct Sequence {};
#if defined(__clang__)
template <int n>
using Count = __make_integer_seq<Sequence, int, n>;  // of 0 to n - 1
#else
template <int n>
using Count = Sequence<int, __integer_pack(n)...>;
#endif
using Lanes = Count<W>;
template <int value>
struct Constant {
    static constexpr int k = value;
};

// Calls function(Constant<0>{}) to function(Constant<n - 1>{}): a loop that is written out.
template <class Function, int... K>
SS_INLINE void unrolled_of(const Function& function, Sequence<int, K...>) {
    (function(Constant<K>{}), ...);
}
template <int n, class Function>
SS_INLINE void unrolled(const Function& function) {
    unrolled_of(function, Count<n>{});
}

typedef float F __attribute__((vector_size(4 * W)));
typedef int32_t I __attribute__((vector_size(4 * W)));
typedef float F4 __attribute__((vector_size(16)));
typedef int32_t I4 __attribute__((vector_size(16)));
typedef uint8_t B __attribute__((vector_size(W)));

// Memory. Addresses need only the alignment of an element, except in `stream`.

template <class V>
struct Loose {
    V vector;
} __attribute__((packed, may_alias));

template <class V>
SS_INLINE V load_as(const void* from) {
    return static_cast<const Loose<V>*>(from)->vector;
}

SS_INLINE F load(const float* from) { return load_as<F>(from); }
SS_INLINE I load(const int32_t* from) { return load_as<I>(from); }
SS_INLINE F4 load4(const float* from) { return load_as<F4>(from); }
// GCC converts lane by lane where there is no intrinsic.
#if defined(__AVX512F__)
SS_INLINE I load(const uint8_t* from) { return (I)_mm512_cvtepu8_epi32((__m128i)load_as<B>(from)); }
SS_INLINE B to_bytes(I v) { return (B)_mm512_cvtepi32_epi8((__m512i)v); }
#elif defined(__AVX2__)
SS_INLINE I load(const uint8_t* from) {
    return (I)_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(from)));
}
SS_INLINE B to_bytes(I v) {
    const __m256i low = _mm256_shuffle_epi8((__m256i)v, _mm256_set1_epi32(0x0C080400));
    const __m128i words = _mm_unpacklo_epi32(_mm256_castsi256_si128(low), _mm256_extracti128_si256(low, 1));
    return (B)_mm_cvtsi128_si64(words);
}
#else
SS_INLINE I load(const uint8_t* from) { return __builtin_convertvector(load_as<B>(from), I); }
SS_INLINE B to_bytes(I v) { return __builtin_convertvector(v, B); }
#endif

template <class V>
SS_INLINE void store_as(void* to, V vector) {
    static_cast<Loose<V>*>(to)->vector = vector;
}

SS_INLINE void store(float* to, F v) { store_as(to, v); }
SS_INLINE void store(int32_t* to, I v) { store_as(to, v); }
SS_INLINE void store4(float* to, F4 v) { store_as(to, v); }
SS_INLINE void store(uint8_t* to, I v) { store_as(to, to_bytes(v)); }

// Stores that bypass the caches, for values that are not read again soon; `to` is aligned to the size of the vector. A
// kernel ends with `end_streams`, so that other threads see the values.
template <class V>
SS_INLINE void stream_as(void* to, V v) {
#if defined(__clang__)
    __builtin_nontemporal_store(v, static_cast<V*>(to));
#elif defined(__AVX512F__)
    if constexpr (sizeof v == 64) return _mm512_stream_si512(static_cast<__m512i*>(to), (__m512i)v);
    if constexpr (sizeof v == 32) return _mm256_stream_si256(static_cast<__m256i*>(to), (__m256i)v);
    store_as(to, v);
#elif defined(__AVX2__)
    if constexpr (sizeof v == 32) return _mm256_stream_si256(static_cast<__m256i*>(to), (__m256i)v);
    if constexpr (sizeof v == 16) return _mm_stream_si128(static_cast<__m128i*>(to), (__m128i)v);
    store_as(to, v);
#else
    store_as(to, v);
#endif
}
SS_INLINE void stream(float* to, F v) { stream_as(to, v); }
SS_INLINE void end_streams() {
#if defined(__x86_64__)
    _mm_sfence();
#endif
}
SS_INLINE bool is_aligned(const void* at) { return reinterpret_cast<uintptr_t>(at) % sizeof(F) == 0; }

SS_INLINE void prefetch(const void* at) { __builtin_prefetch(at, 0, 3); }

// Lanes.

SS_INLINE F spread(float value) { return value - F{}; }
SS_INLINE I spread(int32_t value) { return value - I{}; }

template <int... K>
SS_INLINE I ramp_of(Sequence<int, K...>) {
    return I{K...};
}
SS_INLINE I ramp() { return ramp_of(Lanes{}); }

SS_INLINE F to_float(I v) { return __builtin_convertvector(v, F); }
SS_INLINE I to_int(F v) { return __builtin_convertvector(v, I); }  // towards zero; values must fit
SS_INLINE I bits_of(F v) { return reinterpret_cast<I>(v); }
SS_INLINE F float_of(I v) { return reinterpret_cast<F>(v); }

// Returns the value, rounded: the compiler must not fuse a product with the subtraction that follows.
SS_INLINE F rounded(F v) {
#if defined(__x86_64__)
    __asm__("" : "+v"(v));
#elif defined(__aarch64__)
    __asm__("" : "+w"(v));
#endif
    return v;
}

SS_INLINE F select(I mask, F first, F second) { return mask ? first : second; }
SS_INLINE F select(I mask, float first, F second) { return mask ? spread(first) : second; }
SS_INLINE F select(I mask, F first, float second) { return mask ? first : spread(second); }
SS_INLINE F select(I mask, float first, float second) { return mask ? spread(first) : spread(second); }
SS_INLINE I select(I mask, I first, I second) { return mask ? first : second; }

// The second operand is returned where either is NaN.
#if defined(__AVX512F__)
SS_INLINE F minimum(F a, F b) { return (F)_mm512_min_ps((__m512)a, (__m512)b); }
SS_INLINE F maximum(F a, F b) { return (F)_mm512_max_ps((__m512)a, (__m512)b); }
SS_INLINE F square_root(F v) { return (F)_mm512_sqrt_ps((__m512)v); }
SS_INLINE F floor(F v) { return (F)_mm512_roundscale_ps((__m512)v, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC); }
SS_INLINE F absolute(F v) { return (F)_mm512_abs_ps((__m512)v); }
SS_INLINE uint32_t mask_bits(I mask) { return _mm512_movepi32_mask((__m512i)mask); }
#elif defined(__AVX2__)
SS_INLINE F minimum(F a, F b) { return (F)_mm256_min_ps((__m256)a, (__m256)b); }
SS_INLINE F maximum(F a, F b) { return (F)_mm256_max_ps((__m256)a, (__m256)b); }
SS_INLINE F square_root(F v) { return (F)_mm256_sqrt_ps((__m256)v); }
SS_INLINE F floor(F v) { return (F)_mm256_floor_ps((__m256)v); }
SS_INLINE F absolute(F v) { return float_of(bits_of(v) & 0x7FFFFFFF); }
SS_INLINE uint32_t mask_bits(I mask) { return static_cast<uint32_t>(_mm256_movemask_ps((__m256)mask)); }
#else
SS_INLINE F minimum(F a, F b) { return a < b ? a : b; }
SS_INLINE F maximum(F a, F b) { return a > b ? a : b; }
SS_INLINE F absolute(F v) { return float_of(bits_of(v) & 0x7FFFFFFF); }
#if defined(__aarch64__)
SS_INLINE F square_root(F v) { return (F)vsqrtq_f32((float32x4_t)v); }
SS_INLINE F floor(F v) { return (F)vrndmq_f32((float32x4_t)v); }
SS_INLINE uint32_t mask_bits(I mask) { return vaddvq_u32((uint32x4_t)(mask & I{1, 2, 4, 8})); }
#elif defined(__wasm__)
SS_INLINE F square_root(F v) { return (F)wasm_f32x4_sqrt((v128_t)v); }
SS_INLINE F floor(F v) { return (F)wasm_f32x4_floor((v128_t)v); }
SS_INLINE uint32_t mask_bits(I mask) { return wasm_i32x4_bitmask((v128_t)mask); }
#else
SS_INLINE F square_root(F v) {
    for (int k = 0; k < W; k++) v[k] = __builtin_sqrtf(v[k]);
    return v;
}
SS_INLINE F floor(F v) {
    F whole = to_float(to_int(select(absolute(v) < 1e9f, v, 0.0f)));
    whole = select(whole > v, whole - 1.0f, whole);
    return select(absolute(v) < 1e9f, whole, v);  // larger floats are whole
}
SS_INLINE uint32_t mask_bits(I mask) {
    mask &= I{1, 2, 4, 8};
    return static_cast<uint32_t>(mask[0] | mask[1] | mask[2] | mask[3]);
}
#endif
#endif

// Bit k of `mask_bits` is set where lane k is.
SS_INLINE bool all(I mask) { return mask_bits(mask) == (1u << W) - 1; }

SS_INLINE F minimum(F a, float b) { return minimum(a, spread(b)); }
SS_INLINE F maximum(F a, float b) { return maximum(a, spread(b)); }
SS_INLINE I minimum(I a, int32_t b) { return select(a < b, a, spread(b)); }
SS_INLINE I maximum(I a, int32_t b) { return select(a > b, a, spread(b)); }
SS_INLINE F clamped(F v, float low, float high) { return minimum(maximum(v, low), high); }
SS_INLINE I clamped(I v, int32_t low, int32_t high) { return minimum(maximum(v, low), high); }

SS_INLINE float sum_of_lanes(F v) {
    float total = 0.0f;
    for (int k = 0; k < W; k++) total += v[k];
    return total;
}

SS_INLINE float largest_of_lanes(F v) {
    float found = v[0];
    for (int k = 1; k < W; k++) found = v[k] > found ? v[k] : found;
    return found;
}

// Loads a value for each lane.
template <int... K>
SS_INLINE F gather_of(const float* from, I index, Sequence<int, K...>) {
    return F{from[index[K]]...};
}
SS_INLINE F gather(const float* from, I index) { return gather_of(from, index, Lanes{}); }

template <int... K>
SS_INLINE I gather_of(const int32_t* from, I index, Sequence<int, K...>) {
    return I{from[index[K]]...};
}
SS_INLINE I gather(const int32_t* from, I index) { return gather_of(from, index, Lanes{}); }

// Picks lanes of a vector by indices from 0 to W - 1.
SS_INLINE F permuted(F v, I index) {
#if defined(__AVX512F__)
    return (F)_mm512_permutexvar_ps((__m512i)index, (__m512)v);
#elif defined(__AVX2__)
    return (F)_mm256_permutevar8x32_ps((__m256)v, (__m256i)index);
#elif defined(__aarch64__)
    I bytes = index * 0x04040404 + 0x03020100;
    return (F)vqtbl1q_u8((uint8x16_t)v, (uint8x16_t)bytes);
#elif defined(__wasm__)
    I bytes = index * 0x04040404 + 0x03020100;
    return (F)wasm_i8x16_swizzle((v128_t)v, (v128_t)bytes);
#else
    float lanes[W];
    store(lanes, v);
    return gather(lanes, index);
#endif
}

// Shuffles: lane i of the result is lane `Order::at(i)` of two concatenated vectors.

template <class Order, class V, int... K>
SS_INLINE V shuffled(V a, V b, Sequence<int, K...>) {
    return __builtin_shufflevector(a, b, Order::at(K)...);
}
struct LowZip {
    static constexpr int at(int i) { return i / 2 + W * (i % 2); }
};
struct HighZip {
    static constexpr int at(int i) { return W / 2 + i / 2 + W * (i % 2); }
};
struct Evens {
    static constexpr int at(int i) { return 2 * i; }
};
struct Odds {
    static constexpr int at(int i) { return 2 * i + 1; }
};
// Every third lane of three concatenated vectors, from lane `first` on: first those in two of them, then all.
template <int first>
struct ThirdOfTwo {
    static constexpr int at(int i) { return 3 * i + first < 2 * W ? 3 * i + first : 0; }
};
template <int first>
struct ThirdOfLast {
    static constexpr int at(int i) { return 3 * i + first < 2 * W ? i : W + 3 * i + first - 2 * W; }
};
// Vector `part` of three vectors whose lanes are interleaved: first the lanes from two of them, then all.
template <int part, int lanes>
struct PartOfTwo {
    static constexpr int place(int i) { return (part * lanes + i) % 3 * lanes + (part * lanes + i) / 3; }
    static constexpr int at(int i) { return place(i) < 2 * lanes ? place(i) : 0; }
};
template <int part, int lanes>
struct PartOfLast {
    using Two = PartOfTwo<part, lanes>;
    static constexpr int at(int i) { return Two::place(i) < 2 * lanes ? i : lanes + Two::place(i) - 2 * lanes; }
};

template <class V>
SS_INLINE V low_zip(V a, V b) {
    return shuffled<LowZip>(a, b, Lanes{});
}
template <class V>
SS_INLINE V high_zip(V a, V b) {
    return shuffled<HighZip>(a, b, Lanes{});
}
template <class V>
SS_INLINE V evens(V a, V b) {
    return shuffled<Evens>(a, b, Lanes{});
}
template <class V>
SS_INLINE V odds(V a, V b) {
    return shuffled<Odds>(a, b, Lanes{});
}

// Transposes of N vectors: W pixels of N interleaved channels, or one vector per channel. Each round of zips rotates the
// bits of a value's place (vector, then lane) by one: the last becomes the first.

constexpr int log2_of(int n) { return n == 1 ? 0 : 1 + log2_of(n / 2); }

template <int N>
SS_INLINE void zip_round(F (&v)[N]) {
    F made[N];
    for (int k = 0; k < N / 2; k++) {
        made[2 * k] = low_zip(v[k], v[k + N / 2]);
        made[2 * k + 1] = high_zip(v[k], v[k + N / 2]);
    }
    for (int k = 0; k < N; k++) v[k] = made[k];
}

template <int N>
SS_INLINE void to_channels(F (&v)[N]) {  // of W pixels of N channels each
    for (int round = 0; round < log2_of(W); round++) zip_round(v);
}

template <int N>
SS_INLINE void to_pixels(F (&v)[N]) {  // inverse of `to_channels`
    for (int round = 0; round < log2_of(N); round++) zip_round(v);
}

template <int N>
SS_INLINE void load_channels(const float* from, F (&v)[N]) {
    for (int k = 0; k < N; k++) v[k] = load(from + k * W);
    to_channels(v);
}

// In each group of four lanes: the first or the last two lanes of two vectors, alternating or in pairs.
template <int first>
struct Alternating {
    static constexpr int at(int i) { return i / 4 * 4 + first + i % 4 / 2 + W * (i % 2); }
};
template <int first>
struct Pairs {
    static constexpr int at(int i) { return i / 4 * 4 + first + i % 2 + W * (i % 4 / 2); }
};

// Four vectors, of which vector k holds four channels of pixels k, k + 4, ..., become a vector per channel.
SS_INLINE void transpose_fours(F (&v)[4]) {
    F a = shuffled<Alternating<0>>(v[0], v[1], Lanes{}), b = shuffled<Alternating<2>>(v[0], v[1], Lanes{});
    F c = shuffled<Alternating<0>>(v[2], v[3], Lanes{}), d = shuffled<Alternating<2>>(v[2], v[3], Lanes{});
    v[0] = shuffled<Pairs<0>>(a, c, Lanes{});
    v[1] = shuffled<Pairs<2>>(a, c, Lanes{});
    v[2] = shuffled<Pairs<0>>(b, d, Lanes{});
    v[3] = shuffled<Pairs<2>>(b, d, Lanes{});
}

// Concatenates function(0), function(1), ... of four lanes each.
template <class Function>
SS_INLINE F concatenated(const Function& function) {
#if defined(__AVX512F__)
    return (F)_mm512_insertf32x8(
        _mm512_castps256_ps512(
            _mm256_insertf128_ps(_mm256_castps128_ps256((__m128)function(0)), (__m128)function(1), 1)),
        _mm256_insertf128_ps(_mm256_castps128_ps256((__m128)function(2)), (__m128)function(3), 1), 1);
#elif defined(__AVX2__)
    return (F)_mm256_insertf128_ps(_mm256_castps128_ps256((__m128)function(0)), (__m128)function(1), 1);
#else
    return function(0);
#endif
}

// Address of four channels of a pixel, in the layout that `load_four` reads as one vector per channel.
SS_INLINE float* four_at(float* pixels, int four, int pixel) {
    return pixels + (4 * four + pixel % 4) * W + pixel / 4 * 4;
}
SS_INLINE void load_four(const float* pixels, int four, F (&v)[4]) {
    for (int k = 0; k < 4; k++) v[k] = load(pixels + (4 * four + k) * W);
    transpose_fours(v);
}

struct F3 {
    F r, g, b;
};

SS_INLINE F3 load_rgb(const float* from) {  // of W pixels
    F a = load(from), b = load(from + W), c = load(from + 2 * W);
    auto third = [&]<int first>(Constant<first>) __attribute__((always_inline)) {
        return shuffled<ThirdOfLast<first>>(shuffled<ThirdOfTwo<first>>(a, b, Lanes{}), c, Lanes{});
    };
    return {third(Constant<0>{}), third(Constant<1>{}), third(Constant<2>{})};
}

// Vector k of three vectors whose lanes are interleaved.
template <int k, int lanes, class V>
SS_INLINE V interleaved(V a, V b, V c) {
    return shuffled<PartOfLast<k, lanes>>(shuffled<PartOfTwo<k, lanes>>(a, b, Count<lanes>{}), c, Count<lanes>{});
}
SS_INLINE F3 interleaved(F3 v) {
    return {interleaved<0, W>(v.r, v.g, v.b), interleaved<1, W>(v.r, v.g, v.b), interleaved<2, W>(v.r, v.g, v.b)};
}

// Six channels of W pixels as six vectors of pixels.
SS_INLINE void to_pixels(F (&v)[6]) {
    typedef int64_t Pairs __attribute__((vector_size(4 * W)));
    const Pairs a[] = {reinterpret_cast<Pairs>(low_zip(v[0], v[1])), reinterpret_cast<Pairs>(high_zip(v[0], v[1]))};
    const Pairs b[] = {reinterpret_cast<Pairs>(low_zip(v[2], v[3])), reinterpret_cast<Pairs>(high_zip(v[2], v[3]))};
    const Pairs c[] = {reinterpret_cast<Pairs>(low_zip(v[4], v[5])), reinterpret_cast<Pairs>(high_zip(v[4], v[5]))};
    for (int half = 0; half < 2; half++) {
        v[3 * half] = reinterpret_cast<F>(interleaved<0, W / 2>(a[half], b[half], c[half]));
        v[3 * half + 1] = reinterpret_cast<F>(interleaved<1, W / 2>(a[half], b[half], c[half]));
        v[3 * half + 2] = reinterpret_cast<F>(interleaved<2, W / 2>(a[half], b[half], c[half]));
    }
}

SS_INLINE void store_rgb(float* to, F3 v) {
    F3 parts = interleaved(v);
    store(to, parts.r);
    store(to + W, parts.g);
    store(to + 2 * W, parts.b);
}
SS_INLINE void stream_rgb(float* to, F3 v) {
    F3 parts = interleaved(v);
    stream(to, parts.r);
    stream(to + W, parts.g);
    stream(to + 2 * W, parts.b);
}

}  // namespace ss::SS_ISA
