"""Tests of `detect_conventions` on the shipped shot: each wrong convention is found or called uncertain."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from compact_frames import cropped
from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.jitter import halton_jitter
from supersampler.errors import ArgumentError, FrameError
from supersampler.frame import Frame
from supersampler.io.shot import Shot
from supersampler.validation import Detection, detect_conventions
from supersampler.validation.probe import FrameProbe
from supersampler.validation.rankings import Verdict, rank_depth
from supersampler_model.data.scenes.analytic import Plane, checker

FIELDS = (
    "motion_unit", "motion_direction", "motion_flip_y", "motion_jittered",
    "jitter_unit", "jitter_sign", "jitter_flip_y", "motion_resolution",
)  # fmt: skip
MOTION_READINGS: list[dict[str, Any]] = [
    {
        "motion_unit": unit, "motion_direction": way, "motion_flip_y": flip,
        "motion_jittered": flip == (way == "current_minus_previous"),
    }
    for unit, way, flip in product(
        ("pixels", "uv", "ndc"), ("previous_minus_current", "current_minus_previous"), (False, True)
    )
]  # fmt: skip
"""Every two values of different fields occur together, as in JITTER_READINGS."""
JITTER_READINGS: list[dict[str, Any]] = [
    {"jitter_unit": unit, "jitter_sign": sign, "jitter_flip_y": (sign < 0) == (unit == "ndc")}
    for unit, sign in product(("pixels", "uv", "ndc"), (1, -1))
]
DEPTH_READINGS: list[dict[str, Any]] = [
    {"depth": "reversed", "far": 100.0}, {"depth": "forward", "far": 100.0},
    {"depth": "forward_infinite"}, {"depth": "linear"},
    {"depth": "linear", "far": 1e10}, {"depth": "linear", "far": 1000.0},
]  # fmt: skip
PAN = Plane(checker, (2.0, 1.0))
PRESETS = ["fsr", "xess", "streamline", "unreal", "unity", "godot", "blender", "arm_gym"]


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    shot = Shot.open("plaza")
    return [cropped(shot.read(index).frame, 288, 162) for index in range(12, 16)]


def planted(frames: list[Frame], conventions: Conventions) -> list[RawFrame]:
    converter = conventions.converter(display_size=(576, 324))
    return [converter.from_frame(frame) for frame in frames]


def assert_found(detection: Detection, conventions: Conventions) -> None:
    assert all(verdict.certain for verdict in detection.verdicts), detection.summary()
    for name in FIELDS:
        assert getattr(detection.conventions, name) == getattr(conventions, name), detection.summary()
    assert detection.conventions.depth.split("_")[0] == conventions.depth.split("_")[0]
    assert eval(detection.call) == detection.conventions  # noqa: S307 - it is promised to be an expression


def still(image: Any, **fields: Any) -> RawFrame:
    """A frame of a card at rest."""
    shape = image.shape[:2]
    plain: dict[str, Any] = {
        "color": image.astype(np.float32),
        "depth": np.full(shape, 0.5, np.float32),
        "motion": np.zeros((*shape, 2), np.float32),
    }
    return RawFrame(**{**plain, **fields})


@pytest.mark.parametrize(
    "conventions",
    [
        *(Conventions(**reading) for reading in (*MOTION_READINGS, *JITTER_READINGS, *DEPTH_READINGS)),
        *(
            Conventions(motion_jittered=True, jitter_sign=sign, jitter_flip_y=flip)
            for sign, flip in product((1, -1), (False, True))
        ),
        Conventions(motion_resolution="display", motion_unit="ndc"),
        *(getattr(Conventions, name)() for name in PRESETS),
    ],
    ids=repr,
)
def test_conventions_are_found_with_nothing_stated(frames: list[Frame], conventions: Conventions) -> None:
    assert_found(detect_conventions(planted(frames, conventions)), conventions)


def test_a_shot_matches_its_description() -> None:
    detection = detect_conventions(Shot.open("plaza"), frames=4)
    assert detection.agrees, detection.summary()
    assert "as stated" in detection.summary()
    assert all(verdict.certain for verdict in detection.verdicts)


def test_stated_conventions_stand_without_visible_planes(frames: list[Frame]) -> None:
    stated = Conventions(depth="forward", near=0.1, far=100.0, motion_flip_y=True)
    wrong = replace(stated, motion_flip_y=False)
    detection = detect_conventions(planted(frames, stated), conventions=wrong)
    assert detection.conventions == stated
    assert not detection.agrees
    assert "Write: Conventions(motion_flip_y=True, depth='forward', far=100.0)" in detection.summary()


def test_a_still_scene_tells_jitter_but_not_motion(frames: list[Frame]) -> None:
    """One wide ramp with dots on it, sampled where the jitter says, and nothing moves."""
    y, x = np.mgrid[0:72, 0:128]
    raws = []
    for a, b in (frame.jitter for frame in frames):
        light = 1.2 + np.sin((x + a) / 2.1) + np.cos((y + b) / 1.7) * 0.2
        raws.append(still(np.repeat(light[..., None], 3, axis=2), jitter=(-a, -b)))
    detection = detect_conventions(raws)
    assert detection.conventions == Conventions(jitter_sign=-1)
    assert [verdict.certain for verdict in detection.verdicts] == [False, True, False]
    assert "motion: cannot tell, too few pixels move" in detection.summary()
    assert "depth: cannot tell" in detection.summary()


def test_without_jitter_or_light_it_cannot_tell(frames: list[Frame]) -> None:
    raws = planted(frames, Conventions())
    fixed = [replace(raw, jitter=(0.25, 0.0)) for raw in raws]
    detection = detect_conventions(fixed, conventions=Conventions(jitter_sign=-1))
    assert "jitter: cannot tell, it never changes" in detection.summary()
    assert detection.conventions.jitter_sign == -1  # as stated
    detection = detect_conventions([replace(raw, color=np.zeros_like(raw.color)) for raw in raws])
    assert detection.agrees
    assert "motion: cannot tell, no two neighbouring frames have enough texture" in detection.summary()


def test_vectors_that_leave_the_image_by_every_reading_are_no_evidence(frames: list[Frame]) -> None:
    far = [replace(frame, motion=frame.motion + np.float32(1e6)) for frame in frames]
    detection = detect_conventions(planted(far, Conventions()))
    assert detection.motion.reason == "no reading gives vectors that stay in the image"
    assert not detection.agrees


def test_exchanged_axes_are_noted(frames: list[Frame]) -> None:
    raws = planted(frames, Conventions())
    motion = [replace(raw, motion=raw.motion[..., ::-1]) for raw in raws]
    jitter = [replace(raw, jitter=raw.jitter[::-1]) for raw in raws if raw.jitter is not None]
    for exchanged, note in ((motion, "motion[..., ::-1]"), (jitter, "frame.jitter is (y, x)")):
        detection = detect_conventions(exchanged)
        assert note in detection.summary()
        assert not detection.agrees


def test_cleared_depth_is_a_mistake_where_motion_shows_several_depths(frames: list[Frame]) -> None:
    raws = [replace(raw, depth=np.zeros_like(raw.depth)) for raw in planted(frames, Conventions())]
    detection = detect_conventions(raws)
    assert detection.depth.text == "depth: cannot tell, it is the same everywhere"
    assert "frame.depth is the same everywhere, although" in detection.summary()
    assert "The frames have mistakes that Conventions do not describe" in detection.summary()
    assert not detection.agrees
    card = [replace(raw, motion=np.ones_like(raw.motion)) for raw in raws]
    assert "frame.depth" not in detect_conventions(card).summary()


def test_a_still_camera_with_a_noisy_thing_that_moves_has_no_exchanged_axes() -> None:
    """A reading whose vectors leave the image must not win by what is then not compared."""
    chance = np.random.default_rng(4)
    floor = np.kron(chance.random((45, 80)), np.ones((4, 4))).astype(np.float32)
    raws = []
    for index in range(4):
        light, motion = floor.copy(), np.zeros((*floor.shape, 2), np.float32)
        part = slice(40, 120), slice(20 + 6 * index, 140 + 6 * index)
        light[part], motion[part] = chance.random((80, 120), np.float32), (-6.0, 0.5)
        color, jitter = np.repeat(light[..., None], 3, axis=2), halton_jitter(index, 2.0)
        raws.append(still(color, motion=motion, jitter=jitter, reset=index == 0))
    assert "(y, x)" not in detect_conventions(raws).summary()


def test_frames_of_two_sizes_are_read_size_by_size() -> None:
    conventions, sizes = Conventions(motion_jittered=True), [(160, 90)] * 3 + [(96, 54)] * 3
    frames = [PAN.frame(i, size, halton_jitter(i, 2.0)) for i, size in enumerate(sizes)]
    detection = detect_conventions(planted(frames, conventions))
    assert detection.motion.certain
    assert detection.jitter.certain
    assert detection.conventions == conventions
    alternating = planted([frames[i] for i in (0, 1, 3, 4)], conventions)
    assert "three consecutive frames of one size" in detect_conventions(alternating).jitter.reason


def test_frames_that_are_all_reset_are_compared_and_it_is_noted() -> None:
    frames = [replace(PAN.frame(i, (96, 54), halton_jitter(i, 2.0)), reset=True) for i in range(2)]
    detection = detect_conventions(planted(frames, Conventions()))
    assert any(found.overrides["motion_jittered"] for found in detection.motion.ranked), "two cannot tell"
    assert any("frame.reset is True in 2 consecutive frames" in note for note in detection.notes)
    one = [frames[0], replace(frames[1], reset=False)]
    assert not any("frame.reset" in note for note in detect_conventions(planted(one, Conventions())).notes)


def test_one_frame_is_too_few(frames: list[Frame]) -> None:
    with pytest.raises(ArgumentError, match="shot is of length 1; want at least 2 frames"):
        detect_conventions(planted(frames[:1], Conventions()))


# --- the detector's parts: chosen frames, jitter readings, rankings ---


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("depth", np.ones((6, 8, 1))), ("depth", np.ones((0, 8))),
        ("motion", np.ones((6, 8))), ("motion", np.ones((6, 8, 3))), ("motion", np.ones((6, 7, 2))),
        ("color", np.ones((6, 8, 4))), ("color", np.ones((12, 16, 3))), ("color", np.ones((6, 8))),
        ("jitter", (0.1, 0.2, 0.3)), ("jitter", ("0.1", "0.2")), ("pre_exposure", 0.0), ("reset", "no"),
    ],
)  # fmt: skip
def test_a_bad_input_of_a_raw_frame_is_named(name: str, value: Any) -> None:
    with pytest.raises(FrameError) as caught:
        detect_conventions([still(np.ones((6, 8, 3)), **{name: value})] * 2)
    assert caught.value.name == name


def test_jitter_may_be_an_array_or_a_list(frames: list[Frame]) -> None:
    conventions = Conventions(jitter_sign=-1)
    for kind in (np.array, list):
        raws = [replace(each, jitter=kind(each.jitter)) for each in planted(frames, conventions)]  # type: ignore[arg-type]
        assert_found(detect_conventions(raws), conventions)


def seen(depth: Any = None) -> FrameProbe:
    """Return a frame of 80 x 60 pixels without texture."""
    depth = np.full((60, 80), 0.1) if depth is None else depth
    light, motion = np.ones((60, 80), np.float32), np.zeros((60, 80, 2), np.float32)
    return FrameProbe(light, depth.astype(np.float32), motion, (0.0, 0.0), False)


def depth_of(*depths: Any, stated: Conventions | None = None) -> Verdict:
    """Return the kind of depth of frames that have these."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return rank_depth([], [seen(depth) for depth in depths], stated or Conventions())


Y, X = np.mgrid[:60, :80]
SLOPE = 0.05 + 0.002 * X + 0.003 * Y
KINDS = {"reversed": SLOPE, "forward": 1.0 - SLOPE, "linear": 1.0 / SLOPE}
SKIES = {"reversed": 0.0, "forward": 1.0, "linear": 2e6}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sky", [False, True])
def test_planes_and_the_sky_tell_the_kind_of_depth(kind: str, sky: bool) -> None:
    depth = KINDS[kind].copy()
    depth[:10] = SKIES[kind] if sky else depth[:10]
    verdict = depth_of(KINDS[kind], depth, stated=Conventions(depth="linear"))
    assert verdict.certain is (sky or kind == "linear")
    if verdict.certain:
        assert verdict.ranked[0].overrides["depth"].startswith(kind)
        no_disocclusion, no_sky = 0.5, 0.5 * (not sky)
        assert verdict.ranked[0].error == pytest.approx(no_disocclusion + no_sky, abs=0.01)
    else:  # as it is for forward depth
        assert verdict.reason == "only its planes look reversed, which may be a parallel projection"


@pytest.mark.parametrize("kind", SKIES)
@pytest.mark.parametrize(("share", "certain"), [(0.0004, False), (0.0015, True)])
def test_a_thousandth_of_sky_tells_the_kind_of_depth(kind: str, share: float, certain: bool) -> None:
    card = np.where(X < 40, 0.3, 0.6)
    card.reshape(-1)[: round(share * card.size)] = SKIES[kind]
    verdict = depth_of(card)
    assert verdict.certain is certain
    assert not certain or verdict.ranked[0].overrides["depth"].startswith(kind)


@pytest.mark.parametrize(
    ("far", "written"), [(2e6, 2e6), (1e6, 1e6), (np.inf, None), (9e5, None), (3e38, 1e30)]
)
def test_the_sky_of_linear_depth_is_its_far_plane(far: float, written: float | None) -> None:
    depth = KINDS["linear"].copy()
    depth[:10] = far
    ranked = depth_of(depth, stated=Conventions(depth="forward", far=100.0)).ranked
    kinds = {found.overrides["depth"]: found.overrides["far"] for found in ranked}
    assert kinds == {"linear": written, "reversed_infinite": None, "forward": 100.0}


def test_coarse_depth_has_no_kind() -> None:
    coarse = 0.1 + 0.01 * (X * 32 // 80)
    verdict = depth_of(None, coarse, stated=Conventions(depth="linear"))
    assert verdict.overrides == {}, "it stays as stated"
    assert verdict.reason == "it has only 32 evenly spaced values"
