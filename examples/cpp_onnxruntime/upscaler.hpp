// The upscaler of one view on ONNX Runtime's C++ API: what an engine does with step.onnx. The contract of the
// graph is docs/contract.md; docs/how-to/onnx-in-cpp.md explains this file.
#pragma once

#include <onnxruntime_cxx_api.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

struct Size {
  int64_t width = 0;
  int64_t height = 0;
};

// One rendered frame. Images are planes of float32, channel by channel, the top row first: "color" is
// (3, h, w), "depth" (1, h, w), "motion" (2, h, w), and so on by the names of the contract. "reactive" (1, h, w) may
// be missing.
struct Frame {
  Size size;                                  // (w, h), the render size
  std::map<std::string, const float*> images; // those that the graph does not take are not read
  std::array<float, 2> jitter{};              // render pixels
  float exposure = 0.0f;                      // 0: the graph measures it
  float pre_exposure = 1.0f;                  // what the renderer has multiplied the colour by
  float adds_samples = 1.0f;                  // 0: the colour was extrapolated; 2: of a path tracer
  bool reset = false;                         // the first frame after a cut
};

// Dimensions of the graph by their names, for a frame, an image, and the frame before.
inline std::map<std::string, int64_t> extents(Size render, Size display, Size previous) {
  const auto blocks = [](int64_t samples) { return (samples + 3) / 4; };
  const auto large = [](int64_t side) { return (7 * side + 4) / 5; };  // of the history of classifier-large
  const auto phases = [&](Size size) { return 9 * display.width * display.height / (size.width * size.height) + 2; };
  return {{"render_width", render.width},       {"render_height", render.height},
          {"display_width", display.width},     {"display_height", display.height},
          {"half_width", (display.width + 1) / 2}, {"half_height", (display.height + 1) / 2},
          {"large_width", large(display.width)}, {"large_height", large(display.height)},
          {"large_half_width", (large(display.width) + 1) / 2}, {"large_half_height", (large(display.height) + 1) / 2},
          {"previous_width", previous.width},   {"previous_height", previous.height},
          {"blocks_across", blocks(render.width)}, {"blocks_down", blocks(render.height)}, {"phases", phases(render)},
          {"previous_blocks_across", blocks(previous.width)}, {"previous_blocks_down", blocks(previous.height)},
          {"previous_phases", phases(previous)}};
}

// Official builds since 1.29 write a device id to the user's cache and send names of models to Microsoft, unless this
// variable is set before the environment is made. A user's own setting stays. Call it before threads are started.
inline void disable_telemetry() {
  if (std::getenv("ORT_DISABLE_TELEMETRY")) return;
#ifdef _WIN32
  _putenv_s("ORT_DISABLE_TELEMETRY", "1");
#else
  setenv("ORT_DISABLE_TELEMETRY", "1", 0);
#endif
}

// Options of a session: `threads` is 0 for every core; `provider` is "cpu", "cuda", or another provider's name
// in ONNX Runtime, such as "DML" or "WebGPU".
inline Ort::SessionOptions session_options(int threads, const std::string& provider) {
  Ort::SessionOptions options;
  options.SetIntraOpNumThreads(threads);
  options.AddConfigEntry("session.intra_op.allow_spinning", "0");  // spinning starves the engine's own threads
  if (provider == "cuda") {
    OrtCUDAProviderOptionsV2* cuda = nullptr;
    Ort::ThrowOnError(Ort::GetApi().CreateCUDAProviderOptions(&cuda));
    OrtStatus* status = Ort::GetApi().SessionOptionsAppendExecutionProvider_CUDA_V2(options, cuda);
    Ort::GetApi().ReleaseCUDAProviderOptions(cuda);
    Ort::ThrowOnError(status);
  } else if (provider != "cpu") {
    options.AppendExecutionProvider(provider);
  }
  return options;
}

// Fixes the dimensions of a graph by name; the session then takes frames of this size only.
inline void fix_sizes(Ort::SessionOptions& options, Size render, Size display) {
  for (const auto& [name, extent] : extents(render, display, render))
    Ort::ThrowOnError(Ort::GetApi().AddFreeDimensionOverrideByName(options, name.c_str(), extent));
}

// Returns a graph with a constant in place of its input `display_size`, so that ONNX Runtime computes all shapes
// while it loads. Protobuf merges concatenated messages: this appends an initializer of that name, and IR version
// 3, the last one in which an initializer replaces the input instead of being its default.
inline std::string with_display_size(std::string graph, Size display) {
  const auto delimited = [](int field, const std::string& content) {  // below 128 bytes
    return std::string{static_cast<char>(field << 3 | 2), static_cast<char>(content.size())} + content;
  };
  std::string values;
  for (const int64_t extent : {display.width, display.height})
    for (int byte = 0; byte < 8; ++byte) values += static_cast<char>(extent >> 8 * byte & 0xff);
  const std::string tensor = "\x08\x02\x10\x07" + delimited(8, "display_size") + delimited(9, values);  // int64[2]
  return graph + "\x08\x03" + delimited(7, delimited(5, tensor));  // ModelProto.graph.initializer
}

// A history and the session that steps on it. Use one per view, and not from two threads at once.
class Upscaler {
 public:
  // `graph` is the content of step.onnx; `device` names the memory in which the history stays: "Cpu", "Cuda".
  Upscaler(const Ort::Env& env, const std::string& graph, const Ort::SessionOptions& options, Size display,
           const std::string& device = "Cpu")
      : session_(env, graph.data(), graph.size(), options),
        binding_(session_),
        device_memory_(device.c_str(), OrtDeviceAllocator, 0, OrtMemTypeDefault),
        device_(session_, device_memory_) {
    for (size_t i = 0; i < session_.GetInputCount(); ++i) {
      Tensor tensor(session_.GetInputNameAllocated(i, cpu_).get(), session_.GetInputTypeInfo(i));
      (tensor.name.rfind("history.", 0) == 0 ? history_ : inputs_).push_back(std::move(tensor));
    }
    for (size_t i = 0; i < session_.GetOutputCount(); ++i) {
      Tensor tensor(session_.GetOutputNameAllocated(i, cpu_).get(), session_.GetOutputTypeInfo(i));
      if (tensor.name == "image") image_ = std::move(tensor);
      else if (tensor.name.rfind("next.", 0) == 0) next_.push_back(std::move(tensor));
    }  // the others are aux outputs: what is not bound is not computed
    const auto by_name = [](const Tensor& a, const Tensor& b) { return a.name < b.name; };
    std::sort(history_.begin(), history_.end(), by_name);  // history.NAME beside its next.NAME
    std::sort(next_.begin(), next_.end(), by_name);
    check_contract();
    resize(display);
  }

  // Sets the display size and drops the history. The render size may change with every frame, and keeps it.
  void resize(Size display) {
    display_ = display;
    has_history_ = false;
  }

  // Upscales a frame. Returns the image, (3, H, W), linear RGB, which stays until the next step. After an
  // exception the history is that before the call, or none if the frame was a reset.
  const float* step(const Frame& frame) {
    if (frame.reset) has_history_ = false;
    const Size previous = has_history_ ? previous_ : frame.size;
    const auto sizes = extents(frame.size, display_, previous);

    std::vector<Ort::Value> zeros;  // no history is a history of zeros, in CPU memory: it is copied when bound
    if (!has_history_) {
      fit(zeros, history_, sizes, cpu_);
      for (Ort::Value& value : zeros) clear(value);
    }
    std::vector<Ort::Value>& history = has_history_ ? sets_[current_] : zeros;
    std::vector<Ort::Value>& next = sets_[1 - current_];
    fit(next, next_, sizes, device_);
    fit(images_, {image_}, sizes, cpu_);

    no_mask_.resize(static_cast<size_t>(frame.size.width * frame.size.height));  // zeros
    binding_.ClearBoundInputs();
    binding_.ClearBoundOutputs();
    const std::array<int64_t, 2> display{display_.width, display_.height};
    for (const Tensor& tensor : inputs_)
      binding_.BindInput(tensor.name.c_str(), input(tensor, frame, sizes, display));
    for (size_t i = 0; i < history_.size(); ++i) binding_.BindInput(history_[i].name.c_str(), history[i]);
    for (size_t i = 0; i < next_.size(); ++i) binding_.BindOutput(next_[i].name.c_str(), next[i]);
    binding_.BindOutput(image_.name.c_str(), images_[0]);

    session_.Run(Ort::RunOptions{nullptr}, binding_);
    binding_.SynchronizeOutputs();

    current_ = 1 - current_;  // what was written is read by the next step
    previous_ = frame.size;
    has_history_ = true;
    return images_[0].GetTensorData<float>();
  }

 private:
  struct Tensor {
    std::string name;
    std::vector<int64_t> shape;      // -1 where the size is free
    std::vector<std::string> names;  // of free dimensions: keys of `extents`

    Tensor() = default;
    Tensor(std::string name, const Ort::TypeInfo& type) : name(std::move(name)) {
      const auto info = type.GetTensorTypeAndShapeInfo();
      shape = info.GetShape();
      std::vector<const char*> symbols(shape.size());
      info.GetSymbolicDimensions(symbols.data(), symbols.size());
      names.assign(symbols.begin(), symbols.end());
    }

    std::vector<int64_t> shape_for(const std::map<std::string, int64_t>& sizes) const {
      std::vector<int64_t> found = shape;
      for (size_t i = 0; i < found.size(); ++i)
        if (found[i] < 0) {
          const auto size = sizes.find(names[i]);
          if (size == sizes.end())
            throw std::invalid_argument(name + " has the size '" + names[i] + "', which this code does not know");
          found[i] = size->second;
        }
      return found;
    }
  };

  // Makes `values` have the shapes of `tensors` at these sizes; values that have them already are kept.
  static void fit(std::vector<Ort::Value>& values, const std::vector<Tensor>& tensors,
                  const std::map<std::string, int64_t>& sizes, OrtAllocator* allocator) {
    values.reserve(tensors.size());
    for (size_t i = 0; i < tensors.size(); ++i) {
      const std::vector<int64_t> shape = tensors[i].shape_for(sizes);
      if (i < values.size() && values[i].GetTensorTypeAndShapeInfo().GetShape() == shape) continue;
      Ort::Value made = Ort::Value::CreateTensor<float>(allocator, shape.data(), shape.size());
      if (i < values.size()) values[i] = std::move(made);
      else values.push_back(std::move(made));
    }
  }

  // The graph says which version of docs/contract.md it follows.
  void check_contract() {
    const auto found = session_.GetModelMetadata().LookupCustomMetadataMapAllocated("supersampler.contract", cpu_);
    const std::string version = found ? found.get() : "none";
    if (version != "4")
      throw std::invalid_argument("the graph is of contract " + version + "; this code drives 4: export it again");
  }

  static void clear(Ort::Value& value) {
    std::fill_n(value.GetTensorMutableData<float>(), value.GetTensorTypeAndShapeInfo().GetElementCount(), 0.0f);
  }

  // Returns a value that shares the frame's memory, as an engine's buffers do.
  Ort::Value input(const Tensor& tensor, const Frame& frame, const std::map<std::string, int64_t>& sizes,
                   const std::array<int64_t, 2>& display) const {
    const std::vector<int64_t> shape = tensor.shape_for(sizes);
    if (tensor.name == "display_size")
      return Ort::Value::CreateTensor<int64_t>(cpu_memory_, const_cast<int64_t*>(display.data()), 2, shape.data(),
                                               shape.size());
    const float* data = nullptr;
    if (tensor.name == "jitter") data = frame.jitter.data();
    else if (tensor.name == "exposure") data = &frame.exposure;
    else if (tensor.name == "pre_exposure") data = &frame.pre_exposure;
    else if (tensor.name == "adds_samples") data = &frame.adds_samples;
    else if (const auto found = frame.images.find(tensor.name); found != frame.images.end()) data = found->second;
    else if (tensor.name == "reactive") data = no_mask_.data();
    if (!data) throw std::invalid_argument("the frame has no " + tensor.name + ", which the graph takes");
    size_t count = 1;
    for (const int64_t extent : shape) count *= static_cast<size_t>(extent);
    return Ort::Value::CreateTensor<float>(cpu_memory_, const_cast<float*>(data), count, shape.data(), shape.size());
  }

  Ort::Session session_;
  Ort::IoBinding binding_;
  Ort::AllocatorWithDefaultOptions cpu_;
  Ort::MemoryInfo cpu_memory_ = Ort::MemoryInfo::CreateCpu(OrtDeviceAllocator, OrtMemTypeDefault);
  Ort::MemoryInfo device_memory_;
  Ort::Allocator device_;
  std::vector<Tensor> inputs_, history_, next_;  // next_[i] of a step is history_[i] of the following one
  Tensor image_;
  std::vector<Ort::Value> sets_[2], images_;  // two sets of history buffers, swapped; the image
  int current_ = 0;                           // the set that the next step reads
  std::vector<float> no_mask_;                // zeros in place of a missing reactive mask
  Size display_, previous_;
  bool has_history_ = false;
};
