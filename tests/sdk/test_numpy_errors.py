"""A program that makes numpy raise at every rounding gets the same results, warnings and errors."""

import contextlib
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from supersampler import Conventions, Frame, Shot, Upscaler, halton_jitter, upscale_sequence
from supersampler.conventions import camera_motion
from supersampler.errors import FrameWarning, SupersamplerError
from supersampler.io.display import ExposureMeter, display_transform, to_uint8
from supersampler.io.display_transforms import display_transform_from
from supersampler.methods.model_file import extrapolation_names, model_names
from supersampler.validation import detect_conventions
from supersampler_bench.specs import with_default_gbuffers

SIZE = (24, 16)
TINY = np.float32(1e-42)  # a denormal
HOSTILE = [np.nan, np.inf, -np.inf, 0.0, -1.0, TINY, -TINY, 1e-30, 6e4, 7e4, 1e30, 3e38]


def hostile(index: int, dtype: Any = np.float32) -> Frame:
    """A frame with all kinds of values in each of its images."""
    rng, shape = np.random.default_rng(index), SIZE[::-1]
    with np.errstate(all="ignore"):
        values = np.array(HOSTILE).astype(dtype)

    def image(channels: int, scale: float) -> Any:
        made = (rng.random((*shape, channels)) * scale).astype(dtype)
        chosen = rng.random(made.shape) < 0.15
        made[chosen] = values[rng.integers(0, len(values), np.count_nonzero(chosen))]
        return made

    depth, aovs = (image(count, 1.0).astype(np.float32) for count in (1, 2))
    jitter, motion = halton_jitter(index, 2.0), image(2, 3.0)
    given = {"color": image(3, 1.0), "depth": depth[..., 0], "motion": motion, "aovs": aovs}
    return Frame(**given, jitter=jitter, reset=index == 3)


def images_of(method: str, how: dict[str, Any]) -> list[Any]:
    found: list[Any] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        upscaler = Upscaler(method, scale=2, **how)
        for index in range(6):
            frame = hostile(index, np.float16 if index == 2 else np.float32)
            frame = with_default_gbuffers(frame, upscaler.gbuffers, (2 * SIZE[0], 2 * SIZE[1]))
            try:
                found.append(upscaler.step(frame, outputs=("aovs",) if index % 2 else ()))
            except SupersamplerError as error:
                found.append(str(error))
    assert not [warning for warning in caught if not issubclass(warning.category, FrameWarning)]
    return [*found, *(str(warning.message) for warning in caught)]


def equal(left: Any, right: Any) -> bool:
    if isinstance(left, str):
        return bool(left == right)
    pairs = [(left, right)] if isinstance(left, np.ndarray) else [(left.image, right.image)]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


@pytest.mark.parametrize("method", model_names())
@pytest.mark.parametrize("executor", ["auto", "onnx"])
def test_steps_are_the_same_under_raising_numpy_errors(method: str, executor: str) -> None:
    how = {"validate": "warn", "executor": executor, "threads": 1}
    plain = images_of(method, how)
    with np.errstate(all="raise"):
        raising = images_of(method, how)
    assert len(plain) == len(raising)
    assert all(map(equal, plain, raising))


@pytest.mark.parametrize("extrapolation", extrapolation_names())
def test_extrapolated_frames_raise_no_error(extrapolation: str) -> None:
    with np.errstate(all="raise"), warnings.catch_warnings():
        warnings.simplefilter("ignore", FrameWarning)
        upscaler = Upscaler("taau", scale=2, extrapolation=extrapolation)
        for index in range(4):
            frame = with_default_gbuffers(hostile(index), upscaler.gbuffers, (2 * SIZE[0], 2 * SIZE[1]))
            try:
                upscaler.step(frame)
                upscaler.extrapolate(replace(frame, color=None, reset=False))
            except SupersamplerError:
                pass


@pytest.mark.parametrize("engine", ["fsr", "xess", "unreal", "unity", "blender"])
def test_converters_raise_only_errors_of_ours(engine: str) -> None:
    with np.errstate(all="raise"):
        converter = getattr(Conventions, engine)().converter(display_size=(48, 32))
        for index in range(4):
            with contextlib.suppress(SupersamplerError):
                converter.to_frame(converter.from_frame(hostile(index)))


def test_calls_on_images_raise_no_error() -> None:
    frames = [hostile(index) for index in range(3)]
    color: Any = frames[0].color
    with warnings.catch_warnings(), np.errstate(all="raise"):
        warnings.simplefilter("ignore", FrameWarning)
        list(upscale_sequence(frames, display_size=(48, 32), model="taau", passes=2))
        detect_conventions(Shot.open("plaza"), frames=4)
        ExposureMeter().read_frame(replace(frames[0], exposure=None))
        to_uint8(display_transform(np.float32(1.0) * color))
        display_transform_from(view="Un-tone-mapped").show(color, 1.0)
        camera_motion(frames[0].depth, np.eye(4), np.diag([1e-30, 1e30, 1.0, 1.0]))
