// The encoder of the classifiers' network, level by level, row by row, so that layers read rows from the cache.
#include "classifier.h"

namespace ss::SS_ISA {

// Weight, in ninths, of `row` in the mean of three rows, taken twice, at row y.
static float tent_weight(int row, int y, int height) {
    int count = 0;
    for (int first = -1; first <= 1; first++)
        for (int second = -1; second <= 1; second++)
            count += clamp(clamp(y + first, 0, height - 1) + second, 0, height - 1) == row;
    return static_cast<float>(count);
}

// Blurs a plane of means at row y by a 5x5 tent; writes roots times 255 plus 0.5 to `tall`.
static void tent_row(const Network& n, int plane, int y, int p0, int p1, float* tall, float* line) {
    const float* rows[5];
    F weights[5];
    for (int k = 0; k < 5; k++) {
        rows[k] = n.means_at(clamp(y + k - 2, 0, n.half.height - 1), plane);
        weights[k] =
            spread(y + k - 2 < 0 || y + k - 2 >= n.half.height ? 0.0f : tent_weight(y + k - 2, y, n.half.height));
    }
    for (int x = p0; x < p1 + 2 * PAD; x += W) {
        F upper = load(rows[0] + x) * weights[0] + load(rows[1] + x) * weights[1];
        F lower = load(rows[4] + x) * weights[4] + load(rows[3] + x) * weights[3];
        store(tall + x, upper + load(rows[2] + x) * weights[2] + lower);
    }
    for (int x = PAD + p0; x < PAD + p1; x += W)
        store(line + x, load(tall + x - 1) + load(tall + x) + load(tall + x + 1));
    repeat_ends(line + PAD + p0, p1 - p0);
    for (int x = PAD + p0; x < PAD + p1; x += W) {
        F mean = (load(line + x - 1) + load(line + x) + load(line + x + 1)) * (1.0f / 81.0f);
        store(tall + x, minimum(root(absolute(mean)) * 255.0f + 0.5f, 255.0f));
    }
}

// Writes mean_difference and mean_abs_difference of packed pixels p0 to p1 of row y to their records: bytes 6 and 7 of
// the words at half size. Both blurs repeat the border.
static void mean_difference_row(const Network& n, int y, int p0, int p1, const ClassifierScratch& s) {
    for (int plane = 0; plane < 2; plane++) tent_row(n, plane, y, p0, p1, s.tall[plane], s.line);
    uint8_t* records = reinterpret_cast<uint8_t*>(n.records_at(y)) + 4 * INPUT_PLANES + 6;
    for (int p = p0; p < p1; p++)
        for (int plane = 0; plane < 2; plane++)
            records[4 * RECORD_WORDS * p + plane] = static_cast<uint8_t>(s.tall[plane][PAD + p]);
}

// Writes `history_contrast` and `beyond_range` of columns x0 to x1 of a row of the image to `lines`.
static void contrast_row(const Gathered& g, int height, int y, int x0, int x1, uint8_t* lines) {
    const float* rows[] = {g.luma + g.padded(max(y - 1, 0)), g.luma + g.padded(y),
                           g.luma + g.padded(min(y + 1, height - 1))};
    const uint8_t* samples = g.samples + g.place(y);
    for (int x = x0; x < x1; x += W) {
        F low = load(rows[1] + x), high = low;
        for (const float* row : rows)
            for (int k = -1; k <= 1; k++) {
                F other = load(row + x + k);
                low = minimum(other, low);
                high = maximum(other, high);
            }
        F luma = to_float(load(samples + x)) * (1.0f / 255.0f);
        store_input(lines + x, high - low);
        store_input(lines + g.pitch + x, maximum(maximum(low - luma, luma - high), 0.0f));
    }
}

// Writes the inputs that need neighbours, of packed pixels p0 to p1 of row y, to their records.
static void complete_row(const ClassifierWork& w, int y, int p0, int p1, const ClassifierScratch& s) {
    const int pitch = w.gathered.pitch, width = w.target.width, height = w.target.height;
    uint8_t* lines[2] = {s.inputs, s.inputs + 2 * pitch};
    for (int k = 0; k < 2; k++) {
        contrast_row(w.gathered, height, min(2 * y + k, height - 1), 2 * p0, min(up_to(2 * p1, LANES), pitch),
                     lines[k]);
        for (int c = 0; c < 2 && width % 2; c++) lines[k][c * pitch + width] = lines[k][c * pitch + width - 1];
    }
    int32_t* records = w.network->records_at(y) + IN_HISTORY_CONTRAST;
    for (int x = p0; x < p1; x += W) {
        I contrast = packed_words(lines[0] + 2 * x, lines[1] + 2 * x),
          beyond = packed_words(lines[0] + pitch + 2 * x, lines[1] + pitch + 2 * x);
        int32_t words[2 * W];
        store(words, low_zip(contrast, beyond));
        store(words + W, high_zip(contrast, beyond));
        for (int i = 0; i < min(W, p1 - x); i++)
            memcpy(records + (x + i) * RECORD_WORDS, words + 2 * i, 2 * sizeof(int32_t));
    }
    mean_difference_row(*w.network, y, p0, p1, s);
}

// Repeats the last record of a row after its end, as far as layers read.
static void repeat_last(const Network& n, int y, int width) {
    int32_t* row = n.records_at(y);
    for (int p = n.half.width; p < width + PIXELS_AT_ONCE; p++)
        memcpy(row + p * RECORD_WORDS, row + (n.half.width - 1) * RECORD_WORDS, 4 * RECORD_WORDS);
}

// Runs the first layer on rows y0 to y1, of columns x0 to x1. The first level reads the network inputs and completes
// them; it repeats the last row and column beyond the image. The others pool the level above.
void encode_first(const ClassifierWork& w, int depth, Rect box, int thread) {
    const Network& n = *w.network;
    const Level& level = n.level[depth];
    uint8_t* line = n.lines + thread * n.line_pitch;
    const int count = box.x1 - box.x0;
    for (int y = box.y0; y < box.y1; y++) {
        Input input = {line, level.inputs, level.first.words};  // channels are filled up to whole vectors
        if (depth) {
            const Level& above = n.level[depth - 1];
            pool_row(above.out_at(2 * y) + (KEPT[depth - 1] << 2 * (depth - 1)) + 2 * box.x0 * above.out_pitch,
                     above.out_pitch, above.out_row, level.inputs, line, count);
        } else {
            const int here = min(y, n.half.height - 1);
            if (here == y) {
                if (n.means) complete_row(w, here, box.x0, min(box.x1, n.half.width), w.scratch[thread]);
                if (box.x1 == level.width) repeat_last(n, here, level.width);
            }
            const int32_t* row = n.records_at(here) + box.x0 * RECORD_WORDS;
            input = {reinterpret_cast<const uint8_t*>(row), 4 * RECORD_WORDS, RECORD_WORDS};
        }
        uint8_t* to = level.x_at(y) + (box.x0 + 1) * level.x_pitch;
        pointwise_row(input, level.first, to, level.x_pitch, count);
        if (box.x1 == level.width) memset(to + count * level.x_pitch, 0, level.x_pitch);
    }
}

// Runs the other two layers, which read one more row of the first on each side.
void encode_others(const ClassifierWork& w, int depth, Rect box, int thread) {
    const Network& n = *w.network;
    const Level& level = n.level[depth];
    uint8_t* line = n.lines + thread * n.line_pitch;
    const int count = box.x1 - box.x0;
    for (int y = box.y0; y < box.y1; y++) {
        const uint8_t* rows[3];
        for (int k = 0; k < 3; k++)
            rows[k] =
                (y + k - 1 < 0 || y + k - 1 >= level.height ? n.zeros : level.x_at(y + k - 1)) + box.x0 * level.x_pitch;
        depthwise_row(rows, level.x_pitch, level.spatial, level.channels, line, count);
        uint8_t* to = level.out_at(y) + box.x0 * level.out_pitch;
        pointwise_row(Input{line, level.channels, level.channels / 4}, level.last, to, level.out_pitch, count);
    }
}

}  // namespace ss::SS_ISA
