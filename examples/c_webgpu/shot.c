#include "shot.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "files.h"
#include "resources.h"

enum { MOST_FRAMES = 1 << 16 };

static ShotFrame read_frame(const cJSON* item) {
    ShotFrame frame = {.reset = flag_of(item, "reset")};
    for (int i = 0; i < INPUTS; i++) {
        const char* name = given_names[i] + strlen("frame_");
        if (i <= INPUT_MOTION || cJSON_HasObjectItem(item, name)) frame.inputs[i] = file_of(item, name);
    }
    two_wholes_of(item, "size", LARGEST_SIDE, frame.size);
    two_numbers_of(item, "jitter", -0.5f, 0.5f, frame.jitter);
    if (!cJSON_IsNull(member(item, "exposure"))) /* null: measured */
        frame.exposure = number_of(item, "exposure", 0.0f, FLT_MAX);
    frame.pre_exposure = number_of(item, "pre_exposure", 0x1p-24f, 0x1p24f);
    return frame;
}

Shot shot_load(const char* folder) {
    Shot shot = {.json = read_json(folder, "frames.json")};
    two_wholes_of(shot.json, "display", LARGEST_SIDE, shot.display);
    const cJSON *item, *items = list_of(shot.json, "frames", 1, MOST_FRAMES);
    shot.frames = calloc((size_t)cJSON_GetArraySize(items), sizeof *shot.frames);
    if (shot.frames == NULL) fail("no memory");
    cJSON_ArrayForEach (item, items) shot.frames[shot.count++] = read_frame(item);
    return shot;
}

void shot_free(Shot* shot) {
    free(shot->frames);
    cJSON_Delete(shot->json);
}
