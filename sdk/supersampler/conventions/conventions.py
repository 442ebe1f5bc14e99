"""Units, signs and spaces of an engine (`Conventions`), and conversion of its frames to ours and back."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, Self, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import as_number, checked_choice, checked_size, ieee_arithmetic
from supersampler.conventions import encodings
from supersampler.conventions.encodings import DepthKind
from supersampler.errors import ArgumentError, FrameError, did_you_mean, shown
from supersampler.frame import (
    Array,
    Frame,
    Size,
    as_array,
    checked_buffers,
    checked_frame,
    checked_jitter,
    checked_reset,
    pair_of,
)

Unit = Literal["pixels", "uv", "ndc"]
Direction = Literal["previous_minus_current", "current_minus_previous"]
NextDirection = Literal["next_minus_current", "current_minus_next"]
Resolution = Literal["render", "display"]
_Motion = Literal["motion", "motion_next"]
_Pair = tuple[float, float]

_MIN_FACTOR, MAX_FACTOR = 1e-30, 1e30  # range of factors in single precision
_RANGE = f"{_MIN_FACTOR:g} to {MAX_FACTOR:g}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawFrame:
    """One frame in an engine's conventions, unchecked; `Converter.to_frame` checks and converts it.

    Attributes:
        depth: (h, w) at render size, of the kind `Conventions.depth`.
        motion: (h, w, 2), x then y; (H, W, 2) if `Conventions.motion_resolution` is "display".
        color: (h, w, 3) at render size, linear or sRGB; None on an unshaded frame.
        jitter: (x, y) in the unit `Conventions.jitter_unit`; None means no jitter.
        reset: True on the first frame after a cut.
        exposure: > 0, multiplies the colour before the tone curve, or None.
        pre_exposure: factor that the renderer has already multiplied the colour by.
        reactive: (h, w) at render size, in [0, 1], or None.
        gbuffer: G-buffers at render size, with the names of `Frame`.
        gbuffer_display: G-buffers at display size, with the names of `Frame`; its depth is of `depth`'s kind.
        aovs: (h, w, k) at render size.
        motion_next: (h, w, 2) or (H, W, 2), as `motion`: to the next frame, in the unit and signs of `motion`
            and the direction `Conventions.motion_next_direction`.
        ids: (h, w, k) at render size.
        aov_names: names of the k AOVs' channels in output files; None numbers them.
    """

    depth: Array
    motion: Array
    color: Array | None = None
    jitter: tuple[float, float] | None = None
    reset: bool = False
    exposure: float | None = None
    pre_exposure: float = 1.0
    reactive: Array | None = None
    gbuffer: Mapping[str, Array] | None = None
    gbuffer_display: Mapping[str, Array] | None = None
    aovs: Array | None = None
    aov_names: Sequence[str] | None = None
    motion_next: Array | None = None
    ids: NDArray[np.integer[Any]] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Conventions:
    """Units, signs and spaces of an engine's frames. The defaults are the conventions of `Frame`.

    Units: "pixels" are pixels of the buffer; "uv" spans the image from 0 to 1, "ndc" from -1 to 1. x points
    right; y points down, but up in "ndc". A `flip_y` reverses y.

    Attributes:
        motion_unit: unit of the vectors after `motion_scale`.
        motion_scale: (x, y), not 0, factor that multiplies the stored vectors: FSR's motionVectorScale,
            Streamline's mvecScale, XeSS's velocity scale.
        motion_direction: "previous_minus_current" vectors are added to a pixel to find it in the previous
            frame, "current_minus_previous" ones are subtracted.
        motion_next_direction: direction of `motion_next`: "next_minus_current" vectors are added to a pixel
            to find it in the next frame, "current_minus_next" ones are subtracted.
        motion_flip_y: True if y of the vectors is opposite to y of the unit.
        motion_resolution: "render"; or "display": vectors at display size, already dilated. Each render pixel
            takes the vector at its centre + jitter.
        motion_jittered: True if the vectors contain the change of the jitter between the two frames.
        depth: "reversed_infinite" near / distance; "reversed" 1 at the near plane, 0 at the far plane;
            "forward" 0 at the near plane, 1 at the far plane; "forward_infinite" 1 - near / distance;
            "linear" distance along the view axis, 0 or infinite at the sky.
        near: distance of the near plane, > 0, also if depth is reversed. Used with a finite far plane, and
            with linear depth, where it changes no image.
        far: distance of the far plane, > near. "reversed" and "forward" need it; for "linear", surfaces at
            this distance and beyond are sky.
        jitter_unit: unit of the jitter.
        jitter_sign: +1: the sample is taken at the pixel's centre + jitter; -1: at centre - jitter (the image
            moves by + jitter).
        jitter_flip_y: True if y of the jitter is opposite to y of the unit.
        bottom_up: True if row 0 is the bottom row. It does not affect the y of vectors.
        srgb: True if colour is sRGB-encoded; it is decoded to linear.

    Raises:
        ArgumentError: a field has a value that is not allowed, or contradicts another.
    """

    motion_unit: Unit = "pixels"
    motion_scale: tuple[float, float] = (1.0, 1.0)
    motion_direction: Direction = "previous_minus_current"
    motion_next_direction: NextDirection = "next_minus_current"
    motion_flip_y: bool = False
    motion_resolution: Resolution = "render"
    motion_jittered: bool = False
    depth: DepthKind = "reversed_infinite"
    near: float = 0.1
    far: float | None = None
    jitter_unit: Unit = "pixels"
    jitter_sign: int = 1
    jitter_flip_y: bool = False
    bottom_up: bool = False
    srgb: bool = False

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if get_origin(field.type) is Literal:
                checked_choice(field.name, value, get_args(field.type))
            elif field.type is bool and not isinstance(value, bool):
                raise ArgumentError(field.name, got=shown(value), want="True or False")
        if as_number(self.jitter_sign) not in (1.0, -1.0):
            raise ArgumentError("jitter_sign", got=shown(self.jitter_sign), want="+1 or -1")
        self._check_planes()
        plain = {"jitter_sign": int(self.jitter_sign), "motion_scale": _checked_scale(self.motion_scale)}
        plain |= {"near": float(self.near), "far": None if self.far is None else float(self.far)}
        for name, value in plain.items():  # numbers of numpy cannot be written as JSON
            object.__setattr__(self, name, value)

    def _check_planes(self) -> None:
        if not _is_usable(self.near) or self.near <= 0:
            hint = "near is the distance of the near plane, also if depth is reversed."
            want = f"a finite distance > 0, {_RANGE}"
            raise ArgumentError("near", got=shown(self.near), want=want, hint=hint)
        if self.far is None:
            if self.depth in ("reversed", "forward"):
                hint = f"Without a far plane it is depth='{self.depth}_infinite'."
                want = f"a distance, because depth is '{self.depth}'"
                raise ArgumentError("far", got=None, want=want, hint=hint)
            return
        if not _is_usable(self.far) or self.far <= self.near:
            hint = "far is the farther plane, also if depth is reversed."
            want = f"finite and > near = {self.near}, or None"
            raise ArgumentError("far", got=shown(self.far), want=want, hint=hint)
        if self.depth.endswith("infinite"):
            raise ArgumentError("far", got=self.far, want=f"None, because depth is '{self.depth}'")

    def __repr__(self) -> str:
        """Return the Python call that makes this value, without defaults."""
        return f"Conventions({', '.join(f'{name}={value!r}' for name, value in self._changed().items())})"

    def converter(self, *, display_size: Size | None = None) -> "Converter":
        """Return a converter for one sequence of frames, to be converted in order.

        Args:
            display_size: (width, height), needed only by `Converter.from_frame` with motion at display size.

        Raises:
            ArgumentError: `display_size` is not an image size.
        """
        return Converter(self, display_size=display_size)

    def motion_factor(self, size: Size, buffer_size: Size, name: _Motion = "motion") -> tuple[float, float]:
        """Return the factor (x, y) from a stored vector to render pixels, other frame minus current.

        Args:
            size: render size.
            buffer_size: size of the motion buffer: render or display size.
            name: "motion" to the previous frame, or "motion_next" to the next.
        """
        direction = self.motion_direction if name == "motion" else self.motion_next_direction
        sign = 1.0 if direction.endswith("minus_current") else -1.0
        x, y = _pixels_per_unit(self.motion_unit, size, buffer_size)
        scale_x, scale_y = self.motion_scale
        return sign * scale_x * x, sign * scale_y * (-y if self.motion_flip_y else y)

    def jitter_factor(self, size: Size) -> tuple[float, float]:
        """Return the factor (x, y) from a stored jitter to render pixels, pixel centre to sample."""
        x, y = _pixels_per_unit(self.jitter_unit, size, size)
        return self.jitter_sign * x, self.jitter_sign * (-y if self.jitter_flip_y else y)

    def to_json(self) -> dict[str, Any]:
        """Return the fields that differ from the defaults as a dict of JSON values."""
        changed = self._changed().items()
        return {name: list(value) if isinstance(value, tuple) else value for name, value in changed}

    def _changed(self) -> dict[str, Any]:
        values = ((field, getattr(self, field.name)) for field in fields(self))
        return {field.name: value for field, value in values if value != field.default}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Return the conventions from a dict of `to_json`; missing fields are defaults.

        With "preset", a name of PRESETS, missing fields are the preset's.

        Raises:
            ArgumentError: it is not a mapping, a key is unknown, or a value is not allowed.
        """
        if not isinstance(content, Mapping):
            raise ArgumentError("conventions", got=shown(content), want="a mapping of fields to values")
        overrides = dict(content)
        preset = overrides.pop("preset", "supersampler")
        if preset not in [*PRESETS]:
            hint = did_you_mean(preset, PRESETS)
            raise ArgumentError("preset", got=shown(preset), want=f"one of {', '.join(PRESETS)}", hint=hint)
        make = cls if preset == "supersampler" else getattr(cls, preset)
        return cls._preset(make()._changed(), overrides)

    @classmethod
    def _preset(cls, preset: Mapping[str, Any], overrides: Mapping[str, Any]) -> Self:
        known = [field.name for field in fields(cls)]
        for name in overrides:
            if name not in known:
                got, hint = f"given {shown(name)}", did_you_mean(name, known)
                raise ArgumentError("conventions", got=got, want=f"one of {', '.join(known)}", hint=hint)
        return cls(**{**preset, **overrides})

    @classmethod
    def fsr(cls, **overrides: Any) -> Self:
        """AMD FSR 2 and 3, Arm ASR: motion in pixels, previous minus current; the image moves by + jitter.

        `motion_scale` is motionVectorScale: (W, H) for vectors in UV, and (0.5 W, -0.5 H) for NDC. (FSR's
        README shows (W, H) for NDC, which is twice too long and upside down.) Depth is reversed with an
        infinite far plane, as FSR recommends; without its flags use depth="forward", near=, far=.

        Sources: FidelityFX-FSR2 README "Camera jitter" (translation by 2 x / W, -2 y / H on the left of the
        projection); ffx_fsr2.cpp (motionVectorScale / target size); ffx_fsr2_upsample.h (sample at - jitter);
        ffx_fsr2_callbacks_hlsl.h (jittered motion is cancelled by previous minus current jitter).
        """
        return cls._preset({"jitter_sign": -1}, overrides)

    @classmethod
    def xess(cls, **overrides: Any) -> Self:
        """Intel XeSS: motion in pixels, previous minus current; forward depth; the image moves by + jitter.

        XESS_INIT_FLAG_USE_NDC_VELOCITY is motion_unit="ndc", HIGH_RES_MV motion_resolution="display",
        JITTERED_MV motion_jittered=True, INVERTED_DEPTH depth="reversed_infinite"; `motion_scale` is
        xessSetVelocityScale. With a finite far plane use depth="forward", near=, far=.

        Source: intel/xess doc/xess_sr_developer_guide_english.md, "Jitter" (`P[2][0] += 2 x / W` and
        `P[2][1] -= 2 y / H` on row vectors; "the effective jitter is negated"), "Motion Vectors", "Depth".
        """
        return cls._preset({"jitter_sign": -1, "depth": "forward_infinite"}, overrides)

    @classmethod
    def streamline(cls, **overrides: Any) -> Self:
        """NVIDIA Streamline (DLSS): motion in UV after mvecScale; jitter in pixels with FSR's sign.

        `motion_scale` is sl::Constants::mvecScale, (1 / w, 1 / h) for vectors in pixels; depthInverted
        eFalse is depth="forward_infinite" or "forward", motionVectorsJittered is motion_jittered=True. NGX
        itself takes pixels: motion_unit="pixels" and InMVScale as `motion_scale`.

        Sources: Streamline sl_consts.h, ProgrammingGuideDLSS.md section 6. They do not state the jitter's
        sign; OptiScaler passes NGX's Jitter_Offset to FSR 2 and XeSS unchanged.
        """
        return cls._preset({"motion_unit": "uv", "jitter_sign": -1}, overrides)

    @classmethod
    def unreal(cls, **overrides: Any) -> Self:
        """Unreal Engine: velocity in NDC, current minus previous; TemporalJitterPixels with FSR's sign.

        Decode the velocity buffer first, with the engine's DecodeVelocityFromTexture. Where its x is 0,
        compute the camera's motion from depth and ClipToPrevClip. By hand: v = (stored - 32767 / 65535) /
        0.2495, then, from shader model 5 on (VELOCITY_ENCODE_GAMMA in 5.7 and 5.8), v |v| / 2. An exported
        SceneDepth is depth="linear".

        Sources: accuracy-super-resolution-for-unreal, ConvertVelocity.usf (decoding; v (-0.5, 0.5) is FSR's);
        SceneVisibility.cpp, HackAddTemporalAAProjectionJitter(2 x / W, -2 y / H); Arm's capture plugin
        (v (0.5, -0.5) is current minus previous).
        """
        preset = {"motion_unit": "ndc", "motion_direction": "current_minus_previous", "jitter_sign": -1}
        return cls._preset(preset, overrides)

    @classmethod
    def unity(cls, **overrides: Any) -> Self:
        """Unity HDRP: motion in UV, current minus previous; taaJitter moves the camera, in pixels.

        Rows begin at v = 0, as shaders, ReadPixels and AsyncGPUReadback read Unity's textures: the image is
        upside down, and so are y of motion and jitter, on every platform. For upright images add
        motion_flip_y=True and jitter_flip_y=True; for arrays of ReadPixels also bottom_up=True (EncodeToEXR
        flips the rows itself). In URP the jitter moves the image: jitter_sign=-1. Set near and far to the
        camera's; the preset has Unity's defaults.

        Sources: script reference, AMD.FSR2Context.executeData (FSR's jitter is - taaJitter and its
        motionVectorScale - (w, h), in x and y alike); HDCamera.cs, GetJitteredProjectionMatrix; HDRP
        BuiltinUtilities.hlsl and URP MotionVectorsCommon.hlsl (y negated where UNITY_UV_STARTS_AT_TOP); URP
        TemporalAA.cs, CalculateJitterMatrix (translation by 2 x / W, 2 y / H).
        """
        preset = {
            "motion_unit": "uv", "motion_direction": "current_minus_previous",
            "depth": "reversed", "near": 0.3, "far": 1000.0,
        }  # fmt: skip
        return cls._preset(preset, overrides)

    @classmethod
    def godot(cls, **overrides: Any) -> Self:
        """Godot 4.3 and later: velocity in UV, previous minus current; taa_jitter in NDC with y down.

        The jitter is - (P.z.x, P.z.y) of P = RenderSceneData.get_cam_projection(), for a camera without
        offset. With a temporal 3D scaling mode, velocity is (-1, -1) where only the camera moves: fill these
        pixels with `camera_motion`. Set near and far to the camera's; the preset has Godot's defaults.

        Sources: scene_forward_clustered.glsl (motion_vector); render_scene_data_rd.cpp (correction,
        add_jitter_offset); render_forward_clustered.cpp (FSR 2's jitter is taa_jitter size / 2; velocity
        cleared to -1); fsr2.cpp (motionVectorScale is the internal size; depth inverted, far plane finite).
        """
        preset = {
            "motion_unit": "uv", "depth": "reversed", "near": 0.05, "far": 4000.0,
            "jitter_unit": "ndc", "jitter_flip_y": True, "jitter_sign": -1,
        }  # fmt: skip
        return cls._preset(preset, overrides)

    @classmethod
    def blender(cls, **overrides: Any) -> Self:
        """Blender's Cycles passes: Vector's X and Y in pixels, y up, previous minus current; Z is distance.

        Vector's Z and W are current minus next. The sky's Z is 1e10. Blender has no jitter of its own: a
        camera with shift_x = x / max(w, h) and shift_y = -y / max(w, h) samples at the pixel's centre +
        (x, y), which is this package's sign.

        Source: measured; a converged image, warped by these vectors, matches the next.
        """
        preset = {
            "motion_next_direction": "current_minus_next", "motion_flip_y": True,
            "depth": "linear", "far": 1e10,
        }  # fmt: skip
        return cls._preset(preset, overrides)

    @classmethod
    def arm_gym(cls, **overrides: Any) -> Self:
        """Arm's neural graphics model gym: motion_lr in pixels, current minus previous; sample at + jitter.

        Reorder its (y, x) motion and jitter to (x, y) first. ReverseZ is depth="reversed_infinite"; a
        finite zFar is depth="forward", near=, far=.

        Sources: nss_dataset_specification.md; dense_warp_utils.py (grid - flow); graphics_utils.py and
        pre_process.slang (unjitter_uv = uv - jitter).
        """
        preset = {"motion_direction": "current_minus_previous", "depth": "forward_infinite"}
        return cls._preset(preset, overrides)

    @classmethod
    def vtk(cls, **overrides: Any) -> Self:
        """VTK and PyVista: GetZbufferData of a perspective camera, GetPixelData, jitter by SetWindowCenter.

        Rows are bottom-up, also in `motion`. VTK has no motion vectors: `camera_motion` computes the camera's
        from flipped depth, with clip="minus_one_to_one". Set near and far to the camera's clipping range,
        which must stay the same between resets; the preset has VTK's defaults. The jitter is the offset of
        the window centre: (2 x / w, -2 y / h) samples at the pixel's centre + (x, y).

        Sources: vtkCamera.cxx, ComputeProjectionTransform (the window centre moves the frustum, in units of
        half the view); vtkOpenGLRenderWindow.cxx, GetZbufferData (z / w of -1 to 1 as 0 to 1).
        """
        preset = {
            "depth": "forward", "near": 0.01, "far": 1000.01, "jitter_unit": "ndc", "bottom_up": True,
        }  # fmt: skip
        return cls._preset(preset, overrides)


PRESETS: Mapping[str, Callable[..., Conventions]] = {
    "supersampler": Conventions, "fsr": Conventions.fsr, "xess": Conventions.xess,
    "streamline": Conventions.streamline, "unreal": Conventions.unreal, "unity": Conventions.unity,
    "godot": Conventions.godot, "blender": Conventions.blender, "arm_gym": Conventions.arm_gym,
    "vtk": Conventions.vtk,
}  # fmt: skip
"""Conventions by name, for `--conventions`; "supersampler" is the package's own, as in `Frame`."""


class Converter:
    """Converts the frames of one sequence, in order; `Conventions.converter` makes it.

    Its only state is the previous frame's jitter, for jittered motion vectors. A refused frame leaves it
    unchanged. The two directions are independent of each other.
    """

    def __init__(self, conventions: Conventions, *, display_size: Size | None = None) -> None:
        self.conventions = conventions
        self.display_size = None if display_size is None else checked_size("display_size", display_size)
        self._previous_in: _Pair | None = None  # in UV, as the render size may change
        self._previous_out: _Pair | None = None

    @ieee_arithmetic
    def to_frame(self, raw: RawFrame) -> Frame:
        """Return the frame in this package's conventions. Unchanged arrays are not copied.

        Raises:
            FrameError: an input has a shape, type or range that these conventions do not allow.
            ArgumentError: the argument is not a RawFrame.
        """
        if not isinstance(raw, RawFrame):
            raise ArgumentError("raw", got=shown(raw), want="a supersampler.RawFrame")
        depth = self._rows(_floating("depth", raw.depth))
        size = _render_size(depth)
        jitter = self._jitter_in(raw.jitter, size)
        reset = checked_reset(raw.reset)
        shift = self._shift(jitter, size, None if reset else self._previous_in)
        frame = Frame(
            depth=self._depth(depth),
            motion=self._vectors_in("motion", raw.motion, jitter, size, shift),
            motion_next=self._motion_next_in(raw, jitter, size),
            jitter=jitter,
            reset=reset,
            **self._converted(raw),
        )
        self._previous_in = _in_uv(jitter, size)
        return frame

    @ieee_arithmetic
    def from_frame(self, frame: Frame) -> RawFrame:
        """Return the frame in these conventions: the inverse of `to_frame`.

        Raises:
            FrameError: the depth has surfaces beyond the far plane.
            ArgumentError: the argument is not a Frame; or motion is at display size, without `display_size`.
        """
        checked_frame(frame)
        shift = self._shift(frame.jitter, frame.size, None if frame.reset else self._previous_out)
        # Jittered vectors to the next frame would need its jitter, which is not known yet.
        no_next = frame.motion_next is None or self.conventions.motion_jittered
        scale_x, scale_y = self.conventions.jitter_factor(frame.size)
        raw = RawFrame(
            depth=self._rows(self._depth(frame.depth, encode=True)),
            motion=self._vectors_out("motion", frame, shift),
            motion_next=None if no_next else self._vectors_out("motion_next", frame),
            jitter=(frame.jitter[0] / scale_x, frame.jitter[1] / scale_y),
            reset=frame.reset,
            **self._converted(frame, encode=True),
        )
        self._previous_out = _in_uv(frame.jitter, frame.size)
        return raw

    def pass_over(self, jitter: tuple[float, float] | None, size: Size) -> None:
        """Skip a frame with this stored jitter and render size."""
        self._previous_in = self._previous_out = _in_uv(self._jitter_in(jitter, size), size)

    def _rows(self, array: Array) -> Array:
        return np.ascontiguousarray(array[::-1]) if self.conventions.bottom_up else array

    def _converted(self, source: RawFrame | Frame, *, encode: bool = False) -> dict[str, Any]:
        """Return the fields that both directions convert alike; `encode` reverses sRGB and kind of depth."""
        color, reactive, aovs = (
            None if array is None else self._rows(_floating(name, array))
            for name, array in (("color", source.color), ("reactive", source.reactive), ("aovs", source.aovs))
        )
        if color is not None and self.conventions.srgb:
            color = encodings.srgb_encoded(color) if encode else encodings.srgb_decoded(color)
        return {
            "color": color,
            "reactive": reactive,
            "aovs": aovs,
            "ids": None if source.ids is None else self._rows(_image("ids", source.ids)),
            "gbuffer": self._gbuffer("gbuffer", source.gbuffer, encode=encode),
            "gbuffer_display": self._gbuffer("gbuffer_display", source.gbuffer_display, encode=encode),
            "exposure": source.exposure,
            "pre_exposure": source.pre_exposure,
        }

    def _depth(self, depth: Array, *, encode: bool = False) -> NDArray[np.float32]:
        kind = self.conventions
        convert = encodings.from_reversed_infinite if encode else encodings.to_reversed_infinite
        return convert(depth, kind.depth, kind.near, kind.far)

    def _gbuffer(
        self, group: str, buffers: Mapping[str, Array] | None, *, encode: bool = False
    ) -> Mapping[str, Array] | None:
        if buffers is None:
            return None
        converted = {
            name: self._rows(_floating(f"{group}[{name!r}]", array))
            for name, array in checked_buffers(group, buffers).items()
        }
        if "depth" in converted:
            converted["depth"] = self._depth(converted["depth"], encode=encode)
        return converted

    def _jitter_in(self, jitter: _Pair | None, size: Size) -> _Pair:
        x, y = (0.0, 0.0) if jitter is None else pair_of(jitter)
        scale_x, scale_y = self.conventions.jitter_factor(size)
        return checked_jitter((_snapped(x * scale_x), _snapped(y * scale_y)))

    def _shift(self, jitter: _Pair, size: Size, previous: _Pair | None) -> _Pair:
        """Return the jitter in a vector: current minus previous jitter, in render pixels.

        The image moves by - jitter, so this adds to the previous minus current position.
        """
        if not self.conventions.motion_jittered or previous is None:
            return 0.0, 0.0
        return jitter[0] - previous[0] * size[0], jitter[1] - previous[1] * size[1]

    def _vectors_in(
        self, name: _Motion, stored: Array, jitter: _Pair, size: Size, shift: _Pair = (0.0, 0.0)
    ) -> Array:
        """Return the vectors of the render pixels, in render pixels."""
        vectors = self._rows(_floating(name, stored))
        buffer_size = _checked_motion_size(name, vectors, size, self.conventions.motion_resolution)
        if self.conventions.motion_resolution == "display":
            x, y = (
                (np.arange(size[axis]) + 0.5 + jitter[axis]) * buffer_size[axis] / size[axis]
                for axis in (0, 1)
            )
            vectors = _sampled(vectors, x, y)
        factor = self.conventions.motion_factor(size, buffer_size, name)
        if factor == (1.0, 1.0) and shift == (0.0, 0.0):
            return vectors
        pixels: NDArray[np.float32] = vectors.astype(np.float32) * _vector(factor) - _vector(shift)
        return pixels

    def _vectors_out(self, name: _Motion, frame: Frame, shift: _Pair = (0.0, 0.0)) -> Array:
        """Return the vectors of the motion buffer's pixels, in the unit of these conventions."""
        vectors, size = getattr(frame, name), frame.size
        buffer_size = size
        if self.conventions.motion_resolution == "display":
            buffer_size = self._display_size(frame)
            x, y = (
                (np.arange(buffer_size[axis]) + 0.5) * size[axis] / buffer_size[axis] - frame.jitter[axis]
                for axis in (0, 1)
            )
            vectors = _sampled(vectors, x, y)
        factor = self.conventions.motion_factor(size, buffer_size, name)
        if factor != (1.0, 1.0) or shift != (0.0, 0.0):
            vectors = (vectors.astype(np.float32) + _vector(shift)) / _vector(factor)
        return self._rows(vectors)

    def _motion_next_in(self, raw: RawFrame, jitter: _Pair, size: Size) -> Array | None:
        """Return `Frame.motion_next`; FrameError if it contains jitter: the next frame's is not known."""
        if raw.motion_next is None:
            return None
        if self.conventions.motion_jittered:
            hint = "Leave it out, or write vectors without jitter."
            raise FrameError("motion_next", got="given, with jitter in it", want="without jitter", hint=hint)
        return self._vectors_in("motion_next", raw.motion_next, jitter, size)

    def _display_size(self, frame: Frame) -> Size:
        if self.display_size is None:
            hint = "Make the converter with conventions.converter(display_size=(width, height))."
            raise ArgumentError("display_size", got=None, want="the size of the motion vectors", hint=hint)
        if self.display_size[0] < frame.size[0] or self.display_size[1] < frame.size[1]:
            raise ArgumentError("display_size", got=self.display_size, want=f"at least {frame.size}")
        return self.display_size


def checked_conventions(value: object) -> Conventions:
    """Return `Conventions`; ArgumentError for anything else, such as the name of a preset."""
    if not isinstance(value, Conventions):
        hint = f"Write Conventions.{value}()." if isinstance(value, str) and value in PRESETS else ""
        raise ArgumentError("conventions", got=shown(value), want="supersampler.Conventions", hint=hint)
    return value


def _is_usable(value: object) -> bool:
    number = as_number(value)
    return number is not None and _MIN_FACTOR <= abs(number) <= MAX_FACTOR


def _checked_scale(scale: object) -> tuple[float, float]:
    if isinstance(scale, tuple | list) and len(scale) == 2 and all(map(_is_usable, scale)):
        return float(scale[0]), float(scale[1])
    want = f"(x, y), two finite numbers that are not 0, {_RANGE}"
    raise ArgumentError("motion_scale", got=shown(scale), want=want)


def _pixels_per_unit(unit: str, size: Size, buffer_size: Size) -> tuple[float, float]:
    if unit == "pixels":
        return size[0] / buffer_size[0], size[1] / buffer_size[1]
    return (float(size[0]), float(size[1])) if unit == "uv" else (size[0] / 2.0, -size[1] / 2.0)


def _image(name: str, value: object) -> NDArray[Any]:
    """Return an array that has rows and columns."""
    array = as_array(name, value)
    if array.ndim < 2:
        raise FrameError(name, got=f"of shape {array.shape}", want="(h, w), or (h, w, channels)")
    return array


def _floating(name: str, value: object) -> NDArray[Any]:
    """Return a float16 or float32 array; other floats are converted, other types are refused."""
    array = _image(name, value)
    if array.dtype not in (np.float32, np.float16):
        if array.dtype.kind == "f":  # double precision, or of the other byte order
            return array.astype(np.float32)
        hint = "Bring integers to their range first, for example pixels.astype(np.float32) / 255."
        if array.dtype.kind == "b":
            hint = "Convert it: array.astype(np.float32)."
        raise FrameError(name, got=array.dtype, want="float32 or float16", hint=hint)
    return array


def _render_size(depth: NDArray[Any]) -> Size:
    if depth.ndim != 2 or 0 in depth.shape:
        hint = "Drop the last axis: array[..., 0]." if depth.ndim == 3 else ""
        raise FrameError("depth", got=f"of shape {depth.shape}", want="(h, w), at least one pixel", hint=hint)
    return depth.shape[1], depth.shape[0]


def _checked_motion_size(name: str, motion: NDArray[Any], size: Size, resolution: str) -> Size:
    height, width = motion.shape[:2] if motion.ndim == 3 and motion.shape[2] == 2 else (0, 0)
    if resolution == "display" and width >= size[0] and height >= size[1]:
        return width, height
    if resolution == "render" and (width, height) == size:
        return size
    needed = f"({size[1]}, {size[0]}, 2)"
    larger = resolution == "render" and width >= size[0] and height >= size[1]
    raise FrameError(
        name,
        got=f"of shape {motion.shape}",
        want=f"{needed}, the size of depth" if resolution == "render" else f"(H, W, 2), at least {needed}",
        hint="Vectors at display size need Conventions(motion_resolution='display')." if larger else "",
    )


def _sampled(vectors: Array, x: NDArray[np.float64], y: NDArray[np.float64]) -> Array:
    """Return the vectors of the pixels that contain these positions, clamped to the image."""
    rows, columns = (
        np.clip(np.floor(position).astype(np.intp), 0, count - 1)
        for position, count in zip((y, x), vectors.shape, strict=False)
    )
    return vectors[rows[:, None], columns]


def _vector(pair: _Pair) -> NDArray[np.float32]:
    return np.array(pair, np.float32)


def _in_uv(jitter: _Pair, size: Size) -> _Pair:
    return jitter[0] / size[0], jitter[1] / size[1]


def _snapped(jitter: float) -> float:
    """Clamp a jitter that exceeds half a pixel only by rounding: float32 UV or NDC is not exact."""
    return max(-0.5, min(0.5, jitter)) if abs(jitter) <= 0.5 + 1e-4 else jitter
