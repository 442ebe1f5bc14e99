/* Files, JSON, and the end of the program on an error. */

#ifndef FILES_H
#define FILES_H

#include <cjson/cJSON.h>
#include <stddef.h>

/* Print a line, as printf does, and end the program. */
void fail(const char *format, ...);

/* Read a file of a folder, with a zero after it; *size takes its bytes unless it is NULL. The caller frees
 * it. */
char *read_file(const char *folder, const char *name, size_t *size);

/* Write a file of a folder. */
void write_file(const char *folder, const char *name, const void *data, size_t size);

cJSON *read_json(const char *folder, const char *name);

/* A member of an object, which must be there. */
const cJSON *member(const cJSON *object, const char *name);
const char *text_of(const cJSON *object, const char *name);
double number_of(const cJSON *object, const char *name);

/* An item of a list of numbers. */
double item_of(const cJSON *list, int index);

#endif
