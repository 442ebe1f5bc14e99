"""Tests of `FrameChecker`: no warning for correct frames, the right message for each mistake."""

import itertools
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from noise import noise
from plain_frames import HEIGHT, WIDTH, complaints, plain_frame
from supersampler import Upscaler
from supersampler.arguments import Validate
from supersampler.conventions import Conventions
from supersampler.conventions.encodings import srgb_encoded
from supersampler.conventions.jitter import halton_jitter
from supersampler.errors import FrameError, FrameWarning
from supersampler.frame import Float32, Frame
from supersampler.io.shot import Shot
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.validation import FrameChecker, mistakes
from supersampler.validation.mistakes import Mistake
from supersampler_model.data.scenes.analytic import AnalyticScene, DiscOverPlane, Plane, checker, zone_plate

DISPLAY = (640, 360)


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    shot = Shot.open("plaza")
    return [shot.read(index).frame for index in range(12, 16)]


def assert_fine(frames: list[Frame]) -> None:
    assert complaints(*frames, validate="strict") == ""


def misread(frames: list[Frame], **overrides: Any) -> list[Frame]:
    """Return frames as they are read when their conventions are taken for the SDK's own."""
    there, taken_as_ours = Conventions(**overrides).converter(), Conventions().converter()
    return [taken_as_ours.to_frame(there.from_frame(frame)) for frame in frames]


SCENES: dict[str, AnalyticScene] = {
    f"{pattern.__name__} {velocity}": Plane(pattern, velocity)
    for pattern in (zone_plate, checker)
    for velocity in ((0.0, 0.0), (0.3, -0.7), (2.0, 1.0))
}


@pytest.mark.parametrize("scene", [*SCENES.values(), DiscOverPlane()], ids=[*SCENES, "a disc before a plane"])
def test_a_real_shot_and_hard_patterns_are_fine(frames: list[Frame], scene: AnalyticScene) -> None:
    assert_fine(frames)
    assert_fine([scene.frame(i, (128, 72), halton_jitter(i, 2.0)) for i in range(5)])


def test_the_render_size_may_change_while_frames_are_read() -> None:
    sizes = [(160, 90)] * 2 + [(96, 54)] * 3
    assert_fine([Plane(checker, (2.0, 1.0)).frame(i, s, halton_jitter(i, 2.0)) for i, s in enumerate(sizes)])


def jittered(place: Callable[[int], int]) -> list[Frame]:
    """Return frames of noise whose jitter is that of index `place(i)`; every second one is unshaded."""
    frames = [noise(i, (24, 16), jitter=halton_jitter(place(i), 2.0), reset=i == 0) for i in range(64)]
    return [replace(frame, color=None) if i % 2 else frame for i, frame in enumerate(frames)]


def warnings_of_jitter(frames: list[Frame], validate: Validate = "warn") -> list[str]:
    return [line for line in complaints(*frames, validate=validate).splitlines() if "on average" in line]


@pytest.mark.parametrize("validate", ["warn", "strict"])
def test_shaded_frames_with_half_of_the_jitter_are_warned_of_once(validate: Validate) -> None:
    [message] = warnings_of_jitter(jittered(lambda i: i), validate)
    assert "over 32 shaded frames" in message
    assert "halton_jitter(index // 2, ratio)" in message
    twice = jittered(lambda i: i) + jittered(lambda i: i)
    assert len(warnings_of_jitter(twice, validate)) == 2, "after a cut"


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("start", [0, 5, 17])
def test_jitter_that_counts_shaded_frames_is_fine(ratio: float, start: int) -> None:
    frames = jittered(lambda i: i // 2)
    own = [replace(f, jitter=halton_jitter(start + i // 2, ratio)) for i, f in enumerate(frames)]
    assert warnings_of_jitter(own) == []
    elsewhere = [replace(f, jitter=(0.4, 0.4)) if f.color is None else f for f in own]
    assert warnings_of_jitter(elsewhere) == [], "the jitter of frames that are not shaded is not used"


def test_motion_is_not_held_against_a_frame_that_it_does_not_lead_to() -> None:
    """A camera that shakes: between shaded frames, motion is to one that was not."""
    scene, handed_in = Plane(checker, (2.0, 1.0)), [0, 2, 1, 3, 2, 4, 3]
    frames = []
    for number, (index, before) in enumerate(zip(handed_in, [0, *handed_in], strict=False)):
        frame = scene.frame(index, (96, 54), halton_jitter(number, 2.0))
        motion = frame.motion * np.float32(index - before)
        color = frame.color if number % 2 == 0 else None
        frames.append(replace(frame, motion=motion, color=color, reset=number == 0))
    assert_fine(frames)


WITHOUT_EVIDENCE: dict[str, Callable[[Frame], Frame]] = {
    "black": lambda frame: replace(frame, color=np.asarray(frame.color) * 0),
    "all sky": lambda f: replace(f, color=np.ones_like(f.color), depth=f.depth * 0, motion=f.motion * 0),
    "noise": lambda f: replace(f, color=np.random.default_rng(0).random((*f.depth.shape, 3), np.float32)),
    "one pixel": lambda f: replace(f, **{k: getattr(f, k)[:1, :1] for k in ("color", "depth", "motion")}),
    "not shaded": lambda frame: replace(frame, color=None),
}


@pytest.mark.parametrize("change", WITHOUT_EVIDENCE.values(), ids=WITHOUT_EVIDENCE)
def test_images_without_evidence_pass(frames: list[Frame], change: Callable[[Frame], Frame]) -> None:
    assert_fine([change(frame) for frame in frames])


@pytest.mark.parametrize(
    ("overrides", "field", "hint"),
    [
        ({"motion_unit": "ndc"}, "motion", "motion_unit='ndc'"),
        ({"motion_unit": "uv"}, "motion", "motion_unit='uv'"),
        ({"motion_flip_y": True}, "motion", "motion_flip_y=True"),
        ({"motion_direction": "current_minus_previous"}, "motion", "direction='current_minus_previous'"),
        ({"motion_jittered": True}, "motion", "motion_jittered=True"),
        ({"motion_scale": (0.5, 0.5)}, "motion", "motion_scale=(0.5, 0.5)"),
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
    said = complaints(*misread(frames, **overrides), validate="strict")
    assert said.startswith(f"frame.{field} ")
    assert hint in said


def with_pixel(frame: Frame, field: str, value: float) -> Frame:
    array = getattr(frame, field).copy()
    array[7, 5] = value
    return replace(frame, **{field: array})


def rest(count: int, **overrides: Any) -> list[Frame]:
    """Frames whose jitter changes in the first four and then stays; nothing moves."""
    still = np.zeros((18, 32, 2), np.float32)
    jitters = [halton_jitter(index, 2.0) for index in range(4)] + [(0.0, 0.0)] * count
    return [noise(1, jitter=jitter, motion=still, **overrides) for jitter in jitters]


def test_jitter_that_stops_while_nothing_moves_is_warned_of_once() -> None:
    (message,) = complaints(*rest(40)).splitlines()
    assert "frame.jitter is (0.0, 0.0) in 8 frames in which nothing moved" in message
    assert "halton_jitter" in message
    (never_changed,) = complaints(*rest(40)[4:]).splitlines()
    assert "in 3 consecutive frames" in never_changed
    moving = np.full((18, 32, 2), 0.1, np.float32)
    for frames, options in (
        (rest(7), {}),
        (rest(40), {"converges": False}),
        (rest(40), {"display": (32, 18)}),  # frames of ratio 1 may be anti-aliased already
        ([replace(frame, motion=moving) for frame in rest(40)], {}),
    ):
        assert complaints(*frames, **options) == ""


@pytest.mark.parametrize(("method", "warns"), [("taau", True), ("taa", False)])
def test_an_upscaler_warns_of_jitter_that_stops_if_its_method_converges(method: str, warns: bool) -> None:
    with Upscaler(method, display_size=(64, 36)) as upscaler, warnings.catch_warnings(record=True) as caught:
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


@pytest.mark.parametrize("vector", [(5000.0, -300.0), (20.0, 15.0), (np.nan, np.inf)])
def test_motion_across_a_cut_is_not_checked(vector: tuple[float, float]) -> None:
    """Motion vectors after a teleport lead to the place of the old camera, or are not numbers."""
    motion = np.full((HEIGHT, WIDTH, 2), vector, np.float32)
    frames = [plain_frame(jitter=halton_jitter(i, 2.0), motion=motion, reset=i == 2) for i in (2, 3)]
    assert complaints(frames[0], validate="strict") == ""
    assert "frame.motion is " in complaints(frames[1], validate="strict")


def test_a_refused_frame_leaves_the_checker_as_it_was(frames: list[Frame]) -> None:
    checker = FrameChecker("strict")
    checker.check(frames[0], DISPLAY)
    for wrong in (with_pixel(frames[3], "motion", np.nan), replace(frames[1], motion=-frames[1].motion)):
        with pytest.raises(FrameError):
            checker.check(wrong, DISPLAY)
    for frame in frames[1:]:
        checker.check(frame, DISPLAY)  # frames[1] is compared with frames[0]


def test_the_checker_keeps_no_buffer_of_the_caller(frames: list[Frame]) -> None:
    names = ("color", "depth", "motion")
    buffers: dict[str, Any] = {name: np.array(getattr(frames[0], name)) for name in names}
    checker = FrameChecker("strict")
    for frame in frames:
        for name, buffer in buffers.items():
            buffer[:] = getattr(frame, name)
        checker.check(replace(frame, **buffers), DISPLAY)


@pytest.mark.parametrize("exposure", [1e30, 1e-20])
def test_an_exposure_outside_the_usable_range_is_reported(exposure: float) -> None:
    assert complaints(noise(0, exposure=1e6), validate="strict") == ""
    said = complaints(noise(0, exposure=exposure), validate="strict")
    assert re.search(r"exposure is 1e.*want 6e-08 to 1.7e", said)


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
    [message] = complaints(replace(frames[0], color=shown)).splitlines()
    assert f"frame.color is never above {scale}, and as bright as a displayed image" in message
    assert complaints(replace(frames[0], color=scale * color / color.max())) == ""


# --- thresholds of the checks of G-buffers: no warning just below each ---


PIXELS = WIDTH * HEIGHT
SLOPE = (0.1 + 0.004 * np.broadcast_to(np.arange(WIDTH), (HEIGHT, WIDTH))).astype(np.float32)


def complaint(
    name: str, array: Float32, depth: Float32 | None = None, jitter: tuple[float, float] = (0.0, 0.0)
) -> str:
    """Return the warning about a frame with this buffer; "" for none."""
    place = GBUFFERS[name]
    fields: dict[str, Any] = {place.group: {place.key: array}}
    frame = plain_frame(depth=SLOPE if depth is None else depth, jitter=jitter, **fields)
    return complaints(frame, validate="strict", gbuffers=[name])


def share_of(value: float, share: float, fill: float = 0.5) -> Float32:
    """(h, w) of `fill`, a share of it another value."""
    made = np.full(PIXELS, fill, np.float32)
    made[: round(share * PIXELS)] = value
    return made.reshape(HEIGHT, WIDTH)


@pytest.mark.parametrize(("value", "share", "found"), [
    (1.0, 1.0, False), (0.0, 1.0, False), (1.0005, 1.0, False), (-0.0005, 1.0, False),
    (1.002, 0.009, False), (1.002, 0.011, True), (-0.002, 0.011, True),
])  # fmt: skip
def test_fractions_are_in_0_to_1_but_for_a_hundredth(value: float, share: float, found: bool) -> None:
    assert ("outside [0, 1]" in complaint("gbuffer_roughness", share_of(value, share))) is found


@pytest.mark.parametrize(("value", "fill", "found"), [
    (255.0, 0.0, True), (3.0, 0.0, True), (2.5, 0.0, False), (2.0, 0.0, False), (-3.0, 3.0, False),
])  # fmt: skip
def test_whole_numbers_are_taken_for_bytes(value: float, fill: float, found: bool) -> None:
    said = complaint("gbuffer_metallic", share_of(value, 0.5, fill))
    assert ("bytes" in said) is found
    assert f"from 0 to {value:.0f}" in said or not found


def normals(length: float, share: float = 1.0) -> Float32:
    """Normals that face the eye, a share of them of another length; some sky."""
    along = share_of(length, share, fill=1.0)
    along[-1] = 0.0
    return np.stack([0 * along, 0.6 * along, 0.8 * along], axis=-1)


@pytest.mark.parametrize(("length", "share", "found"), [
    (1.0, 1.0, False), (1.04, 1.0, False), (0.96, 1.0, False), (0.04, 1.0, False),
    (1.06, 0.5, True), (0.94, 0.5, True), (0.06, 0.5, True), (1.5, 0.009, False), (1.5, 0.011, True),
])  # fmt: skip
def test_normals_are_of_length_1_or_0_but_for_a_twentieth(length: float, share: float, found: bool) -> None:
    assert ("neither 1 nor 0" in complaint("gbuffer_normal", normals(length, share))) is found


def test_infinities_of_both_signs_in_one_pixel_are_reported_without_a_warning_of_numpy() -> None:
    bad = normals(1.0)
    bad[5, 6] = np.inf, -np.inf, 0.0
    assert "first at (x=6, y=5)" in complaint("gbuffer_normal", bad)


def test_normals_in_colours_are_recognised() -> None:
    encoded = 0.5 * normals(1.0) + 0.5
    assert "2 * normal - 1" in complaint("gbuffer_normal", encoded)
    encoded[:20] = 0.0
    assert "2 * normal - 1" in complaint("gbuffer_normal", encoded), "the sky is not encoded"
    shorter = 0.5 * normals(0.8) + 0.5
    assert "2 * normal - 1" not in complaint("gbuffer_normal", shorter)
    assert "neither 1 nor 0" in complaint("gbuffer_normal", shorter)


def doubled(depth: Float32) -> Float32:
    return np.kron(depth, np.ones((2, 2), np.float32))


@pytest.mark.parametrize(
    ("scale", "found"), [(1.0, False), (1.2, False), (0.82, False), (1.3, True), (0.78, True)]
)
def test_depth_of_display_size_is_in_the_unit_of_the_frames(scale: float, found: bool) -> None:
    said = complaint("gbuffer_display_depth", (scale * doubled(SLOPE)).astype(np.float32))
    assert ("times frame.depth" in said) is found
    if found:
        assert f"{scale:.3g} times" in said


def test_a_distance_grows_where_depth_falls() -> None:
    assert "a distance: it grows" in complaint("gbuffer_display_depth", np.float32(0.03) / doubled(SLOPE))
    unrelated = np.exp(np.random.default_rng(0).uniform(-0.7, 0.7, SLOPE.shape)).astype(np.float32)
    assert "distance: it" not in complaint("gbuffer_display_depth", np.float32(0.2) * doubled(unrelated))
    flat = np.full((HEIGHT, WIDTH), 0.3, np.float32)
    assert "distance: it" not in complaint("gbuffer_display_depth", np.float32(0.09) / doubled(flat), flat)


def test_depths_are_compared_where_both_have_surfaces() -> None:
    sky = np.where(np.arange(HEIGHT)[:, None] < 40, np.float32(0.0), SLOPE)
    assert complaint("gbuffer_display_depth", doubled(SLOPE), sky) == ""
    assert complaint("gbuffer_display_depth", doubled(sky), SLOPE) == ""
    assert "3 times" in complaint("gbuffer_display_depth", np.float32(3.0) * doubled(SLOPE), sky)


@pytest.mark.parametrize("jitter", [(0.5, 0.0), (0.0, 0.5), (-0.5, -0.5)])
def test_samples_on_the_border_of_a_pixel_are_read_in_the_image(jitter: tuple[float, float]) -> None:
    assert complaint("gbuffer_display_depth", doubled(SLOPE), jitter=jitter) == ""


def test_the_hint_of_a_nan_depends_on_the_buffer() -> None:
    bad = doubled(SLOPE)
    bad[3, 4] = np.nan
    assert "Is it a distance?" in complaint("gbuffer_display_depth", bad)
    assert "Clear the target to 0" in complaint("gbuffer_roughness", share_of(np.nan, 0.1))


def test_depth_is_0_at_the_sky_and_never_less() -> None:
    sky = doubled(SLOPE)
    sky[:20] = 0.0
    assert complaint("gbuffer_display_depth", sky) == ""
    sky[5, 7] = -1e-3
    assert "negative, as small as -0.001" in complaint("gbuffer_display_depth", sky)


@pytest.mark.parametrize("jitter", [(0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4)])
def test_depths_are_compared_where_the_samples_lie(jitter: tuple[float, float]) -> None:
    """One of two display pixels has the sample's depth: the one that its jitter's sign puts it in."""
    axis = 0 if jitter[1] else 1
    own = np.arange(2 * (HEIGHT, WIDTH)[axis]) % 2 == int(sum(jitter) > 0.0)
    mask = own[:, None] if axis == 0 else own[None]
    display = np.where(mask, doubled(SLOPE), np.float32(3.0) * doubled(SLOPE)).astype(np.float32)
    assert complaint("gbuffer_display_depth", display, jitter=jitter) == ""
    assert "3 times" in complaint("gbuffer_display_depth", display, jitter=(-jitter[0], -jitter[1]))
