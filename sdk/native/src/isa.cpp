// Chooses kernels by the instruction sets of the CPU.
#include "work.h"

#if defined(__aarch64__) && defined(__linux__)
#include <sys/auxv.h>
#endif

namespace ss {

namespace portable {
extern const Kernels KERNELS;
}
#if defined(__x86_64__)
namespace avx2 {
extern const Kernels KERNELS;
}
namespace avxvnni {
extern const Kernels KERNELS;
}
namespace avx512 {
extern const Kernels KERNELS;
}
#elif defined(__aarch64__)
namespace neon {
extern const Kernels KERNELS;
}
#endif

struct Choice {
    const Kernels* kernels;
    bool has;
};

#if defined(__x86_64__)

struct Registers {
    uint32_t a, b, c, d;
};

// __builtin_cpu_supports needs the compiler's runtime library, which not every linker finds.
static Registers cpuid(uint32_t leaf, uint32_t part) {
    Registers r;
    __asm__ volatile("cpuid" : "=a"(r.a), "=b"(r.b), "=c"(r.c), "=d"(r.d) : "a"(leaf), "c"(part));
    return r;
}

static bool has(uint32_t word, uint32_t bits) { return (word & bits) == bits; }

static void choices(Choice (&found)[4]) {
    constexpr uint32_t OSXSAVE = 1u << 27, FMA = 1u << 12, F16C = 1u << 29, AVX = 1u << 28;
    constexpr uint32_t MOVBE = 1u << 22, LZCNT = 1u << 5, BMI = 1u << 3, BMI2 = 1u << 8, AVX2 = 1u << 5;
    constexpr uint32_t F = 1u << 16, DQ = 1u << 17, CD = 1u << 28, BW = 1u << 30, VL = 1u << 31, VNNI = 1u << 11,
                       AVX_VNNI = 1u << 4;
    Registers basic = cpuid(1, 0), more = cpuid(0, 0).a >= 7 ? cpuid(7, 0) : Registers{};
    Registers extended = cpuid(0x80000000, 0).a > 0x80000000 ? cpuid(0x80000001, 0) : Registers{};
    uint32_t saved = 0, high = 0;
    if (has(basic.c, OSXSAVE)) __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    bool avx2 = has(basic.c, AVX | FMA | F16C | MOVBE) && has(more.b, AVX2 | BMI | BMI2) && has(extended.c, LZCNT) &&
                has(saved, 0x6);
    bool avx512 = avx2 && has(more.b, F | DQ | CD | BW | VL) && has(more.c, VNNI) && has(saved, 0xE6);
    found[0] = {&avx512::KERNELS, avx512};
    found[1] = {&avxvnni::KERNELS, avx2 && has(cpuid(7, 1).a, AVX_VNNI)};
    found[2] = {&avx2::KERNELS, avx2};
    found[3] = {&portable::KERNELS, true};
}

#elif defined(__aarch64__)

static bool has_dot_product() {
#if defined(__linux__)
    return getauxval(AT_HWCAP) & HWCAP_ASIMDDP;
#else
    return true;  // all of Apple's CPUs have it
#endif
}

static void choices(Choice (&found)[4]) {
    found[0] = {&neon::KERNELS, has_dot_product()};
    found[1] = found[2] = found[3] = {&portable::KERNELS, true};
}

#else

static void choices(Choice (&found)[4]) { found[0] = found[1] = found[2] = found[3] = {&portable::KERNELS, true}; }

#endif

const Kernels* find_kernels(const char* name) {
    Choice found[4];
    choices(found);
    for (const Choice& choice : found)
        if (choice.has && (!name || strcmp(name, choice.kernels->name) == 0)) return choice.kernels;
    return nullptr;
}

}  // namespace ss
