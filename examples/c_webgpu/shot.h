/* The frames of a shot in raw files, which ../raw_frames.py wrote. */

#ifndef SHOT_H
#define SHOT_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stdint.h>

#include "upscaler.h"

/* A frame: its files, and fields of Frame in upscaler.h. */
typedef struct {
    const char* inputs[INPUTS]; /* NULL: it has none */
    uint32_t size[2];
    float jitter[2], exposure, pre_exposure;
    bool reset;
} ShotFrame;

typedef struct {
    cJSON* json;
    uint32_t display[2]; /* (width, height) of the images to make */
    ShotFrame* frames;
    int count;
} Shot;

/* Read frames.json. */
Shot shot_load(const char* folder);

void shot_free(Shot* shot);

#endif
