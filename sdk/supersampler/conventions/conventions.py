"""`Conventions`: the units, signs and spaces of a frame's inputs, with presets for engines."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, Self, get_args, get_origin

from supersampler.arguments import as_number, checked_choice
from supersampler.conventions.converter import Converter
from supersampler.conventions.encodings import DepthKind
from supersampler.errors import ArgumentError, did_you_mean, shown
from supersampler.frame import Size

Unit = Literal["pixels", "uv", "ndc"]
Direction = Literal["previous_minus_current", "current_minus_previous"]
NextDirection = Literal["next_minus_current", "current_minus_next"]
Resolution = Literal["render", "display"]

_MIN_FACTOR, _MAX_FACTOR = 1e-30, 1e30  # factors for single precision
_RANGE = f"{_MIN_FACTOR:g} to {_MAX_FACTOR:g}"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Conventions:
    """Units, signs and spaces of an engine's frames. The defaults are those of `Frame`.

    Units: "pixels" are those of the buffer's own grid; "uv" spans the image from 0 to 1, "ndc" from -1 to 1.
    x points right; y points down, but up in "ndc". A `flip_y` reverses y.

    Attributes:
        motion_unit: unit of the vectors after `motion_scale`.
        motion_scale: (x, y), not 0, factor of the stored vectors: FSR's motionVectorScale, Streamline's
            mvecScale, XeSS's velocity scale.
        motion_direction: "previous_minus_current" vectors are added to a pixel to find it in the previous
            frame, "current_minus_previous" ones are subtracted.
        motion_next_direction: direction of `motion_next`: "next_minus_current" vectors are added to a pixel
            to find it in the next frame, "current_minus_next" ones are subtracted.
        motion_flip_y: True where y is opposite to that of the unit.
        motion_resolution: "render"; or "display": vectors at display size, already dilated. Each render pixel
            takes the vector at its centre + jitter.
        motion_jittered: True where the vectors contain the change of the jitter between the two frames.
        depth: "reversed_infinite" near / distance; "reversed" 1 at the near plane, 0 at the far plane;
            "forward" 0 at the near plane, 1 at the far plane; "forward_infinite" 1 - near / distance;
            "linear" distance along the view axis, 0 or infinite at the sky.
        near: distance of the near plane, > 0, also where depth is reversed. It is used with a finite far
            plane and with linear depth, where it changes no image.
        far: distance of the far plane, > near. "reversed" and "forward" need it; for "linear", surfaces at
            this distance and beyond are sky.
        jitter_unit: unit of the jitter.
        jitter_sign: +1: the sample is taken at the pixel's centre + jitter; -1: at centre - jitter (the image
            moves by + jitter).
        jitter_flip_y: True where y is opposite to that of the unit.
        bottom_up: True where row 0 is the bottom row. It does not affect the y of vectors.
        srgb: True where colour is sRGB-encoded; it is decoded to linear.

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
        if _number(self.jitter_sign) not in (1.0, -1.0):
            raise ArgumentError("jitter_sign", got=shown(self.jitter_sign), want="+1 or -1")
        object.__setattr__(self, "motion_scale", _checked_scale(self.motion_scale))
        self._check_planes()

    def _check_planes(self) -> None:
        if not _is_usable(self.near) or self.near <= 0:
            hint = "near is the distance of the near plane, also where depth is reversed."
            want = f"a finite distance > 0, {_RANGE}"
            raise ArgumentError("near", got=shown(self.near), want=want, hint=hint)
        if self.far is None:
            if self.depth in ("reversed", "forward"):
                hint = f"Without a far plane it is depth='{self.depth}_infinite'."
                want = f"a distance, as depth is '{self.depth}'"
                raise ArgumentError("far", got=None, want=want, hint=hint)
            return
        if not _is_usable(self.far) or self.far <= self.near:
            hint = "far is the farther plane, also where depth is reversed."
            want = f"finite and > near = {self.near}, or None"
            raise ArgumentError("far", got=shown(self.far), want=want, hint=hint)
        if self.depth.endswith("infinite"):
            raise ArgumentError("far", got=self.far, want=f"None, as depth is '{self.depth}'")

    def __repr__(self) -> str:
        """Return the Python call that makes this value, without defaults."""
        return f"Conventions({', '.join(f'{name}={value!r}' for name, value in self._changed().items())})"

    def converter(self, *, display_size: Size | None = None) -> Converter:
        """Return a converter for one sequence of frames, which are to be converted in order.

        Args:
            display_size: (width, height), needed only by `Converter.from_frame` with motion at display size.

        Raises:
            ArgumentError: `display_size` is not an image size.
        """
        return Converter(self, display_size=display_size)

    def motion_factor(self, size: Size, buffer_size: Size) -> tuple[float, float]:
        """Return the factor (x, y) from a stored vector to render pixels, previous minus current.

        Args:
            size: render size.
            buffer_size: size of the motion buffer: render or display size.
        """
        return self._vector_factor(size, buffer_size, self.motion_direction == "previous_minus_current")

    def motion_next_factor(self, size: Size, buffer_size: Size) -> tuple[float, float]:
        """Return the factor (x, y) from a stored `motion_next` to render pixels, next minus current."""
        return self._vector_factor(size, buffer_size, self.motion_next_direction == "next_minus_current")

    def jitter_factor(self, size: Size) -> tuple[float, float]:
        """Return the factor (x, y) from a stored jitter to render pixels, pixel centre to sample."""
        x, y = _pixels_per_unit(self.jitter_unit, size, size)
        return self.jitter_sign * x, self.jitter_sign * (-y if self.jitter_flip_y else y)

    def _vector_factor(self, size: Size, buffer_size: Size, points_away: bool) -> tuple[float, float]:
        x, y = _pixels_per_unit(self.motion_unit, size, buffer_size)
        sign = 1.0 if points_away else -1.0
        scale_x, scale_y = self.motion_scale
        return sign * scale_x * x, sign * scale_y * (-y if self.motion_flip_y else y)

    def to_json(self) -> dict[str, Any]:
        """Return the fields that are not defaults as a dict of JSON values."""
        changed = self._changed().items()
        return {name: list(value) if isinstance(value, tuple) else value for name, value in changed}

    def _changed(self) -> dict[str, Any]:
        values = ((field, getattr(self, field.name)) for field in fields(self))
        return {field.name: value for field, value in values if value != field.default}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Return the conventions of a dict of `to_json`; missing fields are defaults.

        Raises:
            ArgumentError: it is not a mapping, a key is unknown, or a value is not allowed.
        """
        if not isinstance(content, Mapping):
            raise ArgumentError("conventions", got=shown(content), want="a mapping of fields to values")
        return cls._preset({}, content)

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
        README shows (W, H) for NDC, which is twice too long and upside down.) Depth is what FSR recommends,
        reversed with an infinite far plane; without its flags use depth="forward", near=, far=.

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

        Sources: Streamline sl_consts.h, ProgrammingGuideDLSS.md section 6. The jitter's sign is not written
        there; evidence: OptiScaler hands NGX's Jitter_Offset to FSR 2 and XeSS unchanged.
        """
        return cls._preset({"motion_unit": "uv", "jitter_sign": -1}, overrides)

    @classmethod
    def unreal(cls, **overrides: Any) -> Self:
        """Unreal Engine: velocity in NDC, current minus previous; TemporalJitterPixels with FSR's sign.

        Decode the velocity buffer first, with the engine's DecodeVelocityFromTexture, and where its x is 0
        compute the camera's motion from depth and ClipToPrevClip. By hand: v = (stored - 32767 / 65535) /
        0.2495, and from shader model 5 on (VELOCITY_ENCODE_GAMMA in 5.7 and 5.8) v |v| / 2 of that. An
        exported SceneDepth is depth="linear".

        Sources: accuracy-super-resolution-for-unreal, ConvertVelocity.usf (decoding; v (-0.5, 0.5) is FSR's);
        SceneVisibility.cpp, HackAddTemporalAAProjectionJitter(2 x / W, -2 y / H); Arm's capture plugin
        (v (0.5, -0.5) is current minus previous).
        """
        preset = {"motion_unit": "ndc", "motion_direction": "current_minus_previous", "jitter_sign": -1}
        return cls._preset(preset, overrides)

    @classmethod
    def unity(cls, **overrides: Any) -> Self:
        """Unity HDRP: motion in UV, current minus previous; taaJitter moves the camera, in pixels.

        Rows are those of Unity's textures, from v = 0 on, as shaders, ReadPixels and AsyncGPUReadback give
        them: the image is upside down, and so are y of motion and jitter, on every platform. For images the
        right way up add motion_flip_y=True and jitter_flip_y=True, to arrays of ReadPixels bottom_up=True,
        too (EncodeToEXR turns the rows itself). In URP the jitter moves the image: jitter_sign=-1. Set near
        and far to the camera's; these are Unity's defaults.

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
        offset. With a temporal 3D scaling mode, velocity is (-1, -1) where only the camera moves: fill it by
        `camera_motion`. Set near and far to the camera's; these are Godot's defaults.

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

        Vector's Z and W are current minus next.

        The sky's Z is 1e10. Blender has no jitter of its own: a camera with shift_x = x / max(w, h) and
        shift_y = -y / max(w, h) samples at the pixel's centre + (x, y), which is this package's sign.

        Source: rendered and measured; a converged image that is warped so matches the next.
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

        Rows are bottom-up, those of `motion` too. VTK has no motion vectors: `camera_motion` makes those of
        the camera, of flipped depth, with clip="minus_one_to_one". Set near and far to the camera's clipping
        range, which must stay the same between resets; these are VTK's defaults. The jitter is what was added
        to the window centre: (2 x / w, -2 y / h) samples at the pixel's centre + (x, y).

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
"""Conventions by name, as `--conventions` takes them; "supersampler" are those of `Frame`."""


def _number(value: object) -> float | None:
    """Return a number that JSON can hold as a float; None for other values."""
    return as_number(value) if isinstance(value, int | float) else None


def _is_usable(value: object) -> bool:
    number = _number(value)
    return number is not None and _MIN_FACTOR <= abs(number) <= _MAX_FACTOR


def _checked_scale(scale: object) -> tuple[float, float]:
    if isinstance(scale, tuple | list) and len(scale) == 2 and all(map(_is_usable, scale)):
        return float(scale[0]), float(scale[1])
    want = f"(x, y), two finite numbers that are not 0, {_RANGE}"
    raise ArgumentError("motion_scale", got=shown(scale), want=want)


def _pixels_per_unit(unit: str, size: Size, buffer_size: Size) -> tuple[float, float]:
    if unit == "pixels":
        return size[0] / buffer_size[0], size[1] / buffer_size[1]
    return (float(size[0]), float(size[1])) if unit == "uv" else (size[0] / 2.0, -size[1] / 2.0)
