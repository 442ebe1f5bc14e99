/* Files, JSON, and the end of the program on an error.
 *
 * A folder may be damaged, or tampered with. Each value is checked here, where it is read; one
 * that does not fit ends the program with a line. Code that uses the values checks nothing. */

#ifndef FILES_H
#define FILES_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    LARGEST_SIDE = 16384,   /* of an image, in pixels */
    LARGEST_TEXT = 1 << 24, /* of JSON or a shader, in bytes */
};

/* Print a line, as printf does, and end the program. */
__attribute__((noreturn, format(printf, 1, 2))) void fail(const char* format, ...);

/* Do so because of a member of an object: what it is, and, in the words of the caller, what it must be. */
__attribute__((noreturn, format(printf, 3, 4))) void refuse(const cJSON* object, const char* name, const char* wanted,
                                                            ...);

/* Read a text of a folder, UTF-8, with a zero after it. The caller frees it. */
char* read_text(const char* folder, const char* name);

/* Read a file that has this many bytes. The caller frees it. */
char* read_bytes(const char* folder, const char* name, size_t size);

/* Write a file of a folder. */
void write_file(const char* folder, const char* name, const void* data, size_t size);

cJSON* read_json(const char* folder, const char* name);

/* A member of an object, which must be there. */
const cJSON* member(const cJSON* object, const char* name);

/* One that is a list of `min` to `max` items. */
const cJSON* list_of(const cJSON* object, const char* name, int min, int max);

const char* text_of(const cJSON* object, const char* name);

/* One that names a file in the folder of the JSON file, not outside of it. */
const char* file_of(const cJSON* object, const char* name);

/* One that is among known texts: its index. */
int choice_of(const cJSON* object, const char* name, const char* const known[], int count);

bool flag_of(const cJSON* object, const char* name);

uint32_t whole_of(const cJSON* object, const char* name, uint32_t min, uint32_t max);

float number_of(const cJSON* object, const char* name, float min, float max);

/* Lists of two, (x, y) or (width, height). */
void two_wholes_of(const cJSON* object, const char* name, uint32_t max, uint32_t values[2]); /* from 1 */
void two_numbers_of(const cJSON* object, const char* name, float min, float max, float values[2]);

#endif
