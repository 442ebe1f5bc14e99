/* What the host calls of the C library, replaced in the fuzz target: `-include hooks.h` before its sources.
 *
 * A folder that is refused ends a run, not the program, and what was allocated until then is freed after it.
 */

#include <stdio.h>
#include <stdlib.h>

__attribute__((noreturn)) void hook_exit(int status);
FILE* hook_fopen(const char* path, const char* mode);
void* hook_malloc(size_t size);
void* hook_calloc(size_t count, size_t size);
void hook_free(void* data);

#define exit hook_exit
#define fopen hook_fopen
#define malloc hook_malloc
#define calloc hook_calloc
#define free hook_free
