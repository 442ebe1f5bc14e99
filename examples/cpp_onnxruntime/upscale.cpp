// Upscales raw frames, as raw_planes.py writes them, with step.onnx:
//
//     upscale STEP.ONNX FRAMES_FOLDER OUT_FOLDER [--fixed] [--provider NAME] [--threads N]
//
// FRAMES_FOLDER/frames.txt has a line for each frame: NAME w h W H jitter_x jitter_y exposure pre_exposure reset
// has_reactive. Images are FRAMES_FOLDER/NAME.CHANNELS, planes of float32: color, depth, motion and, if has_reactive is
// 1, reactive. Writes OUT_FOLDER/NAME.image, (3, H, W) float32.
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <memory>
#include <sstream>

#include "upscaler.hpp"

namespace fs = std::filesystem;

static std::string content_of(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::runtime_error(path.string() + ": cannot be read");
    return {std::istreambuf_iterator<char>(file), {}};
}

struct Arguments {
    std::vector<std::string> paths;
    std::string provider = "cpu";
    int threads = 0;
    bool fixed = false;  // a session for one size, as CUDA graphs need
};

static Arguments parsed(int count, char** values) {
    Arguments arguments;
    for (int i = 1; i < count; ++i) {
        const std::string value = values[i];
        if (value == "--fixed") arguments.fixed = true;
        else if (value == "--provider" && i + 1 < count) arguments.provider = values[++i];
        else if (value == "--threads" && i + 1 < count) arguments.threads = std::stoi(values[++i]);
        else if (value.rfind("--", 0) == 0)
            throw std::invalid_argument(value + " is not an option, or lacks its value");
        else arguments.paths.push_back(value);
    }
    if (arguments.paths.size() != 3)
        throw std::invalid_argument(
            "upscale STEP.ONNX FRAMES_FOLDER OUT_FOLDER [--fixed] [--provider NAME] [--threads N]");
    return arguments;
}

constexpr int64_t LARGEST_SIDE = 16384;

static bool is_size(const Size& size) {
    return size.width >= 1 && size.width <= LARGEST_SIDE && size.height >= 1 && size.height <= LARGEST_SIDE;
}

// A name out of a file must not lead out of the folder.
static bool is_plain(const std::string& name) {
    return name[0] != '.' && name.find_first_of("/\\:") == std::string::npos;
}

static void run(const Arguments& arguments) {
    const fs::path folder = arguments.paths[1], out = arguments.paths[2];
    fs::create_directories(out);
    const std::string graph = content_of(arguments.paths[0]);
    disable_telemetry();
    Ort::Env env(ORT_LOGGING_LEVEL_ERROR, "upscale");
    std::unique_ptr<Upscaler> upscaler;
    Size display;

    std::istringstream list(content_of(folder / "frames.txt"));
    for (std::string line; std::getline(list, line);) {
        std::istringstream fields(line);
        std::string name;
        Frame frame;
        Size wanted;
        bool has_reactive = false;
        if (!(fields >> name >> frame.size.width >> frame.size.height >> wanted.width >> wanted.height >>
              frame.jitter[0] >> frame.jitter[1] >> frame.exposure >> frame.pre_exposure >> frame.reset >>
              has_reactive) ||
            !is_plain(name) || !is_size(frame.size) || !is_size(wanted))
            throw std::runtime_error("frames.txt: cannot be read: " + line);

        std::map<std::string, std::string> files;  // must outlive the step, which reads this memory
        for (const std::string channels : {"color", "depth", "motion", "reactive"}) {
            if (channels == "reactive" && !has_reactive) continue;
            const std::string& file = files[channels] = content_of(folder / (name + "." + channels));
            const size_t planes = channels == "color" ? 3 : channels == "motion" ? 2 : 1;
            if (file.size() != sizeof(float) * planes * frame.size.width * frame.size.height)
                throw std::runtime_error(name + "." + channels + ": has another size than frames.txt says");
            frame.images[channels] = reinterpret_cast<const float*>(file.data());
        }

        if (!upscaler) {
            Ort::SessionOptions options = session_options(arguments.threads, arguments.provider);
            if (arguments.fixed) fix_sizes(options, frame.size, wanted);
            const std::string& taken = arguments.fixed ? with_display_size(graph, wanted) : graph;
            upscaler =
                std::make_unique<Upscaler>(env, taken, options, wanted, arguments.provider == "cuda" ? "Cuda" : "Cpu");
        } else if (wanted.width != display.width || wanted.height != display.height) {
            upscaler->resize(wanted);
        }
        display = wanted;
        const float* image = upscaler->step(frame);
        std::ofstream file(out / (name + ".image"), std::ios::binary);
        file.write(reinterpret_cast<const char*>(image), sizeof(float) * 3 * display.width * display.height);
        if (!file.flush()) throw std::runtime_error(out.string() + ": cannot be written");
    }
}

int main(int count, char** values) {
    try {
        run(parsed(count, values));
    } catch (const std::exception& error) {  // Ort::Exception is one
        std::cerr << error.what() << "\n";
        return 1;
    }
}
