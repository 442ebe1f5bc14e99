/* Mutations that know JSON: a value is replaced by a hostile one or by another of the same text, doubled, or
 * gone. Without them nearly all inputs end in the parser. */

#include <ctype.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t most);

enum { MOST_SPANS = 8192, DEEPEST = 32, LARGEST = 1 << 16, MOST_KEPT = 64, KEPT_BYTES = 1 << 12 };

typedef struct {
    size_t start, end;
} Span;

/* clang-format off */
static const char *const hostile[] = {
    "0", "-1", "1", "2", "3", "63", "64", "65", "999", "5000", "16384", "65536", "4294967295", "4294967296",
    "1e308", "1e999", "-0.0", "0.5", "1e-45", "null", "true", "false", "[]", "{}", "[1]", "[1,1]",
    "[1,1,1]", "[0,0]", "[16384,16384]", "[[]]", "\"\"", "\"x\"", "\"../x\"", "\"/etc/passwd\"",
    "\"\\u0000\"", "\"00_measure.wgsl\"", "\"network0.bin\"", "\"params\"", "\"image\"", "\"history\"",
    "\"next\"", "\"texture\"", "\"buffer\"", "\"uniform\"", "\"storage-texture\"", "\"uint-texture\"",
    "\"rg32uint\"", "\"r32uint\"", "\"rgba32float\"",
};
/* clang-format on */

/* Small inputs that were stepped. libFuzzer keeps mostly what is refused; changes of it reach no further. */
static uint8_t kept[MOST_KEPT][KEPT_BYTES];
static size_t kept_sizes[MOST_KEPT], kept_count;

void keep_input(const uint8_t* data, size_t size) {
    if (size > KEPT_BYTES) return;
    size_t place = kept_count++ % MOST_KEPT;
    memcpy(kept[place], data, size);
    kept_sizes[place] = size;
}

/* Find values and keys, by their first and last byte. */
static size_t find_spans(const char* text, size_t size, Span spans[MOST_SPANS]) {
    size_t count = 0, depth = 0, opened[DEEPEST];
    for (size_t i = 0; i < size && count < MOST_SPANS;) {
        size_t start = i++;
        bool is_open = text[start] == '[' || text[start] == '{', is_word = isalnum((uint8_t)text[start]);
        if ((text[start] == ']' || text[start] == '}') && depth > 0) spans[opened[--depth]].end = i;
        if (text[start] == '"') {
            while (i < size && text[i] != '"') i += text[i] == '\\' ? 2 : 1;
            i = i < size ? i + 1 : size;
        } else if (is_word || text[start] == '-') {
            while (i < size && (isalnum((uint8_t)text[i]) || strchr("+-.", text[i]))) i++;
        } else if (!is_open || depth == DEEPEST) {
            continue;
        }
        if (is_open) opened[depth++] = count;
        spans[count++] = (Span){start, i};
    }
    return count;
}

static size_t append(uint8_t* text, size_t size, const void* data, size_t count) {
    memcpy(text + size, data, count);
    return size + count;
}

size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t most, unsigned int seed) {
    static Span spans[MOST_SPANS];
    static uint8_t text[3 * LARGEST];
    srand(seed);
    size_t place = (size_t)rand() % MOST_KEPT;
    if (rand() % 4 != 0 && place < kept_count && kept_sizes[place] <= most) {
        size = kept_sizes[place];
        memcpy(data, kept[place], size);
    }
    size_t count = size <= LARGEST ? find_spans((const char*)data, size, spans) : 0;
    if (count == 0 || rand() % 16 == 0) return LLVMFuzzerMutate(data, size, most);
    Span old = spans[(size_t)rand() % count], other = spans[(size_t)rand() % count];
    const char* value = hostile[(size_t)rand() % (sizeof hostile / sizeof *hostile)];
    size_t end = old.end, made = append(text, 0, data, old.start);
    switch (rand() % 8) {
        case 0: /* gone, with the comma after it */
            if (end < size && data[end] == ',') end++;
            break;
        case 1: /* doubled */
            made = append(text, made, data + old.start, old.end - old.start);
            made = append(text, made, ",", 1);
            end = old.start;
            break;
        case 2:
        case 3: made = append(text, made, data + other.start, other.end - other.start); break;
        default: made = append(text, made, value, strlen(value));
    }
    made = append(text, made, data + end, size - end);
    if (made > most) return size;
    memcpy(data, text, made);
    return made;
}
