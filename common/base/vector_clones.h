// Loops over image samples, compiled twice where the processor may have wider vectors.
#ifndef PORTOLAN_COMMON_BASE_VECTOR_CLONES_H_
#define PORTOLAN_COMMON_BASE_VECTOR_CLONES_H_

#include <cstdint>

// PORTOLAN_VECTOR_CLONES before a function's definition: compiled for AVX2 as well as for the
// target's baseline, chosen when the program starts. AVX2 has no fused multiply-add and the
// compiler does not reorder sums, so both give the same bits. Inner functions must be
// PORTOLAN_INLINE to be compiled along. Sanitizers run before the choice can be made, so not there.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define PORTOLAN_VECTOR_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define PORTOLAN_VECTOR_CLONES
#endif

#define PORTOLAN_INLINE inline __attribute__((always_inline))

namespace portolan {

// Lanes that are computed at once, for loops that the compiler vectorises badly: one instruction
// with AVX2, two without. Integers wrap around. Not to be passed to or returned from functions.
using Byte16 = uint8_t __attribute__((vector_size(16)));
using Short8 = int16_t __attribute__((vector_size(16)));
using UShort8 = uint16_t __attribute__((vector_size(16)));
using UShort16 = uint16_t __attribute__((vector_size(32)));
using Short16 = int16_t __attribute__((vector_size(32)));
using Int8 = int32_t __attribute__((vector_size(32)));
using Float8 = float __attribute__((vector_size(32)));
using Long4 = int64_t __attribute__((vector_size(32)));
using Double4 = double __attribute__((vector_size(32)));

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BASE_VECTOR_CLONES_H_
