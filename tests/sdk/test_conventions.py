"""Tests of `Conventions`: round trips over all fields, numbers computed by hand, refused values."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supersampler import ArgumentError, FrameError, jittered_projection
from supersampler.conventions import PRESETS, Conventions, RawFrame
from supersampler.conventions.encodings import DepthKind
from supersampler.frame import Float32, Frame, Size

KINDS: list[DepthKind] = ["reversed_infinite", "reversed", "forward_infinite", "forward", "linear"]
NEAR, FAR = 0.1, 100.0


PLAIN: dict[str, Any] = {
    "color": np.ones((2, 3, 3), np.float32),
    "depth": np.full((2, 3), 0.5, np.float32),
    "motion": np.zeros((2, 3, 2), np.float32),
    "jitter": (0.0, 0.0),
}
ARRAYS = "color", "depth", "motion"


def raw(**fields: Any) -> RawFrame:
    return RawFrame(**PLAIN | fields)


@st.composite
def any_conventions(draw: st.DrawFn) -> Conventions:
    depth = draw(st.sampled_from(KINDS))
    scale = st.sampled_from([1.0, -1.0, 0.5, 320.0])
    return Conventions(
        motion_unit=draw(st.sampled_from(["pixels", "uv", "ndc"])),
        motion_scale=(draw(scale), draw(scale)),
        motion_direction=draw(st.sampled_from(["previous_minus_current", "current_minus_previous"])),
        motion_next_direction=draw(st.sampled_from(["next_minus_current", "current_minus_next"])),
        motion_flip_y=draw(st.booleans()),
        motion_resolution=draw(st.sampled_from(["render", "display"])),
        motion_jittered=draw(st.booleans()),
        depth=depth,
        near=NEAR,
        far=FAR if depth in ("reversed", "forward") else None,
        jitter_unit=draw(st.sampled_from(["pixels", "uv", "ndc"])),
        jitter_sign=draw(st.sampled_from([1, -1])),
        jitter_flip_y=draw(st.booleans()),
        bottom_up=draw(st.booleans()),
        srgb=draw(st.booleans()),
    )


def make_frame(seed: int, size: Size, *, reset: bool = False) -> Frame:
    """A frame of noise with every field set; a tenth is sky, the rest from twice near to half of far."""
    random = np.random.default_rng(seed)
    w, h = size
    distance = random.uniform(2 * NEAR, FAR / 2, (h, w))
    depth = np.where(random.random((h, w)) < 0.1, 0.0, NEAR / distance).astype(np.float32)
    return Frame(
        color=random.random((h, w, 3), np.float32) * 4,
        depth=depth,
        motion=random.normal(0, 3, (h, w, 2)).astype(np.float32),
        motion_next=random.normal(0, 3, (h, w, 2)).astype(np.float32),
        jitter=(random.uniform(-0.49, 0.49), random.uniform(-0.49, 0.49)),
        reset=reset,
        exposure=1.5,
        pre_exposure=0.7,
        reactive=random.random((h, w), np.float32),
        gbuffer={"roughness": random.random((h, w), np.float32)},
        gbuffer_display={"depth": depth},
        aovs=random.random((h, w, 2), np.float32),
    )


def assert_same(got: Frame, want: Frame) -> None:
    assert got.color is not None
    assert want.color is not None
    np.testing.assert_allclose(got.color, want.color, rtol=2e-5, atol=1e-6)
    np.testing.assert_allclose(got.depth, want.depth, rtol=1e-5, atol=2e-7)
    np.testing.assert_array_equal(got.depth == 0, want.depth == 0)
    np.testing.assert_allclose(got.motion, want.motion, rtol=1e-5, atol=1e-5)
    if got.motion_next is not None:  # it is left out where vectors have jitter
        assert want.motion_next is not None
        np.testing.assert_allclose(got.motion_next, want.motion_next, rtol=1e-5, atol=1e-5)
    assert got.jitter == pytest.approx(want.jitter, abs=1e-9)
    assert (got.reset, got.exposure, got.pre_exposure) == (want.reset, want.exposure, want.pre_exposure)
    for name in ("reactive", "aovs"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))
    buffers, display = got.gbuffer or {}, got.gbuffer_display or {}
    np.testing.assert_array_equal(buffers["roughness"], (want.gbuffer or {})["roughness"])
    np.testing.assert_allclose(display["depth"], want.depth, rtol=1e-5, atol=2e-7)


@settings(deadline=None, max_examples=150)
@given(any_conventions(), st.integers(1, 9), st.integers(1, 9), st.integers(0, 99))
def test_a_sequence_survives_any_conventions(
    conventions: Conventions, width: int, height: int, seed: int
) -> None:
    display_size = (2 * width + 1, 2 * height + 1)
    there, back = conventions.converter(display_size=display_size), conventions.converter()
    for index in range(3):
        frame = make_frame(seed + index, (width, height), reset=index == 0)
        again = back.to_frame(there.from_frame(frame))
        assert_same(again, frame)
        assert (again.motion_next is None) == conventions.motion_jittered


@settings(deadline=None, max_examples=50)
@given(any_conventions())
def test_json_and_repr_keep_every_field(conventions: Conventions) -> None:
    text = json.dumps(conventions.to_json(), allow_nan=False)
    assert Conventions.from_json(json.loads(text)) == conventions
    assert eval(repr(conventions)) == conventions  # noqa: S307 - repr is documented to be the call


def test_numbers_of_numpy_are_plain_numbers() -> None:
    half: Any = np.float32(0.5)
    one: Any = np.int64(1)
    given = Conventions(depth="forward", near=half, far=one, motion_scale=(half, one), jitter_sign=-one)
    plain = Conventions(depth="forward", near=0.5, far=1.0, motion_scale=(0.5, 1.0), jitter_sign=-1)
    assert repr(given) == repr(plain)
    assert json.dumps(given.to_json()) == json.dumps(plain.to_json())


@pytest.mark.parametrize("name", PRESETS)
def test_presets_take_overrides_and_survive_json(name: str) -> None:
    preset = PRESETS[name]
    assert Conventions.from_json({"preset": name, "srgb": True}) == preset(srgb=True)
    conventions = preset(srgb=True, motion_scale=(2, -2))
    assert conventions == replace(preset(), srgb=True, motion_scale=(2.0, -2.0))
    assert Conventions.from_json(conventions.to_json()) == conventions


def test_default_conventions_copy_and_scale_nothing() -> None:
    frame = make_frame(0, (5, 3))
    raw = Conventions().converter().from_frame(frame)
    again = Conventions().converter().to_frame(raw)
    for name in ARRAYS:
        assert getattr(again, name) is getattr(frame, name)
    plain = RawFrame(color=raw.color, depth=raw.depth, motion=raw.motion)
    assert Conventions().converter().to_frame(plain).pre_exposure == 1.0


def one_pixel(conventions: Conventions, size: Size = (8, 4), **raw: Any) -> Frame:
    """Convert a frame whose pixels are all alike; a motion given is that of each pixel."""
    w, h = size
    depth = np.full((h, w), raw.pop("depth", 0.5), np.float32)
    motion = np.tile(np.array(raw.pop("motion", (0.0, 0.0)), np.float32), (h, w, 1))
    return conventions.converter().to_frame(RawFrame(depth=depth, motion=motion, **raw))


PROJECTION = np.array([[1.1, 0, 0, 0], [0, 1.9, 0, 0], [0, 0, 0, 0.1], [0, 0, -1.0, 0]])
NOW, BEFORE = np.array([0.4, -0.3, -2.0, 1.0]), np.array([0.1, 0.2, -2.5, 1.0])


def ndc(point: Any, jitter: tuple[float, float], size: Size) -> Any:
    clip = jittered_projection(PROJECTION, jitter, size) @ point
    return clip[:2] / clip[3]


def test_motion_of_a_projected_point_in_every_unit_is_the_same_pixels() -> None:
    size, still = (8, 4), (0.0, 0.0)
    difference = ndc(BEFORE, still, size) - ndc(NOW, still, size)
    pixels = difference * [size[0] / 2, -size[1] / 2]  # NDC y points up, pixels' y down
    for conventions, vector in (
        (Conventions(), pixels),
        (Conventions(motion_unit="uv"), pixels / size),
        (Conventions(motion_unit="ndc"), difference),
        (Conventions(motion_unit="ndc", motion_direction="current_minus_previous"), -difference),
        (Conventions(motion_unit="uv", motion_flip_y=True), pixels / size * [1, -1]),
        (Conventions(motion_scale=(0.5, 2.0)), pixels * [2.0, 0.5]),
    ):
        np.testing.assert_allclose(
            one_pixel(conventions, size, motion=vector).motion[0, 0], pixels, rtol=1e-5
        )


def test_fsr_wants_half_the_size_and_a_flip_for_ndc_where_its_readme_says_the_size() -> None:
    size = (8, 4)
    vector = ndc(BEFORE, (0, 0), size) - ndc(NOW, (0, 0), size)
    right = one_pixel(Conventions(motion_unit="ndc"), size, motion=vector).motion[0, 0]
    by_code = one_pixel(Conventions.fsr(motion_scale=(0.5 * 8, -0.5 * 4)), size, motion=vector).motion[0, 0]
    by_readme = one_pixel(Conventions.fsr(motion_scale=(8, 4)), size, motion=vector).motion[0, 0]
    np.testing.assert_allclose(by_code, right, rtol=1e-6)
    np.testing.assert_allclose(by_readme, right * [2, -2], rtol=1e-6)  # twice too long, upside down


def test_jittered_motion_leads_to_the_same_colour_in_the_jittered_image() -> None:
    """The image is a ramp that moves by (2, 1); a pixel's colour is the ramp at its centre + jitter."""
    x, y = np.meshgrid(np.arange(9.0), np.arange(7.0))

    def rendered(jitter: tuple[float, float], moved: tuple[float, float]) -> Any:
        return (x + jitter[0] - moved[0]) + 10 * (y + jitter[1] - moved[1])

    previous, current = (0.25, -0.375), (-0.5, 0.125)
    before, now = rendered(previous, (0, 0)), rendered(current, (2, 1))
    there = Conventions(motion_jittered=True).converter()
    depth, motion = np.ones((7, 9), np.float32), np.tile(np.array((-2, -1), np.float32), (7, 9, 1))
    there.from_frame(Frame(color=None, depth=depth, motion=motion, jitter=previous))
    raw = there.from_frame(Frame(color=None, depth=depth, motion=motion, jitter=current))
    ramp_at_past = before[3, 4] + raw.motion[3, 4, 0] + 10 * raw.motion[3, 4, 1]
    assert ramp_at_past == pytest.approx(now[3, 4], abs=1e-5)


def test_the_previous_jitter_is_in_pixels_of_its_own_size() -> None:
    converter = Conventions(motion_jittered=True).converter()
    for size in ((4, 4), (8, 8)):
        depth, motion = np.ones(size, np.float32), np.zeros((*size, 2), np.float32)
        frame = converter.to_frame(RawFrame(depth=depth, motion=motion, jitter=(0.25, 0.0)))
    np.testing.assert_allclose(frame.motion[0, 0], (0.25, 0.0))  # 0.5 then and 0.25 now, in pixels of now


def test_a_refused_frame_does_not_count_as_seen() -> None:
    converter = Conventions(motion_jittered=True).converter()
    depth, motion = np.ones((2, 2), np.float32), np.zeros((2, 2, 2), np.float32)
    good = RawFrame(depth=depth, motion=motion, jitter=(0.25, 0))
    converter.to_frame(good)
    with pytest.raises(FrameError, match="exposure"):
        converter.to_frame(replace(good, jitter=(0.5, 0.5), exposure=-1.0))
    np.testing.assert_array_equal(converter.to_frame(good).motion, 0.0)


@pytest.mark.parametrize(
    ("conventions", "jitter", "want"),
    [
        (Conventions(), (0.25, -0.125), (0.25, -0.125)),
        (Conventions(jitter_unit="uv"), (0.03125, -0.03125), (0.25, -0.125)),
        (Conventions(jitter_unit="ndc"), (0.0625, 0.0625), (0.25, -0.125)),
        (Conventions(jitter_flip_y=True), (0.25, 0.125), (0.25, -0.125)),
        (Conventions.fsr(), (-0.25, 0.125), (0.25, -0.125)),
        (Conventions.unity(), (0.25, -0.125), (0.25, -0.125)),
        (Conventions.unity(jitter_flip_y=True), (0.25, 0.125), (0.25, -0.125)),
        (Conventions.godot(), (-0.0625, 0.0625), (0.25, -0.125)),
        (Conventions.vtk(), (0.0625, 0.0625), (0.25, -0.125)),
        (Conventions(jitter_unit="ndc"), (np.float32(1 / 8) * 1.00001, 0.0), (0.5, 0.0)),
        (Conventions(), None, (0.0, 0.0)),
    ],
)
def test_jitter_is_where_the_sample_is(
    conventions: Conventions, jitter: Any, want: tuple[float, float]
) -> None:
    assert one_pixel(conventions, jitter=jitter).jitter == pytest.approx(want, abs=1e-12)


@pytest.mark.parametrize("kind", ["f8", ">f8", ">f4", ">f2", "g"])
def test_floats_of_any_kind_are_converted(kind: str) -> None:
    got = Conventions().converter().to_frame(raw(**{name: PLAIN[name].astype(kind) for name in ARRAYS}))
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(got, name), PLAIN[name])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"color": np.zeros((2, 3, 3), np.uint8)}, r"frame\.color is uint8; .* / 255"),
        ({"reactive": np.ones((2, 3), bool)}, r"reactive is bool; .* array\.astype\(np\.float32\)\.$"),
        ({"motion": np.zeros((4, 6, 2), np.float32)}, r"shape \(4, 6, 2\).*motion_resolution='display'"),
        ({"motion": np.zeros((4, 5, 2), np.float32)}, r"motion is of shape .*motion_resolution='display'"),
        ({"depth": np.ones((2, 3, 1), np.float32)}, r"depth is of shape \(2, 3, 1\).*Drop the last axis"),
        ({"jitter": (3.0, 0.0)}, r"frame\.jitter"),
    ],
)
def test_an_inconvertible_field_is_named(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(FrameError, match=message):
        Conventions().converter().to_frame(raw(**fields))


RENDER, DISPLAY = (3, 2), (6, 4)
JITTER = (0.4, -0.3)


def numbered(size: tuple[int, int]) -> Float32:
    """Vectors that say which pixel they are of: (column, row)."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.stack([x, y], axis=-1).astype(np.float32)


def frame(**fields: Any) -> Frame:
    return Frame(**PLAIN | fields)


def test_motion_of_display_size_is_read_where_the_samples_lie() -> None:
    """At ratio 2 the sample of column i lies in display column floor(2 (i + 0.5 + jitter))."""
    for unit, scale in (("uv", RENDER), ("pixels", (0.5, 0.5))):  # pixels of the display are half as long
        conventions = Conventions.from_json({"motion_resolution": "display", "motion_unit": unit})
        motion = numbered(DISPLAY) / np.array(scale, np.float32)
        got = conventions.converter().to_frame(raw(motion=motion, jitter=JITTER)).motion
        np.testing.assert_allclose(got[..., 0], [[1, 3, 5]] * 2, rtol=1e-6)
        np.testing.assert_allclose(got[..., 1], [[0] * 3, [2] * 3], rtol=1e-6)


def test_motion_of_display_size_is_written_from_the_sample_of_each_pixel() -> None:
    """Display column p looks at floor((p + 0.5) / 2 - jitter), rows likewise, within the frame."""
    conventions = Conventions(motion_resolution="display", motion_unit="uv")
    converter = conventions.converter(display_size=DISPLAY)
    got = np.asarray(converter.from_frame(frame(motion=numbered(RENDER), jitter=JITTER)).motion) * RENDER
    np.testing.assert_allclose(got[..., 0], [[0, 0, 0, 1, 1, 2]] * 4, rtol=1e-6)
    np.testing.assert_allclose(got[..., 1], [[0] * 6, [1] * 6, [1] * 6, [1] * 6], rtol=1e-6)


def test_a_jitter_of_half_a_pixel_survives_rounding_and_a_longer_one_is_refused() -> None:
    convert = Conventions().converter().to_frame
    assert convert(raw(jitter=(0.50005, -0.50005))).jitter == (0.5, -0.5)
    with pytest.raises(FrameError, match="jitter"):
        convert(raw(jitter=(0.502, 0.0)))


@pytest.mark.parametrize(("size", "previous"), [(RENDER, (0.1, 0.2)), ((6, 4), (0.2, 0.4))])
def test_a_skipped_frame_counts_for_the_next_frames_jitter(
    size: tuple[int, int], previous: tuple[float, float]
) -> None:
    """In pixels of its own size: 0.2 of a pixel half as large is 0.1."""
    converter = Conventions(motion_jittered=True, jitter_sign=-1).converter()
    converter.pass_over((-previous[0], -previous[1]), size)
    got = converter.to_frame(raw(jitter=(-0.4, 0.3)))
    np.testing.assert_allclose(got.motion, np.broadcast_to([-0.3, 0.5], (2, 3, 2)), rtol=1e-6)


DISTANCES = np.array([[0.2, 1.0, 5.0], [25.0, 100.0, 100.0]], np.float32)


@pytest.mark.parametrize(
    ("kind", "far", "stored"),
    [
        ("linear", FAR, DISTANCES),
        ("reversed", FAR, NEAR * (FAR - DISTANCES) / (DISTANCES * (FAR - NEAR))),
        ("forward", FAR, 1.0 - NEAR * (FAR - DISTANCES) / (DISTANCES * (FAR - NEAR))),
        ("reversed_infinite", None, NEAR / DISTANCES),
        ("forward_infinite", None, 1.0 - NEAR / DISTANCES),
    ],
)
def test_depth_becomes_near_over_distance_and_0_at_the_far_plane(
    kind: Any, far: Any, stored: Float32
) -> None:
    conventions = Conventions(depth=kind, near=NEAR, far=far)
    got = conventions.converter().to_frame(raw(depth=stored.astype(np.float32))).depth
    want = np.where((far or np.inf) > DISTANCES, NEAR / DISTANCES, 0.0)
    np.testing.assert_allclose(got, want, rtol=1e-4, atol=1e-6)
    back = conventions.converter().from_frame(frame(depth=want.astype(np.float32))).depth
    np.testing.assert_allclose(np.asarray(back), stored, rtol=1e-4, atol=1e-6)


def test_the_sky_has_no_distance_and_0_is_none_without_a_warning() -> None:
    sky, linear = np.zeros((2, 3), np.float32), Conventions(depth="linear", near=NEAR).converter()
    bounded = Conventions(depth="linear", near=NEAR, far=FAR).converter()
    assert np.isposinf(linear.from_frame(frame(depth=sky)).depth).all()
    assert (np.asarray(bounded.from_frame(frame(depth=sky)).depth) == FAR).all()
    assert not linear.to_frame(raw(depth=sky)).depth.any()  # 0 is not a distance of a surface
    assert not linear.to_frame(raw(depth=sky + np.inf)).depth.any()


def test_a_surface_beyond_the_far_plane_cannot_be_written_but_one_at_it_may_be_rounded() -> None:
    converter = Conventions(depth="reversed", near=NEAR, far=FAR).converter()
    depth = np.full((2, 3), NEAR / FAR, np.float32)
    depth[1] *= 1.0 - 5e-6
    np.testing.assert_allclose(np.asarray(converter.from_frame(frame(depth=depth)).depth), 0.0, atol=1e-6)
    depth[1, 2] = 0.99 * NEAR / FAR
    with pytest.raises(FrameError, match=r"frame\.depth is as small as .*, beyond the far plane"):
        converter.from_frame(frame(depth=depth))


def test_rows_are_turned_in_every_buffer_and_colours_decoded() -> None:
    rows = np.array([[0.04, 0.04, 0.04], [0.5, 0.5, 0.5]], np.float32)
    stored = raw(
        color=np.repeat(rows[..., None], 3, axis=2), depth=rows, motion=np.repeat(rows[..., None], 2, axis=2),
        aovs=rows[..., None], gbuffer={"roughness": rows}, gbuffer_display={"depth": rows},
    )  # fmt: skip
    got: Any = Conventions(bottom_up=True, srgb=True).converter().to_frame(stored)
    linear = [((0.5 + 0.055) / 1.055) ** 2.4, 0.04 / 12.92]
    np.testing.assert_allclose(got.color[:, 0, 0], linear, rtol=1e-5)
    for buffer in (got.depth, got.motion[..., 0], got.aovs[..., 0], got.gbuffer["roughness"]):
        np.testing.assert_allclose(buffer[:, 0], [0.5, 0.04])
    np.testing.assert_allclose(got.gbuffer_display["depth"][:, 0], [0.5, 0.04])


@pytest.mark.parametrize("shape", [(1, 5, 2), (4, 2, 2)])
def test_motion_smaller_than_the_frame_is_refused(shape: tuple[int, ...]) -> None:
    smaller = raw(motion=np.zeros(shape, np.float32))
    with pytest.raises(FrameError) as refused:
        Conventions().converter().to_frame(smaller)
    assert "motion_resolution" not in str(refused.value)
    with pytest.raises(FrameError, match="at least"):
        Conventions(motion_resolution="display").converter().to_frame(smaller)


@pytest.mark.parametrize("display", [(2, 4), (6, 1), None])
def test_a_display_smaller_than_the_frame_or_none_is_refused(display: tuple[int, int] | None) -> None:
    converter = Conventions(motion_resolution="display").converter(display_size=display)
    with pytest.raises(ArgumentError, match="display_size"):
        converter.from_frame(frame())


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"motion_unit": "texels"}, "motion_unit is 'texels'; want 'pixels', 'uv' or 'ndc'"),
        ({"motion_scale": (0.0, 1.0)}, "motion_scale is .*two finite numbers that are not 0"),
        ({"motion_scale": (1.0, 1.0, 1.0)}, "motion_scale"),
        ({"motion_jittered": 1}, "motion_jittered is 1; want True or False"),
        ({"srgb": 1}, "srgb"),
        ({"depth": "reversed"}, "far is None; want a distance.*reversed_infinite"),
        ({"depth": "forward"}, "far"),
        ({"near": 0.0}, "near is 0.0; want a finite distance > 0"),
        ({"near": -1.0}, "near"),
        ({"near": math.inf}, "near"),
        ({"far": 10.0}, "far is 10.0; want None, because depth is 'reversed_infinite'"),
        ({"depth": "reversed", "near": 1.0, "far": 1.0}, "far"),
        ({"depth": "reversed", "near": 1.0, "far": math.nan}, "far"),
        ({"jitter_sign": 0}, r"jitter_sign is 0; want \+1 or -1"),
        ({"preset": "unrael"}, "preset is 'unrael'; want one of supersampler, .* Did you mean 'unreal'"),
        ({"preset": ["unreal"]}, "preset is"),
        ({"jitter": "pixels"}, "conventions is given 'jitter'; want one of motion_unit"),
    ],
)
def test_a_wrong_field_is_named(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        Conventions.from_json(fields)


def test_the_command_line_and_the_docs_list_every_preset() -> None:
    docs = Path(__file__).parents[2] / "docs" / "conventions.md"
    own = {name for name, value in vars(Conventions).items() if isinstance(value, classmethod)}
    listed = re.findall(r"^\| `(\w+)` \|", docs.read_text().partition("## The presets")[2], re.MULTILINE)
    assert [*PRESETS] == listed
    assert {*PRESETS} - {"supersampler"} == {name for name in own if name not in ("from_json", "_preset")}
    assert all(preset() == getattr(Conventions, name, Conventions)() for name, preset in PRESETS.items())
