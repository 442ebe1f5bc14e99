"""Tests of `FrameChecker`: no warning for correct frames, the right message for each mistake."""

import itertools
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from noise import noise
from plain_frames import plain_frame
from supersampler import Upscaler
from supersampler.arguments import Validate
from supersampler.conventions import Conventions
from supersampler.conventions.encodings import srgb_encoded
from supersampler.conventions.jitter import halton_jitter
from supersampler.errors import FrameError, FrameWarning
from supersampler.frame import Frame
from supersampler.io.shot import Shot
from supersampler.validation import FrameChecker, mistakes
from supersampler.validation.mistakes import Mistake
from supersampler_model.data.scenes.analytic import DiscOverPlane, Plane, checker, zone_plate

DISPLAY = (640, 360)


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    shot = Shot.open("plaza")
    return [shot.read(index).frame for index in range(12, 16)]


def check_all(frames: list[Frame]) -> None:
    checker = FrameChecker("strict")
    for frame in frames:
        checker.check(frame, DISPLAY)


def misread(frames: list[Frame], **overrides: Any) -> list[Frame]:
    """Return frames as they are read when their conventions are taken for the SDK's own."""
    there, taken_as_ours = Conventions(**overrides).converter(), Conventions().converter()
    return [taken_as_ours.to_frame(there.from_frame(frame)) for frame in frames]


def test_a_real_shot_is_fine(frames: list[Frame]) -> None:
    check_all(frames)


@pytest.mark.parametrize("pattern", [zone_plate, checker])
@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.3, -0.7), (2.0, 1.0)])
def test_hard_patterns_still_or_moving_are_fine(pattern: Any, velocity: tuple[float, float]) -> None:
    scene = Plane(pattern, velocity)
    check_all([scene.frame(i, (96, 54), halton_jitter(i, 2.0)) for i in range(5)])


def jittered(place: Callable[[int], int], count: int = 32) -> list[Frame]:
    """Return frames of noise whose jitter is that of index `place(i)`; every second one is unshaded."""
    frames = [noise(i, (24, 16), jitter=halton_jitter(place(i), 2.0), reset=i == 0) for i in range(2 * count)]
    return [replace(frame, color=None) if i % 2 else frame for i, frame in enumerate(frames)]


def warnings_of_jitter(frames: list[Frame], validate: Validate = "warn") -> list[str]:
    return [
        message for message in messages_of(frames, (48, 32), validate=validate) if "on average" in message
    ]


@pytest.mark.parametrize("validate", ["warn", "strict"])
def test_shaded_frames_with_half_of_the_jitter_are_warned_of_once(validate: Validate) -> None:
    [message] = warnings_of_jitter(jittered(lambda i: i), validate)
    assert "over 32 shaded frames" in message
    assert "halton_jitter(index // 2, ratio)" in message
    assert len(warnings_of_jitter(jittered(lambda i: i) + jittered(lambda i: i), validate)) == 2, (
        "after a cut"
    )


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("start", [0, 5, 17])
def test_jitter_that_counts_shaded_frames_is_fine(ratio: float, start: int) -> None:
    frames = jittered(lambda i: i // 2)
    own = [replace(f, jitter=halton_jitter(start + i // 2, ratio)) for i, f in enumerate(frames)]
    assert warnings_of_jitter(own) == []
    elsewhere = [replace(f, jitter=(0.4, 0.4)) if f.color is None else f for f in own]
    assert warnings_of_jitter(elsewhere) == [], "the jitter of frames that are not shaded is not used"


def test_an_object_moving_in_front_of_another_passes() -> None:
    check_all([DiscOverPlane().frame(i, (128, 72), halton_jitter(i, 2.0)) for i in range(5)])


def test_motion_is_not_held_against_a_frame_that_it_does_not_lead_to() -> None:
    """A camera that shakes: between shaded frames, motion is to one that was not."""
    scene, handed_in = Plane(checker, (2.0, 1.0)), [0, 2, 1, 3, 2, 4, 3]
    frames = []
    for number, (index, before) in enumerate(zip(handed_in, [0, *handed_in], strict=False)):
        frame = scene.frame(index, (96, 54), halton_jitter(number, 2.0))
        motion = frame.motion * np.float32(index - before)
        color = frame.color if number % 2 == 0 else None
        frames.append(replace(frame, motion=motion, color=color, reset=number == 0))
    check_all(frames)


@pytest.mark.parametrize("name", ["black", "all sky", "noise", "one pixel", "not shaded"])
def test_images_without_evidence_pass(frames: list[Frame], name: str) -> None:
    def change(frame: Frame) -> Frame:
        assert frame.color is not None
        if name == "black":
            return replace(frame, color=frame.color * 0)
        if name == "all sky":
            return replace(frame, color=frame.color * 0 + 1, depth=frame.depth * 0, motion=frame.motion * 0)
        if name == "noise":
            noise = np.random.default_rng(0).random(frame.color.shape, np.float32)
            return replace(frame, color=noise)
        if name == "not shaded":
            return replace(frame, color=None)
        return replace(frame, **{key: getattr(frame, key)[:1, :1] for key in ("color", "depth", "motion")})

    check_all([change(frame) for frame in frames])


@pytest.mark.parametrize(
    ("overrides", "field", "hint"),
    [
        ({"motion_unit": "ndc"}, "motion", "motion_unit='ndc'"),
        ({"motion_unit": "uv"}, "motion", "motion_unit='uv'"),
        ({"motion_flip_y": True}, "motion", "motion_flip_y=True"),
        (
            {"motion_direction": "current_minus_previous"},
            "motion",
            "motion_direction='current_minus_previous'",
        ),
        ({"motion_jittered": True}, "motion", "motion_jittered=True"),
        ({"motion_scale": (0.5, 0.5)}, "motion", r"motion_scale=\(0\.5, 0\.5\)"),
        ({"jitter_sign": -1}, "jitter", "jitter_sign=-1"),
        ({"jitter_flip_y": True}, "jitter", "jitter_flip_y=True"),
        ({"jitter_unit": "ndc"}, "jitter", "jitter_unit='ndc'"),
        ({"depth": "forward_infinite"}, "depth", "depth='forward_infinite'"),
        ({"depth": "forward", "far": 100.0}, "depth", "depth='forward_infinite'"),
        ({"depth": "linear"}, "depth", "depth='linear'"),
        ({"depth": "linear", "far": 1000.0}, "depth", "depth='linear'"),
    ],
)
def test_a_missed_convention_is_named(
    frames: list[Frame], overrides: dict[str, Any], field: str, hint: str
) -> None:
    with pytest.raises(FrameError, match=hint) as caught:
        check_all(misread(frames, **overrides))
    assert caught.value.name == field


def with_pixel(frame: Frame, field: str, value: float) -> Frame:
    array = getattr(frame, field).copy()
    array[7, 5] = value
    return replace(frame, **{field: array})


def rest(count: int, **overrides: Any) -> list[Frame]:
    """Frames whose jitter changes in the first four and then stays; nothing moves."""
    still = np.zeros((18, 32, 2), np.float32)
    jitters = [halton_jitter(index, 2.0) for index in range(4)] + [(0.0, 0.0)] * count
    return [noise(1, jitter=jitter, motion=still, **overrides) for jitter in jitters]


def messages_of(
    frames: list[Frame],
    display: tuple[int, int] = (64, 36),
    *,
    converges: bool = True,
    validate: Validate = "warn",
) -> list[str]:
    checker = FrameChecker(validate, converges=converges)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for frame in frames:
            checker.check(frame, display)
    return [str(warning.message) for warning in caught]


def test_jitter_that_stops_while_nothing_moves_is_warned_of_once() -> None:
    (message,) = messages_of(rest(40))
    assert "frame.jitter is (0.0, 0.0) in 8 frames in which nothing moved" in message
    assert "halton_jitter" in message
    assert messages_of(rest(7)) == []


def test_jitter_that_stops_is_warned_of_only_where_a_still_image_would_converge() -> None:
    assert messages_of(rest(40), converges=False) == []
    assert messages_of(rest(40), (32, 18)) == [], "frames of ratio 1 may be anti-aliased already"
    moving = np.full((18, 32, 2), 0.1, np.float32)
    assert messages_of([replace(frame, motion=moving) for frame in rest(40)]) == []


def test_jitter_that_never_changes_is_warned_of_once_in_all() -> None:
    (message,) = messages_of(rest(40)[4:])
    assert "in 3 consecutive frames" in message


def test_an_upscaler_warns_of_jitter_that_stops_if_its_method_converges() -> None:
    for method, warns in (("taau", True), ("taa", False)):
        with (
            Upscaler(method, display_size=(64, 36)) as upscaler,
            warnings.catch_warnings(record=True) as caught,
        ):
            warnings.simplefilter("always")
            for frame in rest(10):
                upscaler.step(frame)
        assert any("nothing moved" in str(warning.message) for warning in caught) == warns


@pytest.mark.parametrize("name", [name for name, each in vars(mistakes).items() if isinstance(each, Mistake)])
def test_the_error_of_a_mistake_names_a_field_of_a_frame(name: str) -> None:
    error = getattr(mistakes, name).error()
    assert error.name in {*Frame.__dataclass_fields__, "{place}"}
    assert str(error).startswith(f"frame.{error.name} is ")


def test_checks_turned_off_read_nothing(frames: list[Frame]) -> None:
    FrameChecker("off").check(with_pixel(frames[0], "color", np.nan), DISPLAY)


def test_a_refused_frame_leaves_the_checker_as_it_was(frames: list[Frame]) -> None:
    checker = FrameChecker("strict")
    checker.check(frames[0], DISPLAY)
    for wrong in (with_pixel(frames[3], "motion", np.nan), replace(frames[1], motion=-frames[1].motion)):
        with pytest.raises(FrameError):
            checker.check(wrong, DISPLAY)
    for frame in frames[1:]:
        checker.check(frame, DISPLAY)  # frames[1] is compared with frames[0]


def test_the_checker_keeps_no_buffer_of_the_caller(frames: list[Frame]) -> None:
    assert frames[0].color is not None
    reused = replace(
        frames[0], color=frames[0].color.copy(), depth=frames[0].depth.copy(), motion=frames[0].motion.copy()
    )
    checker = FrameChecker("strict")
    for frame in frames:
        for field in ("color", "depth", "motion"):
            getattr(reused, field)[:] = getattr(frame, field)
        checker.check(replace(reused, jitter=frame.jitter), DISPLAY)


@pytest.mark.parametrize("exposure", [1e30, 1e-20])
def test_an_exposure_outside_the_usable_range_is_reported(exposure: float) -> None:
    strict = FrameChecker("strict")
    strict.check(noise(0, exposure=1e6), (64, 36), ())
    with pytest.raises(FrameError, match=r"exposure is 1e.*want 6e-08 to 1.7e"):
        strict.check(noise(0, exposure=exposure), (64, 36), ())


# --- which frames are read ---


def test_three_frames_of_a_start_are_read_and_each_kind_is_warned_of_once() -> None:
    checker = FrameChecker("warn")

    jitters = itertools.count()

    def warned(**fields: Any) -> int:
        fields["jitter"] = halton_jitter(next(jitters), 2.0)  # one that stays is a mistake of its own
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", FrameWarning)
            checker.check(plain_frame(**fields), (160, 120))
        return len(caught)

    for _ in range(2):
        assert [warned(reset=True), warned(), warned(exposure=1e12), warned(exposure=1e12)] == [0, 0, 1, 0]
        assert [warned(reset=True), warned(), warned(), warned(exposure=1e12)] == [0, 0, 0, 0]
        assert [warned(exposure=1e12, reset=True), warned(exposure=1e12)] == [1, 0]


def test_a_warning_points_at_the_line_that_hands_in_the_frame() -> None:
    upscaler, frame = Upscaler("taau", scale=2.0), plain_frame(exposure=1e12, reset=True)
    for call in (
        lambda: FrameChecker().check(frame, (160, 120)),
        lambda: upscaler.step(frame),
        lambda: Upscaler.step_many([upscaler], [frame]),
    ):
        with pytest.warns(FrameWarning) as caught:
            call()
        assert caught[0].filename == __file__


def test_frames_kept_for_checks_are_freed_after_the_last_read() -> None:
    checker: Any = FrameChecker("warn")
    for index in range(3):
        checker.check(plain_frame(jitter=halton_jitter(index, 2.0)), (160, 120))
    checker.check(plain_frame(jitter=halton_jitter(3, 2.0)), (160, 120))
    assert checker._seen.previous is None


@pytest.mark.parametrize("scale", [1, 255])
def test_a_shot_as_it_is_displayed_is_hinted_at(frames: list[Frame], scale: int) -> None:
    color = np.asarray(frames[0].color, np.float32)
    shown = scale * srgb_encoded(color / (1 + color.max(axis=2, keepdims=True)))
    [message] = messages_of([replace(frames[0], color=shown)], DISPLAY)
    assert f"frame.color is never above {scale}, and as bright as a displayed image" in message
    assert messages_of([replace(frames[0], color=scale * color / color.max())], DISPLAY) == []
