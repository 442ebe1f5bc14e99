"""Arguments and variants of the kernels of `classifier`. A packed pixel is 2x2 display pixels."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Self

from supersampler.backends.cpu.structs import Bytes, Floats, Halves, Words


class Variant(NamedTuple):
    """Compile-time variant of the kernels: they leave out the planes and arithmetic of what is not set.

    The first two are of ClassifierConfig; `guided` is that the frame has G-buffers of display size, as
    `gbuffer-fast` reads them. Properties are indices of planes of `Gathered.rest` and of blend parameters.
    """

    rectified: bool
    own_motion: bool
    guided: bool = False

    @classmethod
    def of(cls, config: Mapping[str, Any], *, guided: bool = False) -> Self:
        """Return that of a model."""
        return cls(**{name: config[name] for name in cls._fields[:2]}, guided=guided)

    @classmethod
    def with_parts(cls, *parts: str) -> Self:
        """Return that in which these are set."""
        return cls(*(name in parts for name in cls._fields))

    def kernel(self, name: str) -> str:
        """Return the name of its kernel, as the compiler takes it."""
        return f"{name}+" + "+".join(field for field, there in self._asdict().items() if there)

    @property
    def mean(self) -> int:
        """First plane of `rest` with mean and half extent of the box, YCoCg."""
        return 14

    @property
    def own(self) -> int:
        """First plane of `rest` with the history warped by the pixel's own motion."""
        return self.mean + 6 * self.rectified

    @property
    def sampled(self) -> int:
        """Plane of `rest` that is 1 where one of the samples around is usable, else 0."""
        return self.own + 3 * self.own_motion

    @property
    def rest(self) -> int:
        """Planes of `rest`."""
        return self.sampled + self.guided

    @property
    def history_colors(self) -> int:
        """History colours; of `blend_parameters`, the weights of those of this frame follow theirs."""
        return 1 + self.rectified + self.own_motion

    @property
    def sharpness(self) -> int:
        """Index of the sharpness in `blend_parameters`, after the weights."""
        return self.history_colors + 3

    @property
    def kernel_weights(self) -> int:
        """First of the nine weights of the kernel in `blend_parameters`."""
        return self.sharpness + 1

    @property
    def blend_parameters(self) -> int:
        """Number of blend parameters of a pixel."""
        return self.kernel_weights + 9

    @property
    def outputs(self) -> int:
        """Outputs of the last layer: `blend_parameters` of four pixels, up to a multiple of eight."""
        return -(-4 * self.blend_parameters // 8) * 8


class ClassifierHistoryInput(NamedTuple):
    """History as the kernels read it.

    Attributes:
        pixels: (display height, display width, CLASSIFIER_PIXEL).
        classes: (half height, half width, 8) class probabilities, 255 is one.
        depth: (height, pitch, 2) as the kernel `keep_depth` writes it.
        pitch: PAD + stride + PAD of the previous frame.
    """

    pixels: Floats
    classes: Bytes
    depth: Floats
    pitch: int


class Gathered(NamedTuple):
    """Results of gather for finish, in vectors of sixteen pixels.

    Attributes:
        history: (height, pitch / 16, HISTORY_PLANES, 16) toned RGB of the reprojected history.
        rest: (height, pitch / 16, Variant.rest, 16) the other planes, see `Variant`.
        rising: (height, pitch / 16) number of pixels that count towards FLASH_FRACTION.
        image: (height, 3, PAD + pitch + PAD) toned guided colour, and one pixel beyond either border; only
            of the variant `guided`.
        width, height: of the display.
        pitch: width up to whole vectors.
    """

    history: Floats
    rest: Halves
    rising: Floats
    image: Halves
    width: int
    height: int
    pitch: int


class Guide(NamedTuple):
    """Additional inputs and outputs of the variant `guided`; rows are padded as those of samples.

    Attributes:
        samples: (render height, SURFACE_PLANES, padded width) light, toned, and features of surfaces.
        base_color, normal: (height, width, 3) of the display.
        depth: (height, PAD + pitch + PAD) of the display, -1 where it is unusable.
        before: (height, width, 4) reflectance of the history; 255 is one.
        next: (height, width) reflectance of the next history, four bytes a word; written to.
        normal_scale, color_scale: of features; their squared distance is an exponent.
        depth_scale: of the squared relative difference of depth.
        min_reflectance: see GuidedConfig.
    """

    samples: Floats
    base_color: Floats
    normal: Floats
    depth: Floats
    before: Bytes
    next: Words
    normal_scale: float
    color_scale: float
    depth_scale: float
    min_reflectance: float


class NetworkInputs(NamedTuple):
    """Network inputs of packed pixels.

    Attributes:
        records: (half height, row, RECORD_WORDS) words.
        means: (half height, 2, means_stride) mean differences between history and frame, signed and
            absolute; PAD columns on either side.
        half_width, half_height: packed pixels.
        row: records from row to row.
        means_stride: means from plane to plane.
    """

    records: Words
    means: Floats
    half_width: int
    half_height: int
    row: int
    means_stride: int


class GatherScratch(NamedTuple):
    """Scratch of one thread of gather.

    Attributes:
        ring: luma of the reprojected history, three rows.
        slots, weights, warped: of `warp.prepare_warp` and `warp.warp`.
        places: positions of a row's pixels in the previous frame.
        inputs: four rows of network inputs, INPUT_PLANES planes each.
        differences: luma of the history minus that of the frame, four rows.
        reflectance: of the history at sixteen pixels, four values each.
    """

    ring: Floats
    slots: Words
    weights: Floats
    warped: Floats
    places: Floats
    inputs: Bytes
    differences: Floats
    reflectance: Floats


class LayerWeights(NamedTuple):
    """A layer of the int8 network.

    Attributes:
        weights: words of four bytes; see `network`.
        scale, bias: (outputs,) of its sums.
        blocks: of 32 outputs; of the last layer, outputs.
        words: inputs, four bytes each.
    """

    weights: Words
    scale: Floats
    bias: Floats
    blocks: int
    words: int

    @property
    def outputs(self) -> int:
        """Channels."""
        return len(self.scale)


class LevelAbove(NamedTuple):
    """Input that a level of the encoder pools; ignored at the first level, where `channels` is 0.

    Attributes:
        pixels: bytes, from the first channel that is read on.
        pitch, row: bytes from pixel to pixel and from row to row.
        channels: number of channels that are read.
    """

    pixels: Bytes
    pitch: int
    row: int
    channels: int


class LevelBuffers(NamedTuple):
    """The images of a level of the encoder.

    Attributes:
        x: (height + 2, row, pitch) output of the first layer, within a border of one pixel.
        pitch, row: bytes of `x` from pixel to pixel and from row to row.
        channels: of `x` that the other layers read.
        out: (height, row, out_pitch) output of the level.
        out_pitch, out_row: bytes of `out`.
        width: of the level.
    """

    x: Bytes
    pitch: int
    row: int
    channels: int
    out: Bytes
    out_pitch: int
    out_row: int
    width: int


class LevelScratch(NamedTuple):
    """Scratch of one thread: rows of means and their codes, a row of bytes, the same bytes as words."""

    signed: Floats
    absolute: Floats
    tent: Floats
    codes: Words
    line: Bytes
    line_words: Words


class EncodedLevels(NamedTuple):
    """Outputs of the encoder's levels; pitches: bytes per pixel of each, then bytes per row."""

    level0: Bytes
    level1: Bytes
    level2: Bytes
    level3: Bytes
    pitches: Words


class FinishLayers(NamedTuple):
    """The layers after the encoder.

    Attributes:
        decoder, hidden, blend: the layers; the last gives blend parameters.
        logits: first byte of the hidden layer that is a class logit.
        logits_scale: of these bytes.
    """

    decoder: LayerWeights
    hidden: LayerWeights
    blend: LayerWeights
    logits: int
    logits_scale: float


class FinishConstants(NamedTuple):
    """Constants of finish.

    Attributes:
        exposure: of the frame.
        most_samples, contraction: see ClassifierConfig.
        glares: 1 where the frame or the history may have light over GLARE_EXPOSED, else 0.
        rises: 1 where light that rises over the history is unconfirmed, see FLASH_FRACTION, else 0.
        flash: 1 where all light of the frame is unconfirmed, see `is_flash`, else 0.
        streams: which outputs are written past the caches; see `compose`.
    """

    exposure: float
    most_samples: float
    contraction: float
    glares: int
    rises: int
    flash: int
    streams: int


class FinishScratch(NamedTuple):
    """Scratch of one thread of finish: rows; `_words` are the same bytes as words.

    Rows of `blend` are blend parameters, then CLASSES logits.
    """

    read: Bytes
    read_words: Words
    decoded: Bytes
    decoded_words: Words
    hidden: Bytes
    hidden_words: Words
    blend: Floats
    columns: Words
    out: Floats
