// The kernels of one instruction set.
#include "../work.h"

#define SS_NAME_OF(isa) SS_TEXT_OF(isa)
#define SS_TEXT_OF(isa) #isa

namespace ss {
namespace SS_ISA {
void read_frame(const FrameImages&, const Samples&, int y0, int y1, int thread);
void fill_windows(const Samples&, int y0, int y1);
void prepare(const Samples&, int y0, int y1);
void dilate(const Samples&, int y0, int y1);
void make_tables(const Tables&, float jitter_x, float jitter_y);
void spatial_read(const SpatialWork&, int y0, int y1);
void spatial_rows(const SpatialWork&, Rect, int thread);
void taa_read(const TaaWork&, int y0, int y1);
void taa_boxes(const TaaWork&, int y0, int y1);
void taa_rows(const TaaWork&, Rect, int thread);
void taau_shade(const TaauWork&, int y0, int y1, int thread);
void taau_compare(const TaauWork&, int y0, int y1);
void taau_rows(const TaauWork&, Rect, int thread);
void sign_blocks(const RestWork&, int y0, int y1);
void sum_blocks(const RestWork&, int y0, int y1);
void add_samples(const RestWork&, Rect);
void show_mean(const RestWork&, Rect);
void freeze_mean(const RestWork&, Rect);
void downsample_rows(const DownsampleWork&, int y0, int y1, int thread);
void copy_image(const View& from, const View& to, int width, int y0, int y1, float factor);
void pick_pixels(const float* from, Size from_size, const View& to, Size size, int y0, int y1);
void write_converged(const RestWork&, const View& image, int y0, int y1);
void warp_read_shaded(const WarpWork&, int y0, int y1, int thread);
void warp_read_motion(const WarpWork&, int y0, int y1, int thread);
void warp_rows(const WarpWork&, int y0, int y1, int thread);
void camera_motion_rows(const CameraMotion&, int y0, int y1);
void rgba_rows(const View& image, uint8_t* pixels, ptrdiff_t row, int width, int y0, int y1, float* scratch);
void merge_row(float* image, const float* other, const float* weight, const float* other_weight, int width,
               float exposure);
void temporal_rows(const TemporalFilter&, int y0, int y1);
void nearest_motion_rows(const float* depth, const float* motion, float* to, Size size, int y0, int y1);
void keep_depth(const ClassifierWork&, int y0, int y1);
void prepare_surfaces(const ClassifierWork&, int y0, int y1, int thread);
void prepare_depth(const ClassifierWork&, int y0, int y1, int thread);
void confirm_none(const ClassifierWork&, Rect);
void encode_first(const ClassifierWork&, int depth, Rect, int thread);
void encode_others(const ClassifierWork&, int depth, Rect, int thread);
void infer_rows(const ClassifierWork&, int parameters, float* out, int y0, int y1);
extern void (*const GATHER[])(const ClassifierWork&, Rect, int thread);
extern void (*const FINISH[])(const ClassifierWork&, Rect, int thread);

extern const Kernels KERNELS = {
    SS_NAME_OF(SS_ISA),
    read_frame,
    fill_windows,
    prepare,
    dilate,
    make_tables,
    spatial_read,
    spatial_rows,
    taa_read,
    taa_boxes,
    taa_rows,
    taau_shade,
    taau_compare,
    taau_rows,
    sign_blocks,
    sum_blocks,
    add_samples,
    show_mean,
    freeze_mean,
    downsample_rows,
    copy_image,
    pick_pixels,
    write_converged,
    warp_read_shaded,
    warp_read_motion,
    warp_rows,
    camera_motion_rows,
    rgba_rows,
    merge_row,
    temporal_rows,
    nearest_motion_rows,
    keep_depth,
    prepare_surfaces,
    prepare_depth,
    confirm_none,
    encode_first,
    encode_others,
    infer_rows,
    GATHER,
    FINISH,
};
}  // namespace SS_ISA
}  // namespace ss
