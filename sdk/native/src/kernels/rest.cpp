// Static blocks; the same as supersampler_model.ops.at_rest.
#include "../rest.h"
#include "frame.h"
#include "images.h"

namespace ss::SS_ISA {

// Returns whether a sample of a block moves, or is reactive.
static bool block_moves(const Samples& s, int by, int bx) {
    constexpr float most = MAX_STATIC_MOTION * MAX_STATIC_MOTION;
    for (int y = by * BLOCK; y < min(by * BLOCK + BLOCK, s.height); y++)
        for (int x = bx * BLOCK; x < min(bx * BLOCK + BLOCK, s.width); x++) {
            const ptrdiff_t at = static_cast<ptrdiff_t>(y) * s.pitch + PAD + x;
            if (s.motion_x[at] * s.motion_x[at] + s.motion_y[at] * s.motion_y[at] > most) return true;
            if (s.has_reactive && s.reactive[static_cast<ptrdiff_t>(y) * s.stride + x] != 0.0f) return true;
        }
    return false;
}

// Writes which blocks of rows y0 to y1 move, and the signatures of all others: the mean fourth roots of RGB, and a
// weighted sum of all of them.
void sign_blocks(const RestWork& w, int y0, int y1) {
    const Samples& s = w.samples;
    const StaticBlocks& blocks = w.blocks;
    const int count = blocks.count();
    for (int by = y0; by < y1; by++)
        for (int first = 0; first < s.width; first += W) {
            F3 sums = {F{}, F{}, F{}};
            F order = F{};
            for (int row = 0; row < BLOCK; row++) {
                const float* at = linear_row(s, min(by * BLOCK + row, s.height - 1)) + first;
                F3 c = {load(at), load(at + s.stride), load(at + 2 * s.stride)};
                I good = is_number(c.r);
                auto fourth_root = [&](F v) { return square_root(square_root(select(good, v, 0.0f))); };
                c = {fourth_root(c.r), fourth_root(c.g), fourth_root(c.b)};
                sums = sums + c;
                const float* weights = w.order_weights + row * 3 * LANES;
                order += c.r * load(weights) + c.g * load(weights + LANES) + c.b * load(weights + 2 * LANES);
            }
            float columns[4][W];
            store(columns[0], sums.r);
            store(columns[1], sums.g);
            store(columns[2], sums.b);
            store(columns[3], order);
            for (int k = 0; k < W / BLOCK && first / BLOCK + k < blocks.size.width; k++) {
                const int block = by * blocks.size.width + first / BLOCK + k;
                const bool moves = block_moves(s, by, first / BLOCK + k);
                blocks.moving[block] = moves;
                for (int c = 0; c < 4; c++) {
                    const float* of = columns[c] + k * BLOCK;
                    const float total = of[0] + of[1] + of[2] + of[3];
                    blocks.signature[c * count + block] = moves   ? 0.0f
                                                          : c < 3 ? total * (1.0f / (BLOCK * BLOCK))
                                                                  : total;
                }
            }
        }
}

// Writes the SUMS of the selected blocks of rows y0 to y1.
void sum_blocks(const RestWork& w, int y0, int y1) {
    const Samples& s = w.samples;
    const StaticBlocks& blocks = w.blocks;
    const int across = blocks.size.width, count = blocks.count();
    for (int by = y0; by < y1; by++)
        for (int bx = 0; bx < across; bx++) {
            const int block = by * across + bx;
            float sums[SUMS] = {};
            for (int k = 0; k < BLOCK * BLOCK && blocks.selected[block]; k++) {
                const int y = min(by * BLOCK + k / BLOCK, s.height - 1), x = min(bx * BLOCK + k % BLOCK, s.width - 1);
                const float* sample = linear_row(s, y) + x;
                if (sample[0] != sample[0]) continue;
                float expected[4] = {};  // the mean there, and the fraction of pixels with enough samples
                for (int tap = 0; tap < 4; tap++) {
                    const int row = w.pixel_rows[2 * y + tap / 2], column = w.pixel_columns[2 * x + tap % 2];
                    if (w.ages[w.row_blocks[row] * across + w.column_blocks[column]] == 0.0f) continue;
                    const float weight = w.pixel_row_weights[2 * y + tap / 2] * w.pixel_column_weights[2 * x + tap % 2];
                    const float* pixel = w.mean + 4 * (static_cast<ptrdiff_t>(row) * w.display.width + column);
                    for (int c = 0; c < 3; c++) expected[c] += pixel[c] * weight;
                    expected[3] += pixel[3] >= LEAST_WEIGHT ? weight : 0.0f;
                }
                if (!(expected[3] > FULL_WEIGHT)) continue;
                sums[0] += 1.0f;
                for (int c = 0; c < 3; c++) {
                    const float value = sample[c * s.stride], residual = value - expected[c];
                    sums[1 + c] += residual;
                    sums[4 + c] += value;
                    sums[7 + c] += expected[c];
                    sums[10] += residual * residual;
                    sums[11] += value * value;
                }
            }
            for (int k = 0; k < SUMS; k++) blocks.sums[k * count + block] = sums[k];
        }
}

// Writes the next mean of a rectangle. Blocks without a mean are copied, too, as tiles of one generation are equal.
void add_samples(const RestWork& w, Rect rect) {
    const Samples& s = w.samples;
    for (int y = rect.y0; y < rect.y1; y++) {
        const uint8_t* modes = w.blocks.modes + w.row_blocks[y] * w.blocks.size.width;
        const float* samples[] = {linear_row(s, w.sample_rows[2 * y]), linear_row(s, w.sample_rows[2 * y + 1])};
        for (int x = rect.x0; x < rect.x1; x++) {
            const uint8_t mode = modes[w.column_blocks[x]];
            const ptrdiff_t at = 4 * (static_cast<ptrdiff_t>(y) * w.display.width + x);
            F4 mean = mode == RESTARTS ? F4{} : load4(w.mean + at);
            if (mode == ADDS || mode == RESTARTS) {
                F4 added = F4{};
                for (int tap = 0; tap < 4; tap++) {
                    const float weight =
                        w.sample_row_weights[2 * y + tap / 2] * w.sample_column_weights[2 * x + tap % 2];
                    const float* sample = samples[tap / 2] + w.sample_columns[2 * x + tap % 2];
                    if (weight > 0.0f && sample[0] == sample[0])
                        added += F4{sample[0], sample[s.stride], sample[2 * s.stride], 1.0f} * weight;
                }
                if (added[3] > 0.0f) {
                    const float before = mean[3], total = before + added[3];
                    mean[3] = 1.0f;
                    mean = (mean * before + added) * (1.0f / max(total, 1e-6f));
                    mean[3] = total;
                }
            }
            store4(w.next_mean + at, mean);
        }
    }
}

// Slope of a mean at a pixel; see `at_centres` of the torch module.
static F slope(F before, F here, F after, F known) {
    F below = here - before, above = after - here;
    F limit = minimum(absolute(below), absolute(above)) * known * 2.0f;
    return maximum(minimum((below + above) * 0.5f, limit), 0.0f - limit);
}

// The mean at W pixels of a row from x on; those beyond the row repeat its ends.
static void load_mean(const RestWork& w, int y, int x, F (&v)[4]) {
    const float* row = w.next_mean + 4 * static_cast<ptrdiff_t>(clamp(y, 0, w.display.height - 1)) * w.display.width;
    if (x >= 0 && x + W <= w.display.width) return load_channels(row + 4 * x, v);
    float pixels[4 * W];
    for (int k = 0; k < W; k++) store4(pixels + 4 * k, load4(row + 4 * clamp(x + k, 0, w.display.width - 1)));
    load_channels(pixels, v);
}

// 1 where pixels have the samples of a whole period, else 0.
static F are_complete(const RestWork& w, int y, I column_blocks, F weights) {
    const float* complete = w.blocks.complete + w.row_blocks[clamp(y, 0, w.display.height - 1)] * w.blocks.size.width;
    return select(weights >= LEAST_WEIGHT, gather(complete, column_blocks), 0.0f);
}

static I blocks_at(const RestWork& w, int x) {
    if (x >= 0 && x + W <= w.display.width) return load(w.column_blocks + x);
    int32_t blocks[W];
    for (int k = 0; k < W; k++) blocks[k] = w.column_blocks[clamp(x + k, 0, w.display.width - 1)];
    return load(blocks);
}

// The mean of a period's samples at W pixels, moved to their centres along its slope.
static F3 centred(const RestWork& w, int y, int x, I column_blocks, const F (&here)[4]) {
    F weight = F{}, across = F{}, down = F{};
    for (int phase = 0; phase < w.phases; phase++) {
        const float* columns = w.column_moments + 2 * static_cast<ptrdiff_t>(phase) * w.column_pitch + x;
        const float* rows = w.row_moments + 2 * static_cast<ptrdiff_t>(phase) * w.row_pitch + y;
        F gx = load(columns);
        weight += gx * rows[0];
        across += load(columns + w.column_pitch) * rows[0];
        down += gx * rows[w.row_pitch];
    }
    weight = maximum(weight, 1e-6f);
    F dx = across / weight, dy = down / weight, left[4], right[4], above[4], under[4];
    load_mean(w, y, x - 1, left);
    load_mean(w, y, x + 1, right);
    load_mean(w, y - 1, x, above);
    load_mean(w, y + 1, x, under);
    F known_x = are_complete(w, y, blocks_at(w, x - 1), left[3]) * are_complete(w, y, blocks_at(w, x + 1), right[3]);
    F known_y = are_complete(w, y - 1, column_blocks, above[3]) * are_complete(w, y + 1, column_blocks, under[3]);
    F moved[3];
    for (int c = 0; c < 3; c++)
        moved[c] = maximum(here[c] - slope(left[c], here[c], right[c], known_x) * dx -
                               slope(above[c], here[c], under[c], known_y) * dy,
                           0.0f);
    return {moved[0], moved[1], moved[2]};
}

// Fades the image to the mean in a rectangle. `shares` of blocks: 0 to 1 is the weight of the mean, 2 replaces the image by
// the mean, -1 derives the weight from the mean's own.
void show_mean(const RestWork& w, Rect rect) {
    float tail[3 * W];
    for (int y = rect.y0; y < rect.y1; y++) {
        const float* shares = w.blocks.shares + w.row_blocks[y] * w.blocks.size.width;
        float* row = reinterpret_cast<float*>(const_cast<char*>(w.image.data) + y * w.image.row);
        for (int x = rect.x0; x < rect.x1; x += W) {
            I columns = blocks_at(w, x), inside = ramp() + x < rect.x1;
            F share = gather(shares, columns), mean[4];
            if (all((share == 0.0f) | ~inside)) continue;
            load_mean(w, y, x, mean);
            F3 color = {mean[0], mean[1], mean[2]};
            I fades = (share > 0.0f) & (share < 1.5f), frozen = share > 1.5f;
            if (!all(frozen | ~inside)) {
                F3 own = load_rgb(whole_vector<3>(row, x, rect.x1, tail));
                if (!all(~fades)) color = select(fades, centred(w, y, x, columns, mean), color);
                F part = select(mean[3] >= LEAST_WEIGHT, share, 0.0f);
                part = select(share < 0.0f, clamped(mean[3] * (1.0f / NOISE_WEIGHT) - 1.0f, 0.0f, 1.0f), part);
                F3 faded = bounded(lerp(own, maximum3(color, 0.0f), part));
                color = select(frozen, color, select(share == 0.0f, own, faded));
            }
            write_rgb(w.image, y, x, rect.x1, color);
        }
    }
    end_streams();
}

// Copies rows of packed RGB to an image of any type, times a factor.
void copy_image(const View& from, const View& to, int width, int y0, int y1, float factor) {
    float tail[3 * W];
    for (int y = y0; y < y1; y++) {
        const float* row = reinterpret_cast<const float*>(from.data + y * from.row);
        for (int x = 0; x < width; x += W)
            write_rgb(to, y, x, width, load_rgb(whole_vector<3>(row, x, width, tail)) * factor);
    }
    end_streams();
}

// Writes the nearest pixels of a plane of another size.
void pick_pixels(const float* from, Size from_size, const View& to, Size size, int y0, int y1) {
    for (int y = y0; y < y1; y++) {
        const float* row =
            from + (2 * static_cast<ptrdiff_t>(y) + 1) * from_size.height / (2 * size.height) * from_size.width;
        for (int x = 0; x < size.width; x++)
            store_value(to, const_cast<char*>(to.data) + y * to.row + x * to.pixel,
                        row[(2 * static_cast<ptrdiff_t>(x) + 1) * from_size.width / (2 * size.width)]);
    }
}

// Writes 1 at the pixels whose block is frozen, else 0.
void write_converged(const RestWork& w, const View& image, int y0, int y1) {
    for (int y = y0; y < y1; y++)
        for (int x = 0; x < w.display.width; x++) {
            const int block = w.row_blocks[y] * w.blocks.size.width + w.column_blocks[x];
            const bool frozen = w.blocks.stays[block] || w.blocks.freezes[block];
            store_value(image, const_cast<char*>(image.data) + y * image.row + x * image.pixel, frozen ? 1.0f : 0.0f);
        }
}

// Copies the image to the mean in blocks that freeze.
void freeze_mean(const RestWork& w, Rect rect) {
    for (int y = rect.y0; y < rect.y1; y++) {
        const uint8_t* freezes = w.blocks.freezes + w.row_blocks[y] * w.blocks.size.width;
        const float* row = reinterpret_cast<const float*>(w.image.data + y * w.image.row);
        for (int x = rect.x0; x < rect.x1; x++)
            if (freezes[w.column_blocks[x]])
                memcpy(w.next_mean + 4 * (static_cast<ptrdiff_t>(y) * w.display.width + x), row + 3 * x,
                       3 * sizeof(float));
    }
}

}  // namespace ss::SS_ISA
