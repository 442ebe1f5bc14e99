// A model that turns in VTK's software OpenGL: rendered small and upscaled by the CPU library, beside VTK's MSAA.
//
//     viewer [-o FOLDER] [-n FRAMES] [-m MODEL] [-s WIDTHxHEIGHT] [-t DEGREES]
//
// Writes PNG files, MSAA on the left and the upscaled image on the right, and prints the times of a frame and both errors
// against images rendered at three times the size. Needs an X server, and Xvfb is one: xvfb-run -a viewer.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkCellData.h>
#include <vtkFloatArray.h>
#include <vtkImageData.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkOutlineSource.h>
#include <vtkPNGWriter.h>
#include <vtkParametricBoy.h>
#include <vtkParametricFunctionSource.h>
#include <vtkPlaneSource.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkTrivialProducer.h>
#include <vtkTubeFilter.h>
#include <vtkUnsignedCharArray.h>

#include <supersampler.h>

constexpr int RATIO = 2, MSAA = 4, SUPERSAMPLES = 3, TILES = 24;
constexpr int WARM_UP = 8;  // first frames, which are neither timed nor scored

struct Options {
    std::string folder, model = "classifier";
    int frames = 40, width = 1280, height = 720;
    double turn = 1.5;  // degrees a frame
};

static double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

static float halton(int index, int base) {
    float result = 0.0f, digit = 1.0f;
    for (int i = index + 1; i > 0; i /= base) result += (digit /= base) * (i % base);
    return result;
}

static void add(vtkRenderer* renderer, vtkAlgorithm* source, double r, double g, double b) {
    vtkNew<vtkPolyDataMapper> mapper;
    vtkNew<vtkActor> actor;
    mapper->SetInputConnection(source->GetOutputPort());
    actor->SetMapper(mapper);
    actor->GetProperty()->SetColor(r, g, b);
    actor->GetProperty()->SetSpecular(0.6), actor->GetProperty()->SetSpecularPower(40.0);
    renderer->AddActor(actor);
}

static void fill(vtkRenderer* renderer) {
    vtkNew<vtkParametricBoy> boy;
    vtkNew<vtkParametricFunctionSource> surface;
    surface->SetParametricFunction(boy);
    surface->SetUResolution(300), surface->SetVResolution(300);
    surface->SetScalarModeToNone();
    add(renderer, surface, 0.85, 0.4, 0.15);
    vtkNew<vtkOutlineSource> box;
    box->SetBounds(-1.5, 1.5, -1.5, 1.5, -2.2, 1.2);
    vtkNew<vtkTubeFilter> tubes;
    tubes->SetInputConnection(box->GetOutputPort());
    tubes->SetRadius(0.04);
    tubes->SetNumberOfSides(12);
    add(renderer, tubes, 0.95, 0.95, 0.9);
    vtkNew<vtkPlaneSource> floor;
    floor->SetOrigin(-3.0, -3.0, -2.2), floor->SetPoint1(3.0, -3.0, -2.2), floor->SetPoint2(-3.0, 3.0, -2.2);
    floor->SetXResolution(TILES), floor->SetYResolution(TILES);
    floor->Update();
    vtkNew<vtkUnsignedCharArray> colors;
    colors->SetNumberOfComponents(3);
    for (int k = 0; k < TILES * TILES; k++) {
        const double shade = (k + k / TILES) % 2 ? 200.0 : 60.0;
        colors->InsertNextTuple3(shade, shade, 1.1 * shade);
    }
    floor->GetOutput()->GetCellData()->SetScalars(colors);
    vtkNew<vtkTrivialProducer> tiles;
    tiles->SetOutput(floor->GetOutput());
    add(renderer, tiles, 1.0, 1.0, 1.0);
    renderer->SetBackground(0.12, 0.15, 0.2);
}

// A window of the scene, all of which show the same camera.
class View {
   public:
    View(int width, int height, int samples, vtkCamera* camera) : width_(width), height_(height) {
        fill(renderer_);
        if (camera) renderer_->SetActiveCamera(camera);
        window_->SetOffScreenRendering(1);
        window_->SetMultiSamples(samples);
        window_->AddRenderer(renderer_);
        window_->SetSize(width, height);
    }

    vtkRenderer* renderer() { return renderer_; }

    // Renders, and reads the pixels: RGB bytes, the lowest row first.
    const unsigned char* render() {
        window_->Render();
        window_->GetPixelData(0, 0, width_ - 1, height_ - 1, 0, pixels_);
        return pixels_->GetPointer(0);
    }

    const float* depth() {  // of a z-buffer: 1 is far away
        window_->GetZbufferData(0, 0, width_ - 1, height_ - 1, depth_);
        return depth_->GetPointer(0);
    }

   private:
    int width_, height_;
    vtkNew<vtkRenderer> renderer_;
    vtkNew<vtkRenderWindow> window_;
    vtkNew<vtkUnsignedCharArray> pixels_;
    vtkNew<vtkFloatArray> depth_;
};

// Renders small with jitter, and upscales.
class Upscaled {
   public:
    Upscaled(const Options& o, vtkCamera* camera)
        : width_(o.width / RATIO),
          height_(o.height / RATIO),
          view_(width_, height_, 0, camera),
          camera_(camera),
          color_(size_t(3) * width_ * height_),
          depth_(size_t(width_) * height_),
          motion_(size_t(2) * width_ * height_),
          image_(size_t(3) * o.width * o.height),
          shown_(image_.size()) {
        ss_error error;
        if (ss_model_create(o.model.c_str(), nullptr, &model_, &error) != SS_OK ||
            ss_upscaler_create(model_, o.width, o.height, &upscaler_, &error) != SS_OK)
            throw std::string(error.message);
        for (int k = 0; k < 256; k++) linear_[k] = float(k * k) / (255.0f * 255.0f);
    }
    ~Upscaled() { ss_upscaler_destroy(upscaler_), ss_model_destroy(model_); }

    // Returns RGB bytes at display size, the lowest row first. `seconds`: render, inputs, step.
    const unsigned char* render(int index, double (&seconds)[3]) {
        const double began = now();
        const float jitter[2] = {halton(index % (8 * RATIO * RATIO), 2) - 0.5f,
                                 halton(index % (8 * RATIO * RATIO), 3) - 0.5f};
        // x right, y down; the window's y points up
        camera_->SetWindowCenter(2.0 * jitter[0] / width_, -2.0 * jitter[1] / height_);
        const unsigned char* pixels = view_.render();
        camera_->SetWindowCenter(0.0, 0.0);
        const float* z = view_.depth();
        const double rendered = now();
        for (size_t k = 0; k < color_.size(); k++) color_[k] = linear_[pixels[k]];
        double range[2];
        camera_->GetClippingRange(range);
        for (size_t k = 0; k < depth_.size(); k++)  // 1 / distance; 0 where there is nothing
            depth_[k] = z[k] < 1.0f ? float((range[1] - z[k] * (range[1] - range[0])) / (range[0] * range[1])) : 0.0f;
        find_motion(z, jitter);
        const double prepared = now();
        upscale(jitter, index == 0);
        for (size_t k = 0; k < image_.size(); k++)
            shown_[k] = (unsigned char)(255.0f * std::sqrt(std::fmin(image_[k], 1.0f)) + 0.5f);
        const double ended = now();
        seconds[0] = rendered - began, seconds[1] = prepared - rendered, seconds[2] = ended - prepared;
        return shown_.data();
    }

   private:
    // All that moves is the camera, so motion follows from depth and two matrices.
    void find_motion(const float* z, const float (&jitter)[2]) {
        vtkMatrix4x4* projection = camera_->GetCompositeProjectionTransformMatrix(double(width_) / height_, -1.0, 1.0);
        vtkNew<vtkMatrix4x4> inverse, to_previous, from_z;
        vtkMatrix4x4::Invert(projection, inverse);
        from_z->SetElement(2, 2, 2.0), from_z->SetElement(2, 3, 1.0);  // from z - 1 to OpenGL's clip space
        if (!has_previous_) previous_->DeepCopy(projection);
        vtkMatrix4x4::Multiply4x4(previous_, inverse, to_previous);
        vtkMatrix4x4::Multiply4x4(to_previous, from_z, to_previous);
        previous_->DeepCopy(projection), has_previous_ = true;
        ss_image depth = upside_down(z, 1), motion = upside_down(motion_.data(), 2);
        ss_camera_motion(&depth, width_, height_, to_previous->GetData(), 1.0, jitter, &motion, nullptr);
    }

    void upscale(const float (&jitter)[2], bool reset) {
        ss_frame frame = {};
        frame.width = width_, frame.height = height_;
        frame.color = upside_down(color_.data(), 3), frame.depth = upside_down(depth_.data(), 1),
        frame.motion = upside_down(motion_.data(), 2);
        frame.jitter[0] = jitter[0], frame.jitter[1] = jitter[1];
        frame.exposure = 1.0f, frame.adds_samples = 1.0f, frame.reset = reset;
        ss_outputs outputs = {};
        const ptrdiff_t row = ptrdiff_t(3) * RATIO * width_ * ptrdiff_t(sizeof(float));
        outputs.image.data = image_.data() + image_.size() - 3 * RATIO * width_, outputs.image.row_stride = -row;
        ss_error error;
        if (ss_step(upscaler_, &frame, &outputs, &error) != SS_OK) throw std::string(error.message);
    }

    // OpenGL's rows begin at the bottom; the library takes them as they are.
    ss_image upside_down(const float* values, int channels) const {
        const ptrdiff_t row = ptrdiff_t(channels) * width_ * ptrdiff_t(sizeof(float));
        ss_image image = {};
        image.data = const_cast<float*>(values) + ptrdiff_t(channels) * width_ * (height_ - 1);
        image.row_stride = -row;
        return image;
    }

    int width_, height_;
    View view_;
    vtkCamera* camera_;
    std::vector<float> color_, depth_, motion_, image_;
    std::vector<unsigned char> shown_;
    float linear_[256];
    ss_model* model_ = nullptr;
    ss_upscaler* upscaler_ = nullptr;
    vtkNew<vtkMatrix4x4> previous_;
    bool has_previous_ = false;
};

// Mean squared difference of bytes from an image of SUPERSAMPLES times the size, averaged as light.
static double squared_error(const unsigned char* shown, const unsigned char* large, int width, int height) {
    double sum = 0.0;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            for (int c = 0; c < 3; c++) {
                double light = 0.0;
                for (int j = 0; j < SUPERSAMPLES; j++)
                    for (int i = 0; i < SUPERSAMPLES; i++) {
                        const double value =
                            large[(size_t(y * SUPERSAMPLES + j) * width * SUPERSAMPLES + x * SUPERSAMPLES + i) * 3 + c];
                        light += value * value;
                    }
                const double apart =
                    shown[(size_t(y) * width + x) * 3 + c] - std::sqrt(light / (SUPERSAMPLES * SUPERSAMPLES));
                sum += apart * apart;
            }
    return sum / (3.0 * width * height);
}

static void write_pair(const std::string& path, const unsigned char* left, const unsigned char* right, int width,
                       int height) {
    vtkNew<vtkImageData> image;
    image->SetDimensions(2 * width, height, 1);
    image->AllocateScalars(VTK_UNSIGNED_CHAR, 3);
    auto* to = static_cast<unsigned char*>(image->GetScalarPointer());
    for (int y = 0; y < height; y++) {
        std::memcpy(to + size_t(6) * width * y, left + size_t(3) * width * y, size_t(3) * width);
        std::memcpy(to + size_t(6) * width * y + size_t(3) * width, right + size_t(3) * width * y, size_t(3) * width);
    }
    vtkNew<vtkPNGWriter> writer;
    writer->SetFileName(path.c_str());
    writer->SetInputData(image);
    writer->Write();
}

static double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

static double decibels(double squares) { return 10.0 * std::log10(255.0 * 255.0 / squares); }

static void run(const Options& o) {
    vtkNew<vtkCamera> camera;
    View msaa(o.width, o.height, MSAA, camera), plain(o.width, o.height, 0, camera);
    View large(SUPERSAMPLES * o.width, SUPERSAMPLES * o.height, 0, camera);
    Upscaled upscaled(o, camera);
    camera->SetPosition(0.0, -7.5, 2.2), camera->SetFocalPoint(0.0, 0.0, -0.6), camera->SetViewUp(0.0, 0.0, 1.0);
    camera->SetViewAngle(35.0), camera->SetClippingRange(1.0, 20.0);
    std::array<std::vector<double>, 6> times;  // render, inputs, step, their sum, without anti-aliasing, with MSAA
    double errors[2] = {}, scored = 0.0;
    for (int index = 0; index < o.frames; index++) {
        camera->Azimuth(o.turn);
        double seconds[3];
        const unsigned char* ours = upscaled.render(index, seconds);
        const double began = now();
        plain.render();
        const double middle = now();
        const unsigned char* theirs = msaa.render();
        const double ended = now();
        if (!o.folder.empty()) {
            char name[32];
            std::snprintf(name, sizeof name, "/%04d.png", index);
            write_pair(o.folder + name, theirs, ours, o.width, o.height);
        }
        if (index < WARM_UP) continue;
        for (int k = 0; k < 3; k++) times[k].push_back(seconds[k]);
        times[3].push_back(seconds[0] + seconds[1] + seconds[2]);
        times[4].push_back(middle - began), times[5].push_back(ended - middle);
        if (index % 16 != 0) continue;
        const unsigned char* truth = large.render();
        errors[0] += squared_error(ours, truth, o.width, o.height),
            errors[1] += squared_error(theirs, truth, o.width, o.height);
        scored += 1.0;
    }
    if (scored == 0.0) {
        std::fprintf(stderr, "viewer: no times and errors of %d frames: the first is scored after 16\n", o.frames);
        return;
    }
    const char* names[] = {"render small",   "inputs", "upscale", "all three", "full size, no anti-aliasing",
                           "full size, MSAA"};
    for (int k = 0; k < 6; k++) std::printf("%s: %.1f ms\n", names[k], 1e3 * median(times[k]));
    std::printf("PSNR upscaled: %.2f dB\nPSNR MSAA: %.2f dB\n", decibels(errors[0] / scored),
                decibels(errors[1] / scored));
}

int main(int count, char** arguments) {
    Options o;
    for (int k = 1; k < count; k += 2) {
        const std::string name = arguments[k], value = k + 1 < count ? arguments[k + 1] : "";
        if (name == "-o" && !value.empty()) o.folder = value;
        else if (name == "-m" && !value.empty()) o.model = value;
        else if (name == "-n" && std::sscanf(value.c_str(), "%d", &o.frames) == 1) continue;
        else if (name == "-t" && std::sscanf(value.c_str(), "%lf", &o.turn) == 1) continue;
        else if (name == "-s" && std::sscanf(value.c_str(), "%dx%d", &o.width, &o.height) == 2) continue;
        else return std::fprintf(stderr, "viewer: %s %s: see the top of viewer.cpp\n", name.c_str(), value.c_str()), 1;
    }
    try {
        run(o);
    } catch (const std::string& message) { return std::fprintf(stderr, "%s\n", message.c_str()), 1; }
    return 0;
}
