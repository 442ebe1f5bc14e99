"""Promises of the importers: other people's files come out as our Frames: sign, unit, order, all of it.

One scene is written in each layout by formulas of its own, with a sky, a jitter and a motion of whole pixels,
so that each frame can be found in the one before it by its motion, exactly.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from supersampler import ArgumentError, Frame, ShotError
from supersampler.conventions import Conventions
from supersampler.image_io import write_exr
from supersampler.shot import (
    Shot,
    copy_shot,
    import_arm,
    import_blender,
    import_channels,
    open_source,
)
from supersampler_model.data.analytic import Plane, checker

SIZE, DISPLAY_SIZE = (64, 36), (128, 72)
JITTER = (0.25, -0.375)
NEAR, DISTANCE = 0.1, 10.0  # of the plane, scene units
SKY_ROWS = 4
COUNT = 3
CUT = 2
SCENE = Plane(checker, (2.0, -1.0))  # it moves right and up: its past is at (-2, +1)
PAST = (-2, 1)
MAP = {"color": ["R", "G", "B"], "depth": "depth.V", "motion": ["motion/*.exr:R", "motion/*.exr:G"]}


def color(index: int) -> np.ndarray:
    picture = SCENE.frame(index, SIZE, JITTER).color
    assert picture is not None
    return picture


def distance() -> np.ndarray:
    """View distance of each pixel, (h, w); inf at the sky."""
    pixels = np.full(SIZE[::-1], DISTANCE, np.float32)
    pixels[:SKY_ROWS] = np.inf
    return pixels


def plane(value: float, size: tuple[int, int] = SIZE) -> np.ndarray:
    return np.full(size[::-1], value, np.float32)


def truth(index: int) -> np.ndarray:
    return SCENE.truth(index, DISPLAY_SIZE, 1)


def assert_is_the_scene(shot: Shot) -> None:
    """All frames are the scene's, in our conventions, however they were stored."""
    assert (len(shot), shot.render_size) == (COUNT, SIZE)
    before: Frame | None = None
    for index, item in enumerate(shot):
        frame = item.frame
        assert frame.color is not None
        np.testing.assert_allclose(frame.color, color(index), atol=1e-3)
        assert frame.jitter == pytest.approx(JITTER)
        assert frame.reset == (index in (0, CUT))
        assert (frame.depth[:SKY_ROWS] == 0).all()
        np.testing.assert_allclose(frame.depth[SKY_ROWS:], NEAR / DISTANCE, rtol=1e-4)
        if before is not None and before.color is not None:
            past = np.rint(frame.motion).astype(int)
            np.testing.assert_allclose(frame.motion, past, atol=1e-4)
            rows, columns = np.mgrid[8:28, 8:56]
            found = before.color[rows + past[8:28, 8:56, 1], columns + past[8:28, 8:56, 0]]
            np.testing.assert_allclose(found, frame.color[8:28, 8:56], atol=1e-3)
        before = frame


def assert_same_shot(copy: Shot, shot: Shot) -> None:
    assert copy.reference_indices == shot.reference_indices
    for a, b in zip(copy, shot, strict=True):
        for name in ("color", "depth", "motion"):
            np.testing.assert_array_equal(getattr(a.frame, name), getattr(b.frame, name))
        assert (a.frame.jitter, a.frame.reset, a.frame.exposure) == (
            b.frame.jitter,
            b.frame.reset,
            b.frame.exposure,
        )
        assert (a.reference is None) == (b.reference is None)


# --- Blender ---


def blender_frame(
    index: int, layer: str, depth: str = "Depth.Z", diffuse: str = "DiffCol"
) -> dict[str, np.ndarray]:
    """One multilayer frame: y of Vector points up, Z is the distance, 1e10 at the sky."""
    picture = color(index)
    return {
        **{f"{layer}.Combined.{axis}": picture[..., i].astype(np.float16) for i, axis in enumerate("RGB")},
        f"{layer}.Combined.A": plane(0.5),
        f"{layer}.{depth}": np.where(np.isinf(distance()), np.float32(1e10), distance()),
        f"{layer}.Vector.X": plane(PAST[0]),
        f"{layer}.Vector.Y": plane(-PAST[1]),
        f"{layer}.Vector.Z": plane(77),
        f"{layer}.Vector.W": plane(77),
        **{f"{layer}.Normal.{axis}": plane(i) for i, axis in enumerate("XYZ")},
        **{f"{layer}.{diffuse}.{axis}": plane(0.25 * i) for i, axis in enumerate("RGB")},
    }


def write_blender(folder: Path, *layers: str, **names: str) -> Path:
    for index in range(COUNT):
        frame: dict[str, np.ndarray] = {}
        for layer in layers:
            frame.update(blender_frame(index, layer, **names))
        write_exr(folder / f"kitchen_{index + 8:04d}.exr", frame)  # 8, 9, 10
    write_exr(
        folder / "reference" / "0009.exr",
        {f"Top.Combined.{a}": truth(1)[..., i] for i, a in enumerate("RGB")},
    )
    (folder / "jitter.json").write_text(json.dumps([JITTER] * COUNT))
    return folder


@pytest.mark.parametrize(
    ("layer", "names"),
    [
        ("ViewLayer", {}),
        ("RenderLayer", {"depth": "Z"}),
        ("Interior.lights", {"diffuse": "Diffuse Color"}),
    ],
)
def test_blender_frames_come_out_as_ours(tmp_path: Path, layer: str, names: dict[str, str]) -> None:
    write_blender(tmp_path, layer, **names)
    shot = import_blender(tmp_path, cuts=[CUT], reference="reference/*.exr", frame_rate=25)
    assert_is_the_scene(shot)
    assert (shot.name, shot.frame_rate, shot.display_size) == (tmp_path.name, 25.0, DISPLAY_SIZE)
    assert shot.reference_indices == [1]
    item = shot.read(1)
    np.testing.assert_array_equal(item.reference, truth(1))
    gbuffer, carry = item.frame.gbuffer, item.frame.carry
    assert gbuffer is not None
    assert carry is not None
    assert carry.shape == (36, 64, 1)
    assert (carry == 0.5).all()
    np.testing.assert_array_equal(gbuffer["normal"][0, 0], [0, 1, 2])
    np.testing.assert_array_equal(gbuffer["base_color"][0, 0], [0, 0.25, 0.5])


def test_of_several_complete_layers_one_must_be_chosen(tmp_path: Path) -> None:
    write_blender(tmp_path, "A", "B")
    with pytest.raises(ArgumentError, match="layer is None; want one of A, B"):
        import_blender(tmp_path)
    with pytest.raises(ArgumentError, match="layer is 'C'; want one of A, B"):
        import_blender(tmp_path, layer="C")
    assert_is_the_scene(import_blender(tmp_path, layer="B", cuts=[CUT]))


def test_a_blender_file_without_motion_says_which_pass_to_turn_on(tmp_path: Path) -> None:
    write_exr(
        tmp_path / "0001.exr", {name: a for name, a in blender_frame(0, "V").items() if "Vector" not in name}
    )
    with pytest.raises(
        ShotError, match=r"0001\.exr: has no layer with all passes; it has V\.Com.*Turn on the passes"
    ):
        import_blender(tmp_path)


def test_without_a_jitter_file_there_is_no_jitter(tmp_path: Path) -> None:
    write_blender(tmp_path, "V")
    (tmp_path / "jitter.json").unlink()
    assert import_blender(tmp_path).read(1).frame.jitter == (0.0, 0.0)
    assert import_blender(tmp_path, jitter=[(0.0, 0.5)] * COUNT).read(1).frame.jitter == (0.0, 0.5)


@pytest.mark.parametrize("content", [[[0, 0]], [[0, 0]] * 4, [[0]] * 3, 3, {"a": 1}, ["ab", "cd", "ef"]])
def test_a_jitter_file_of_another_shape_is_refused(tmp_path: Path, content: object) -> None:
    write_blender(tmp_path, "V")
    (tmp_path / "jitter.json").write_text(json.dumps(content))
    with pytest.raises(ShotError, match=r"jitter\.json: holds .*; want \[x, y\] for each of 3 frames"):
        import_blender(tmp_path)
    with pytest.raises(ArgumentError, match="jitter is 1 pairs; want"):
        import_blender(tmp_path, jitter=[(0, 0)])


# --- a channel map ---


def write_channels(folder: Path, count: int = COUNT) -> Path:
    """Unreal's way: motion in a file of its own, NDC, y up, current minus previous; linear depth."""
    for index in range(count):
        picture = color(index)
        image = {axis: picture[..., i].astype(np.float16) for i, axis in enumerate("RGB")}
        write_exr(folder / f"{index:04d}.exr", {**image, "depth.V": distance(), "rough": plane(0.3)})
        motion = {"R": plane(-PAST[0] * 2 / SIZE[0]), "G": plane(PAST[1] * 2 / SIZE[1])}
        write_exr(folder / "motion" / f"{index:04d}.exr", motion)
    return folder


CONVENTIONS = Conventions.unreal(depth="linear", near=NEAR)
UNREAL_JITTER = [(-JITTER[0], -JITTER[1])] * COUNT


def test_a_channel_map_reads_anybodys_files(tmp_path: Path) -> None:
    write_channels(tmp_path)
    shot = import_channels(
        tmp_path,
        {**MAP, "roughness": "rough"},
        conventions=CONVENTIONS,
        jitter=UNREAL_JITTER,
        cuts=[CUT],
        name="ue",
    )
    assert_is_the_scene(shot)
    assert (shot.name, shot.conventions) == ("ue", CONVENTIONS)
    gbuffer = shot.read(2).frame.gbuffer
    assert gbuffer is not None
    assert (gbuffer["roughness"] == np.float32(0.3)).all()


def test_the_map_can_lie_in_the_folder(tmp_path: Path) -> None:
    write_channels(tmp_path)
    described = {"channels": MAP, "conventions": CONVENTIONS.to_json(), "frame_rate": 60, "cuts": [CUT]}
    (tmp_path / "channels.json").write_text(json.dumps(described))
    (tmp_path / "jitter.json").write_text(json.dumps(UNREAL_JITTER))
    shot = open_source(tmp_path)
    assert_is_the_scene(shot)
    assert shot.frame_rate == 60


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"conventions": {"depth": "deep"}}, r"channels\.json: will not do: depth is 'deep'; want"),
        (
            {"channels": {"color": ["R"]}},
            r"channels\.json: will not do: channel_map\['color'\] is \['R'\]; want 3",
        ),
        ({"channels": {"color": 3}}, r"channel_map\['color'\] is 3; want 3 channel names"),
        ({"channel": {}}, r'channels\.json: the file has the unknown key "channel"'),
        ({"cuts": ["a"]}, r"channels\.json: will not do: cuts is \['a'\]; want indices of frames, 0 to 0"),
    ],
)
def test_a_wrong_map_in_the_folder_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    write_channels(tmp_path, 1)
    described = {"channels": MAP, "conventions": {}, **change}
    (tmp_path / "channels.json").write_text(json.dumps(described))
    with pytest.raises(ShotError, match=message):
        open_source(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"colour": "R"}, "is a map with 'colour'; want one of color, depth, motion, base_color"),
        ({"motion": "X"}, r"channel_map\['motion'\] is 'X'; want 2 channel names"),
        (
            {"motion": ["X", "motion/*.exr:Y"]},
            r"is files of \*\.exr and motion/\*\.exr; want channels of one file",
        ),
        ({"depth": None}, "is a map without 'depth'; want depth and motion at least"),
    ],
)
def test_a_wrong_map_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    write_channels(tmp_path, 1)
    channel_map = {name: value for name, value in {**MAP, **change}.items() if value is not None}
    with pytest.raises(ArgumentError, match=message):
        import_channels(tmp_path, channel_map, conventions=CONVENTIONS)


def test_a_missing_channel_is_named_with_those_that_are_there(tmp_path: Path) -> None:
    write_channels(tmp_path, 1)
    with pytest.raises(ShotError, match=r"0000\.exr: has no channel Z\. It has R, G, B, rough, depth\.V"):
        import_channels(tmp_path, {**MAP, "depth": "Z"}, conventions=CONVENTIONS)


def test_a_gap_in_the_numbers_is_an_error(tmp_path: Path) -> None:
    write_channels(tmp_path, 5)
    (tmp_path / "0002.exr").unlink()
    with pytest.raises(ShotError, match=r"frame 2 between 0001\.exr and 0003\.exr is missing"):
        import_channels(tmp_path, MAP, conventions=CONVENTIONS)


def test_files_that_do_not_pair_up_are_named(tmp_path: Path) -> None:
    write_channels(tmp_path)
    (tmp_path / "motion" / "0002.exr").unlink()
    with pytest.raises(ShotError, match=r"frame 2 is among \*\.exr and not among motion/\*\.exr"):
        import_channels(tmp_path, MAP, conventions=CONVENTIONS)


def test_two_sequences_in_one_folder_are_told_apart_by_a_pattern(tmp_path: Path) -> None:
    write_channels(tmp_path)
    write_exr(tmp_path / "preview_0001.exr", {"Z": plane(0)})
    with pytest.raises(
        ShotError, match=r"has the same frame number as 0001\.exr. Choose one sequence by a pattern"
    ):
        import_channels(tmp_path, MAP, conventions=CONVENTIONS)


def test_a_frame_of_another_size_is_named(tmp_path: Path) -> None:
    write_channels(tmp_path)
    write_exr(tmp_path / "0001.exr", {name: plane(0, (8, 8)) for name in ("R", "G", "B", "depth.V")})
    shot = import_channels(tmp_path, MAP, conventions=CONVENTIONS)
    with pytest.raises(ShotError, match=r"0001\.exr: is 8x8; the shot says 64x36"):
        shot.read(1)


def test_references_of_other_numbers_are_refused(tmp_path: Path) -> None:
    write_channels(tmp_path)
    write_exr(tmp_path / "best" / "0003.exr", truth(0))
    channel_map = {**MAP, "reference": [f"best/*.exr:{axis}" for axis in "RGB"]}
    with pytest.raises(ShotError, match=r"no reference best/\*\.exr has the number of a frame, 0 to 2"):
        import_channels(tmp_path, channel_map, conventions=CONVENTIONS)
    write_exr(tmp_path / "best" / "0001.exr", truth(1))
    shot = import_channels(tmp_path, channel_map, conventions=CONVENTIONS)
    assert (shot.reference_indices, shot.display_size) == ([1], DISPLAY_SIZE)


def test_motion_of_display_size_is_read_from_its_own_file(tmp_path: Path) -> None:
    write_channels(tmp_path)
    for index in range(COUNT):
        motion = {"R": plane(2 * PAST[0], DISPLAY_SIZE), "G": plane(2 * PAST[1], DISPLAY_SIZE)}
        write_exr(tmp_path / "motion" / f"{index:04d}.exr", motion)
    conventions = Conventions(depth="linear", near=NEAR, motion_resolution="display")
    shot = import_channels(
        tmp_path, MAP, conventions=conventions, jitter=[JITTER] * COUNT, cuts=[CUT], display_size=DISPLAY_SIZE
    )
    assert_is_the_scene(shot)
    copy = copy_shot(shot, tmp_path / "copy")
    assert_is_the_scene(copy)
    assert_same_shot(copy, shot)


# --- Arm ---

TYPES = {"float16": "F16", "float32": "F32", "int32": "I32", "int64": "I64", "bool": "BOOL"}


def write_safetensors(path: Path, tensors: dict[str, np.ndarray]) -> Path:
    header: dict[str, Any] = {"__metadata__": {"Length": "3", "Version": "test"}}
    content = b""
    for name, array in tensors.items():
        data = np.ascontiguousarray(array).tobytes()
        offsets = [len(content), len(content) + len(data)]
        header[name] = {"dtype": TYPES[str(array.dtype)], "shape": array.shape, "data_offsets": offsets}
        content += data
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + content)
    return path


def arm_tensors(far: float = math.inf) -> dict[str, np.ndarray]:
    """Planes before rows; v before u; y before x; current minus previous; forward depth; ln of exposure."""
    finite = not math.isinf(far)
    p0 = far / (far - NEAR) if finite else 1 + 1e-7
    p1 = -far * NEAR / (far - NEAR) if finite else -NEAR - 1e-7
    device = np.minimum(p0 + p1 / distance(), 1).astype(np.float32)
    frames = range(COUNT)
    return {
        "colour_linear": np.stack([color(i).transpose(2, 0, 1) for i in frames]).astype(np.float16),
        "ground_truth_linear": np.stack([truth(i).transpose(2, 0, 1) for i in frames]).astype(np.float16),
        "motion_lr": np.stack([np.stack([plane(-PAST[1]), plane(-PAST[0])])] * COUNT).astype(np.float16),
        "depth": np.stack([device[None]] * COUNT),
        "depth_params": np.array([[p0, p1, 1.0, 0.5]] * COUNT, np.float32),
        "jitter": np.array([[[[JITTER[1]]], [[JITTER[0]]]]] * COUNT, np.float32),
        "exposure": np.log(np.array([[1.0], [2.0], [4.0]], np.float32)),
        "camera_cut": np.array([[False], [False], [True]]),
        "seq": np.array([[7]] * COUNT, np.int64),
        "EmulatedFramerate": np.array([[60.0]] * COUNT, np.float32),
    }


@pytest.mark.parametrize("far", [math.inf, 50.0])
def test_an_arm_sequence_comes_out_as_ours(tmp_path: Path, far: float) -> None:
    shot = import_arm(write_safetensors(tmp_path / "street.safetensors", arm_tensors(far)))
    assert_is_the_scene(shot)
    assert (shot.name, shot.frame_rate, shot.display_size) == ("street", 60.0, DISPLAY_SIZE)
    assert shot.reference_indices == [0, 1, 2]
    assert [item.frame.exposure for item in shot] == pytest.approx([1, 2, 4])
    reference = shot.read(1).reference
    assert reference is not None
    assert reference.dtype == np.float32
    np.testing.assert_allclose(reference, truth(1), atol=1e-3)


def test_an_arm_sequence_without_the_optional_tensors_is_read(tmp_path: Path) -> None:
    tensors = arm_tensors()
    for name in ("ground_truth_linear", "exposure", "seq", "EmulatedFramerate"):
        del tensors[name]
    shot = import_arm(write_safetensors(tmp_path / "a.safetensors", tensors))
    assert_is_the_scene(shot)
    assert (shot.display_size, shot.reference_indices, shot.read(0).frame.exposure) == (None, [], None)


def test_a_change_of_sequence_is_a_cut(tmp_path: Path) -> None:
    tensors = {**arm_tensors(), "seq": np.array([[1], [1], [2]], np.int64)}
    del tensors["camera_cut"]
    assert_is_the_scene(import_arm(write_safetensors(tmp_path / "a.safetensors", tensors)))


def test_pixels_are_left_in_the_file_until_their_frame_is_read(tmp_path: Path) -> None:
    shot = import_arm(write_safetensors(tmp_path / "a.safetensors", arm_tensors()))
    raw = shot.read_raw(1)
    for array in (raw.color, raw.motion):
        assert isinstance(array, np.ndarray)
        base: object = array
        while isinstance(base, np.ndarray):
            assert not isinstance(base, np.memmap)  # a copy of one frame, not a view that keeps the file
            base = base.base


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"jitter": None}, "has no tensor jitter. It has EmulatedFramerate, camera_cut, colour_linear"),
        ({"motion_lr": np.zeros((3, 2, 36, 63), np.float16)}, r"tensor motion_lr is \(3, 2, 36, 63\); want"),
        (
            {"depth_params": np.zeros((3, 3), np.float32)},
            r"tensor depth_params is \(3, 3\); want \(frames, 4\)",
        ),
        ({"colour_linear": np.zeros((3, 36, 64), np.float16)}, r"tensor colour_linear is \(3, 36, 64\)"),
    ],
)
def test_a_tensor_that_is_missing_or_of_another_shape_is_named(
    tmp_path: Path, change: dict[str, np.ndarray | None], message: str
) -> None:
    tensors = {name: value for name, value in {**arm_tensors(), **change}.items() if value is not None}
    with pytest.raises(ShotError, match=message):
        import_arm(write_safetensors(tmp_path / "a.safetensors", tensors))


@pytest.mark.parametrize(
    ("kept", "message"),
    [
        (4, "is not a safetensors file"),
        (100, "ends in its header"),
        (-10, r"tensor that cannot be read \(bytes"),
    ],
)
def test_a_safetensors_file_that_is_cut_off_is_named(tmp_path: Path, kept: int, message: str) -> None:
    path = write_safetensors(tmp_path / "a.safetensors", arm_tensors())
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(ShotError, match=rf"a\.safetensors: .*{message}.*damaged or cut off"):
        import_arm(path)


# --- whatever it is ---


def test_the_layout_is_guessed_from_what_is_there(tmp_path: Path) -> None:
    blender = open_source(write_blender(tmp_path / "blender", "V"), cuts=[CUT])
    channels = open_source(
        write_channels(tmp_path / "channels"), layout="channels", channel_map=MAP, conventions=CONVENTIONS,
        jitter=UNREAL_JITTER, cuts=[CUT],
    )  # fmt: skip
    arm = open_source(write_safetensors(tmp_path / "arm.safetensors", arm_tensors()))
    for shot in (blender, channels, arm):
        assert_is_the_scene(shot)
        copy_shot(shot, tmp_path / "copies" / shot.name)
        for path in (shot.name, f"{shot.name}/shot.json"):
            copy = open_source(tmp_path / "copies" / path)
            assert_is_the_scene(copy)
            assert_same_shot(copy, shot)


def test_what_cannot_be_guessed_is_answered_with_what_was_found(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match=r"nowhere: there is no such file or folder\. Known are"):
        open_source(tmp_path / "nowhere")
    with pytest.raises(ShotError, match="holds nothing"):
        open_source(tmp_path)
    for index in range(10):
        (tmp_path / f"{index}.txt").write_text("")
    with pytest.raises(
        ShotError, match=r"holds 0\.txt, .*, 7\.txt and 2 more\. Known are a folder with shot\.json"
    ):
        open_source(tmp_path)
    with pytest.raises(ShotError, match="is neither a folder nor"):
        open_source(tmp_path / "0.txt")
    write_exr(tmp_path / "a_1.exr", {"R": plane(0), "Z": plane(1)})
    with pytest.raises(ShotError, match=r"holds EXR frames with the channels R, Z\. A channels\.json says"):
        open_source(tmp_path)
    with pytest.raises(
        ArgumentError, match="layout is 'exr'; want one of auto, shot, blender, channels, arm"
    ):
        open_source(tmp_path, layout="exr")  # type: ignore[arg-type]
