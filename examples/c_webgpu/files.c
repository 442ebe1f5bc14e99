#include "files.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

void fail(const char *format, ...)
{
    va_list values;
    va_start(values, format);
    fprintf(stderr, "error: ");
    vfprintf(stderr, format, values);
    fprintf(stderr, "\n");
    va_end(values);
    exit(1);
}

static FILE *opened(const char *folder, const char *name, const char *mode)
{
    char path[4096];
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path)
        fail("%s: the path is too long", folder);
    FILE *file = fopen(path, mode);
    if (file == NULL) fail("%s: cannot be opened", path);
    return file;
}

char *read_file(const char *folder, const char *name, size_t *size)
{
    FILE *file = opened(folder, name, "rb");
    fseek(file, 0, SEEK_END);
    long length = ftell(file);
    rewind(file);
    char *data = malloc((size_t)length + 1);
    if (data == NULL || fread(data, 1, (size_t)length, file) != (size_t)length)
        fail("%s/%s: cannot be read", folder, name);
    data[length] = 0;
    fclose(file);
    if (size != NULL) *size = (size_t)length;
    return data;
}

void write_file(const char *folder, const char *name, const void *data, size_t size)
{
    FILE *file = opened(folder, name, "wb");
    if (fwrite(data, 1, size, file) != size || fclose(file) != 0)
        fail("%s/%s: cannot be written", folder, name);
}

cJSON *read_json(const char *folder, const char *name)
{
    char *text = read_file(folder, name, NULL);
    cJSON *json = cJSON_Parse(text);
    if (json == NULL) fail("%s/%s: is no JSON", folder, name);
    free(text);
    return json;
}

const cJSON *member(const cJSON *object, const char *name)
{
    const cJSON *found = cJSON_GetObjectItemCaseSensitive(object, name);
    if (found == NULL) fail("upscaler.json or frames.json: no \"%s\"; export it again", name);
    return found;
}

const char *text_of(const cJSON *object, const char *name)
{
    const char *text = cJSON_GetStringValue(member(object, name));
    if (text == NULL) fail("\"%s\" is no text", name);
    return text;
}

double number_of(const cJSON *object, const char *name)
{
    return cJSON_GetNumberValue(member(object, name));
}

double item_of(const cJSON *list, int index)
{
    return cJSON_GetNumberValue(cJSON_GetArrayItem(list, index));
}
