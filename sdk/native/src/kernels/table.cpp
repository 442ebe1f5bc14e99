// The table of the kernels of one instruction set.
#include "../work.h"

#define SS_NAME_OF(isa) SS_TEXT_OF(isa)
#define SS_TEXT_OF(isa) #isa
#define SS_DECLARED(name, parameters) void name parameters;
#define SS_LISTED(name, parameters) name,

namespace ss {
namespace SS_ISA {
SS_KERNELS(SS_DECLARED)
extern void (*const GATHER[])(const ClassifierWork&, Rect, int thread);
extern void (*const FINISH[])(const ClassifierWork&, Rect, int thread);

extern const Kernels KERNELS = {SS_NAME_OF(SS_ISA), SS_KERNELS(SS_LISTED) GATHER, FINISH};
}  // namespace SS_ISA
}  // namespace ss
