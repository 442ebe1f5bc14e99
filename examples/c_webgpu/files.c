#include "files.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void fail(const char* format, ...) {
    va_list values;
    va_start(values, format);
    fprintf(stderr, "error: ");
    vfprintf(stderr, format, values);
    fprintf(stderr, "\n");
    va_end(values);
    exit(1);
}

void refuse(const cJSON* object, const char* name, const char* wanted, ...) {
    char want[200];
    va_list values;
    va_start(values, wanted);
    vsnprintf(want, sizeof want, wanted, values);
    va_end(values);
    const cJSON* found = cJSON_GetObjectItemCaseSensitive(object, name);
    const char *got = found ? cJSON_PrintUnformatted(found) : "missing", *in = cJSON_PrintUnformatted(object);
    fail("\"%s\" is %.99s; want %s; export it again; it is in %.200s", name, got, want, in);
}

/* ---------------------------------------------------------------- files */

static FILE* opened(const char* folder, const char* name, const char* mode) {
    char path[4096];
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path)
        fail("%s: the path is too long", folder);
    FILE* file = fopen(path, mode);
    if (file == NULL) fail("%s: cannot be opened", path);
    return file;
}

/* Read a file of `min` to `max` bytes. */
static char* content(const char* folder, const char* name, size_t min, size_t max) {
    FILE* file = opened(folder, name, "rb");
    long length = fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    size_t size = length < 0 ? SIZE_MAX : (size_t)length;
    if (size < min || size > max) {
        fclose(file);
        const char* limit = min == max ? "" : "at most ";
        fail("%s/%s: %ld bytes; want %s%zu; export it again", folder, name, length, limit, max);
    }
    rewind(file);
    char* data = malloc(size + 1);
    bool done = data != NULL && fread(data, 1, size, file) == size;
    fclose(file);
    if (!done) fail("%s/%s: cannot be read", folder, name);
    data[size] = 0;
    return data;
}

static bool is_utf8(const char* text) {
    static const uint32_t min[] = {0, 0x80, 0x800, 0x10000}; /* codes of 1 to 4 bytes */
    for (const unsigned char* at = (const unsigned char*)text; *at != 0;) {
        int more = *at < 0x80 ? 0 : *at < 0xe0 ? 1 : *at < 0xf0 ? 2 : 3;
        uint32_t code = more == 0 ? *at : *at & (0x3fu >> more);
        if (*at >> 6 == 2 || *at >= 0xf8) return false;
        at++;
        for (int i = 0; i < more; i++, at++) {
            if (*at >> 6 != 2) return false;
            code = code << 6 | (*at & 0x3fu);
        }
        if (code < min[more] || code > 0x10ffff || (code >= 0xd800 && code < 0xe000)) return false;
    }
    return true;
}

char* read_text(const char* folder, const char* name) {
    char* text = content(folder, name, 0, LARGEST_TEXT);
    if (!is_utf8(text)) /* on which wgpu crashes */
        fail("%s/%s: is no UTF-8; export it again", folder, name);
    return text;
}

char* read_bytes(const char* folder, const char* name, size_t size) { return content(folder, name, size, size); }

void write_file(const char* folder, const char* name, const void* data, size_t size) {
    FILE* file = opened(folder, name, "wb");
    if (fwrite(data, 1, size, file) != size || fclose(file) != 0) fail("%s/%s: cannot be written", folder, name);
}

/* ---------------------------------------------------------------- JSON */

cJSON* read_json(const char* folder, const char* name) {
    char* text = read_text(folder, name);
    cJSON* json = cJSON_Parse(text);
    if (json == NULL) fail("%s/%s: is no JSON; export it again", folder, name);
    free(text);
    return json;
}

const cJSON* member(const cJSON* object, const char* name) {
    const cJSON* found = cJSON_GetObjectItemCaseSensitive(object, name);
    if (found == NULL) refuse(object, name, "a value");
    return found;
}

const cJSON* list_of(const cJSON* object, const char* name, int min, int max) {
    const cJSON* list = member(object, name);
    int count = cJSON_GetArraySize(list);
    if (!cJSON_IsArray(list) || count < min || count > max) refuse(object, name, "a list of %d to %d items", min, max);
    return list;
}

const char* text_of(const cJSON* object, const char* name) {
    const char* text = cJSON_GetStringValue(member(object, name));
    if (text == NULL) refuse(object, name, "a text");
    return text;
}

const char* file_of(const cJSON* object, const char* name) {
    const char* file = text_of(object, name);
    if (file[0] == 0 || file[0] == '.' || strpbrk(file, "/\\:") != NULL)
        refuse(object, name, "the name of a file in the same folder");
    return file;
}

int choice_of(const cJSON* object, const char* name, const char* const known[], int count) {
    const char* text = text_of(object, name);
    char names[200] = "";
    for (int i = 0; i < count; i++) {
        if (strcmp(text, known[i]) == 0) return i;
        size_t length = strlen(names);
        snprintf(names + length, sizeof names - length, "%s%s", i ? ", " : "", known[i]);
    }
    refuse(object, name, "one of: %s", names);
}

bool flag_of(const cJSON* object, const char* name) {
    const cJSON* flag = member(object, name);
    if (!cJSON_IsBool(flag)) refuse(object, name, "true or false");
    return cJSON_IsTrue(flag);
}

/* Whether a number is in a range; false for NaN, and for what is not a number. */
static bool is_within(const cJSON* number, double min, double max) {
    return cJSON_IsNumber(number) && number->valuedouble >= min && number->valuedouble <= max;
}

static bool is_whole(const cJSON* number, uint32_t min, uint32_t max) {
    return is_within(number, min, max) && number->valuedouble == (uint32_t)number->valuedouble;
}

uint32_t whole_of(const cJSON* object, const char* name, uint32_t min, uint32_t max) {
    const cJSON* number = member(object, name);
    if (!is_whole(number, min, max)) refuse(object, name, "a whole number from %u to %u", min, max);
    return (uint32_t)number->valuedouble;
}

float number_of(const cJSON* object, const char* name, float min, float max) {
    const cJSON* number = member(object, name);
    if (!is_within(number, min, max)) refuse(object, name, "a number from %g to %g", min, max);
    return (float)number->valuedouble;
}

void two_wholes_of(const cJSON* object, const char* name, uint32_t max, uint32_t values[2]) {
    const cJSON* list = member(object, name);
    bool is_pair = cJSON_IsArray(list) && cJSON_GetArraySize(list) == 2;
    for (int i = 0; i < 2; i++) {
        const cJSON* number = cJSON_GetArrayItem(list, i);
        if (!is_pair || !is_whole(number, 1, max)) refuse(object, name, "two whole numbers from 1 to %u", max);
        values[i] = (uint32_t)number->valuedouble;
    }
}

void two_numbers_of(const cJSON* object, const char* name, float min, float max, float values[2]) {
    const cJSON* list = member(object, name);
    bool is_pair = cJSON_IsArray(list) && cJSON_GetArraySize(list) == 2;
    for (int i = 0; i < 2; i++) {
        const cJSON* number = cJSON_GetArrayItem(list, i);
        if (!is_pair || !is_within(number, min, max)) refuse(object, name, "two numbers from %g to %g", min, max);
        values[i] = (float)number->valuedouble;
    }
}
