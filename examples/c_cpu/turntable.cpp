// Renders a turning scene in software, small, and upscales it in place: live in the terminal, or to PNG files.
//
//     turntable [-o FOLDER] [-n FRAMES] [-m MODEL] [-r RATIO] [-s WIDTHxHEIGHT] [-c]
//
// Without -o it draws half blocks in 24-bit colours until Ctrl-C, or for FRAMES frames. -c compares: the left half is the
// rendered frame. RATIO is that of display to render size, from 1 to 3.
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#include <cmath>
#include <string>
#include <vector>

#include <supersampler.h>

#include "png.h"

constexpr float PI = 3.14159265f, NEAR = 0.1f, FOCAL = 2.3f, TURN = 0.03f;  // radians per frame

struct Vec {
    float x, y, z;
};
static Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
static Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
static Vec operator*(Vec a, float s) { return {a.x * s, a.y * s, a.z * s}; }
static float dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
static Vec unit(Vec a) { return a * (1.0f / std::sqrt(dot(a, a))); }

// What a renderer writes for each sample. `ss_step` reads it where it is.
struct Sample {
    Vec color;
    float depth, motion[2];
};

enum class Material { KNOT, FLOOR };
struct Vertex {
    Vec position, normal;
};
struct Triangle {
    Vertex corners[3];
    Material material;
};

// A point of the curve of a trefoil knot.
static Vec knot_at(float t) {
    const float r = 0.75f + 0.3f * std::cos(3.0f * t);
    return {r * std::cos(2.0f * t), 1.0f + 0.42f * std::sin(3.0f * t), r * std::sin(2.0f * t)};
}

static Vertex knot_vertex(float t, float u) {
    const Vec center = knot_at(t), along = unit(knot_at(t + 0.01f) - center);
    const Vec side = unit(cross(along, {0.0f, 1.0f, 0.0f})), up = cross(side, along);
    const Vec normal = side * std::cos(u) + up * std::sin(u);
    return {center + normal * 0.14f, normal};
}

// Adds a grid of quads of function(row, column), each from 0 to 1.
template <class Function>
static void add_grid(std::vector<Triangle>& scene, int rows, int columns, Material material, const Function& function) {
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) {
            auto corner = [&](int di, int dj) { return function(float(i + di) / rows, float(j + dj) / columns); };
            scene.push_back({{corner(0, 0), corner(1, 0), corner(1, 1)}, material});
            scene.push_back({{corner(0, 0), corner(1, 1), corner(0, 1)}, material});
        }
}

static std::vector<Triangle> make_scene() {
    std::vector<Triangle> scene;
    add_grid(scene, 240, 18, Material::KNOT,
             [](float a, float b) { return knot_vertex(2.0f * PI * a, 2.0f * PI * b); });
    add_grid(scene, 48, 6, Material::FLOOR, [](float a, float b) {
        return Vertex{{2.2f * b * std::cos(2.0f * PI * a), 0.0f, 2.2f * b * std::sin(2.0f * PI * a)},
                      {0.0f, 1.0f, 0.0f}};
    });
    return scene;
}

static Vec turned(Vec v, float angle) {
    const float c = std::cos(angle), s = std::sin(angle);
    return {c * v.x + s * v.z, v.y, c * v.z - s * v.x};
}

// From the scene to the camera: x right, y up, z the distance.
static Vec to_camera(Vec v) {
    const Vec at = v - Vec{0.0f, 2.3f, 4.4f};
    const float c = 0.94f, s = 0.34f;  // looks down a bit
    return {at.x, c * at.y - s * at.z, -s * at.y - c * at.z};
}

struct Screen {
    float x, y, inverse;  // pixels; 1 / distance
};

static Vec shaded(Material material, Vec object, Vec normal, Vec world) {
    const Vec light = unit({0.6f, 1.0f, 0.5f}), eye = unit(Vec{0.0f, 2.3f, 4.4f} - world), half = unit(light + eye);
    Vec base = {0.85f, 0.35f, 0.12f};
    if (material == Material::KNOT && std::sin(40.0f * object.y) > 0.7f) base = {0.9f, 0.85f, 0.7f};
    if (material == Material::FLOOR) {
        const bool odd = (int(std::floor(object.x * 4.0f)) + int(std::floor(object.z * 4.0f))) & 1;
        base = odd ? Vec{0.75f, 0.78f, 0.8f} : Vec{0.08f, 0.1f, 0.14f};
    }
    const float diffuse = std::fmax(dot(normal, light), 0.0f),
                shine = std::pow(std::fmax(dot(normal, half), 0.0f), 60.0f);
    return base * (0.25f + 0.9f * diffuse) + Vec{1.0f, 1.0f, 1.0f} * (material == Material::KNOT ? 2.5f * shine : 0.0f);
}

class Renderer {
   public:
    Renderer(int width, int height) : width_(width), height_(height), samples_(size_t(width) * height) {}
    const std::vector<Sample>& samples() const { return samples_; }

    // Renders the scene turned by `angle`, which was at `before` in the previous frame.
    void render(const std::vector<Triangle>& scene, float angle, float before, const float jitter[2]) {
        for (int y = 0; y < height_; y++)
            for (int x = 0; x < width_; x++)
                samples_[size_t(y) * width_ + x] = {
                    Vec{0.35f, 0.5f, 0.75f} * (1.2f - float(y) / height_), 0.0f, {0.0f, 0.0f}};
        for (const Triangle& triangle : scene) draw(triangle, angle, before, jitter);
    }

   private:
    Screen project(Vec world) const {
        const Vec at = to_camera(world);
        const float inverse = 1.0f / at.z, scale = 0.5f * FOCAL * height_ * inverse;
        return {0.5f * width_ + at.x * scale, 0.5f * height_ - at.y * scale, inverse};
    }

    void draw(const Triangle& triangle, float angle, float before, const float jitter[2]) {
        Screen s[3];
        for (int k = 0; k < 3; k++) s[k] = project(turned(triangle.corners[k].position, angle));
        const float area = (s[1].x - s[0].x) * (s[2].y - s[0].y) - (s[2].x - s[0].x) * (s[1].y - s[0].y);
        if (area == 0.0f) return;
        auto bound = [&](float Screen::* axis, bool last, int limit, float offset) {
            const float a = s[0].*axis, b = s[1].*axis, c = s[2].*axis;
            const float end = last ? std::fmax(a, std::fmax(b, c)) : std::fmin(a, std::fmin(b, c));
            return int(
                std::fmin(std::fmax(std::floor(end - 0.5f - offset) + (last ? 1.0f : 0.0f), 0.0f), float(limit)));
        };
        const int x0 = bound(&Screen::x, false, width_, jitter[0]), x1 = bound(&Screen::x, true, width_, jitter[0]);
        const int y0 = bound(&Screen::y, false, height_, jitter[1]), y1 = bound(&Screen::y, true, height_, jitter[1]);
        for (int y = y0; y < y1; y++)
            for (int x = x0; x < x1; x++) {
                const float px = x + 0.5f + jitter[0], py = y + 0.5f + jitter[1];  // the sample
                auto edge = [&](const Screen& a, const Screen& b) {
                    return ((b.x - a.x) * (py - a.y) - (px - a.x) * (b.y - a.y)) / area;
                };
                const float w[3] = {edge(s[1], s[2]), edge(s[2], s[0]), edge(s[0], s[1])};
                if (w[0] < 0.0f || w[1] < 0.0f || w[2] < 0.0f) continue;
                shade(triangle, s, w, angle, before, px, py, samples_[size_t(y) * width_ + x]);
            }
    }

    void shade(const Triangle& triangle, const Screen (&s)[3], const float (&w)[3], float angle, float before, float px,
               float py, Sample& sample) {
        const float inverse = w[0] * s[0].inverse + w[1] * s[1].inverse + w[2] * s[2].inverse;
        if (NEAR * inverse <= sample.depth) return;
        Vec object = {}, normal = {};
        for (int k = 0; k < 3; k++) {  // perspective-correct
            object = object + triangle.corners[k].position * (w[k] * s[k].inverse / inverse);
            normal = normal + triangle.corners[k].normal * (w[k] * s[k].inverse / inverse);
        }
        const Screen previous = project(turned(object, before));
        sample.color = shaded(triangle.material, object, turned(unit(normal), angle), turned(object, angle));
        sample.depth = NEAR * inverse;
        sample.motion[0] = previous.x - px, sample.motion[1] = previous.y - py;
    }

    int width_, height_;
    std::vector<Sample> samples_;
};

static float halton(int index, int base) {
    float value = 0.0f, part = 1.0f;
    for (; index; index /= base) part /= base, value += part * (index % base);
    return value;
}

struct Options {
    std::string folder, model = "classifier";
    int frames = -1, width = 0, height = 0;
    float ratio = 2.0f;
    bool compares = false;
};

static bool parse(int count, char** values, Options& o) {
    for (int c; (c = getopt(count, values, "o:n:m:r:s:c")) != -1;) {
        if (c == 'o') o.folder = optarg;
        else if (c == 'n') o.frames = atoi(optarg);
        else if (c == 'm') o.model = optarg;
        else if (c == 'r') o.ratio = std::strtof(optarg, nullptr);
        else if (c == 's' && sscanf(optarg, "%dx%d", &o.width, &o.height) == 2) continue;
        else if (c == 'c') o.compares = true;
        else return false;
    }
    if (o.width == 0) {
        winsize terminal = {};
        const bool is_live =
            o.folder.empty() && ioctl(STDOUT_FILENO, TIOCGWINSZ, &terminal) == 0 && terminal.ws_col > 0;
        o.width = is_live ? terminal.ws_col : 640, o.height = is_live ? 2 * (terminal.ws_row - 1) : 360;
    }
    if (o.frames < 0 && !o.folder.empty()) o.frames = 64;
    return optind == count && o.ratio >= 1.0f && o.ratio <= 3.0f && o.width >= 8 && o.height >= 8 && o.width <= 8192 &&
           o.height <= 8192;
}

// The bytes of an image as half blocks: the upper pixel of a cell is its foreground, the lower one its background.
static void draw_in_terminal(const std::vector<uint8_t>& rgb, int width, int height) {
    std::string text = "\x1b[H";
    char cell[64];
    for (int y = 0; y + 1 < height; y += 2) {
        for (int x = 0; x < width; x++) {
            const uint8_t *a = &rgb[3 * (size_t(y) * width + x)], *b = a + 3 * width;
            snprintf(cell, sizeof cell, "\x1b[38;2;%d;%d;%dm\x1b[48;2;%d;%d;%dm\u2580", a[0], a[1], a[2], b[0], b[1],
                     b[2]);
            text += cell;
        }
        text += "\x1b[0m\n";
    }
    fwrite(text.data(), 1, text.size(), stdout);
    fflush(stdout);
}

static volatile sig_atomic_t interrupted = 0;

static int fail(const char* message) {
    fprintf(stderr, "%s\n", message);
    return 1;
}

int main(int count, char** values) {
    Options o;
    if (!parse(count, values, o))
        return fail("turntable [-o FOLDER] [-n FRAMES] [-m MODEL] [-r RATIO, 1 to 3] [-s WIDTHxHEIGHT] [-c]");
    const bool is_live = o.folder.empty();
    const int width = int(std::ceil(o.width / o.ratio)), height = int(std::ceil(o.height / o.ratio));
    ss_model* model;
    ss_upscaler* upscaler;
    ss_error error;
    if (ss_model_create(o.model.c_str(), nullptr, &model, &error) != SS_OK) return fail(error.message);
    if (ss_upscaler_create(model, o.width, o.height, &upscaler, &error) != SS_OK) return fail(error.message);

    const std::vector<Triangle> scene = make_scene();
    Renderer renderer(width, height);
    std::vector<float> image(size_t(3) * o.width * o.height);
    std::vector<uint8_t> bytes(image.size());
    const int period = int(std::ceil(8.0f * o.ratio * o.ratio));
    const char* failed = nullptr;
    signal(SIGINT, [](int) { interrupted = 1; });
    if (is_live) fputs("\x1b[?25l\x1b[2J", stdout);  // without a cursor

    for (int index = 0; index != o.frames && !interrupted && !failed; index++) {
        const float jitter[2] = {halton(index % period + 1, 2) - 0.5f, halton(index % period + 1, 3) - 0.5f};
        renderer.render(scene, index * TURN, (index - 1) * TURN, jitter);

        const Sample* samples = renderer.samples().data();
        auto image_of = [&](const void* first) {
            ss_image view = {};
            view.data = const_cast<void*>(first), view.pixel_stride = sizeof(Sample);
            return view;
        };
        ss_frame frame = {};
        frame.width = width, frame.height = height;
        frame.color = image_of(&samples->color), frame.depth = image_of(&samples->depth),
        frame.motion = image_of(&samples->motion);
        frame.jitter[0] = jitter[0], frame.jitter[1] = jitter[1];
        frame.exposure = 1.0f, frame.adds_samples = 1.0f, frame.reset = index == 0;
        ss_outputs outputs = {};
        outputs.image.data = image.data();
        if (ss_step(upscaler, &frame, &outputs, &error) != SS_OK) failed = error.message;

        for (int y = 0; y < o.height && o.compares; y++)
            for (int x = 0; x < o.width / 2; x++)
                memcpy(&image[3 * (size_t(y) * o.width + x)],
                       &samples[size_t(y * height / o.height) * width + x * width / o.width].color, sizeof(Vec));
        to_display(image.data(), image.size() / 3, 1.0f, bytes.data());
        if (is_live) {
            draw_in_terminal(bytes, o.width, o.height);
            const timespec pause = {0, 33'000'000};
            nanosleep(&pause, nullptr);
        } else {
            char name[32];
            snprintf(name, sizeof name, "/%04d.png", index);
            if (!write_png((o.folder + name).c_str(), bytes.data(), o.width, o.height))
                failed = "the folder of -o cannot be written to; create it first";
        }
    }
    if (is_live) fputs("\x1b[?25h\x1b[0m", stdout);
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
    return failed ? fail(failed) : 0;
}
