"""Tests of the importers and `open_source`: signs, units and order of the imported frames."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imported_scene import (
    CONVENTIONS,
    COUNT,
    CUT,
    DISPLAY_SIZE,
    JITTER,
    MAP,
    NEAR,
    PAST,
    UNREAL_JITTER,
    arm_tensors,
    assert_is_the_scene,
    assert_same_shot,
    blender_frame,
    plane,
    truth,
    write_blender,
    write_channels,
    write_safetensors,
)
from supersampler import ArgumentError, ShotError
from supersampler.conventions import Conventions
from supersampler.io.images import read_exr, read_header, write_exr
from supersampler.io.shot import Shot, copy_shot, import_arm, import_blender, import_channels, open_source
from upscale_runs import run


@pytest.mark.parametrize(
    ("layer", "names"),
    [("ViewLayer", {}), ("RenderLayer", {"depth": "Z"}), ("Interior.lights", {"diffuse": "Diffuse Color"})],
)
def test_blender_frames_come_out_as_ours(tmp_path: Path, layer: str, names: dict[str, str]) -> None:
    write_blender(tmp_path, layer, **names)
    shot = import_blender(tmp_path, cuts=[CUT], reference="reference/*.exr", frame_rate=25)
    assert_is_the_scene(shot)
    assert (shot.name, shot.frame_rate, shot.display_size) == (tmp_path.name, 25.0, DISPLAY_SIZE)
    assert shot.reference_indices == [1]
    item = shot.read(1)
    np.testing.assert_array_equal(item.reference, truth(1))
    gbuffer, aovs = item.frame.gbuffer, item.frame.aovs
    assert gbuffer is not None
    assert aovs is not None
    assert aovs.shape == (36, 64, 1)
    assert (aovs == 0.5).all()
    np.testing.assert_array_equal(gbuffer["normal"][0, 0], [0, 1, 2])
    np.testing.assert_array_equal(gbuffer["base_color"][0, 0], [0, 0.25, 0.5])


def test_passes_that_can_be_blended_and_metadata_stay_with_a_copy_and_its_results(tmp_path: Path) -> None:
    names = ["A", "DiffDir.R", "DiffDir.G", "DiffDir.B", "Mist.Z", "Sparks.R", "Sparks.G", "Sparks.B"]
    write_blender(tmp_path / "renders", "V")
    for index, path in enumerate(sorted((tmp_path / "renders").glob("*.exr"))):
        extra = [name for name in names if "." in name] + ["CryptoObject00.R", "Noisy Image.R"]
        channels = read_exr(path)
        channels |= {f"V.{name}": channels["V.Combined.R"] * np.float32(0.5) for name in extra}
        write_exr(path, channels, metadata={"Camera": "Main", "Frame": f"{index:02d}"})
    shot = import_blender(tmp_path / "renders")
    ignored = {name.removeprefix("V.") for name in shot.ignored_channels}
    assert ignored == {"CryptoObject00.R", "Noisy Image.R"}
    copied = copy_shot(shot, tmp_path / "shot")
    assert list(copied.info.aov_names) == names
    changed = (tmp_path / "shot" / "shot.json").read_text().replace('"Sparks.B"', '"Sparks.B", "More"')
    (tmp_path / "shot" / "more.json").write_text(changed)
    with pytest.raises(ShotError, match=r"0000\.exr: has 8 AOVs; the shot names 9"):
        Shot.open(tmp_path / "shot" / "more.json").read(0)
    assert copied.read_metadata(1) == shot.read_metadata(1) == {"Camera": "Main", "Frame": "01"}
    for source, out in (
        (tmp_path / "renders", tmp_path / "direct"),
        (tmp_path / "shot", tmp_path / "copied"),
    ):
        command = ["upscale", str(source), "-o", str(out), "--method", "bilinear", "--scale", "2"]
        done = run(*command)
        assert done.exit_code == 0, done.output
        channels = read_exr(out / "kitchen_0009.exr")
        assert channels.keys() == {"R", "G", "B", *names}
        light, color = channels["Sparks.G"].astype(np.float32), channels["R"].astype(np.float32)
        assert light.mean() == pytest.approx(color.mean() * 0.5, rel=0.01)
        metadata = read_header(out / "kitchen_0009.exr").metadata
        assert metadata.items() >= {"Camera": "Main", "Frame": "01"}.items()


def test_one_of_several_complete_layers_must_be_chosen(tmp_path: Path) -> None:
    write_blender(tmp_path / "in", "B", "B.1")
    with pytest.raises(ArgumentError, match=r"layer is left out; want one of B.1, B"):
        import_blender(tmp_path / "in")
    with pytest.raises(ArgumentError, match=r"layer is 'C'; want one of B.1, B"):
        import_blender(tmp_path / "in", layer="C")
    shot = import_blender(tmp_path / "in", layer="B", cuts=[CUT])
    assert_is_the_scene(shot)
    assert not any("1." in name for name in (*shot.info.aov_names, *shot.ignored_channels))
    command = ["import", str(tmp_path / "in"), "-o", str(tmp_path / "shot"), "--cuts", str(CUT)]
    assert "--layer is left out; want one of B.1, B" in run(*command).output
    assert run(*command, "--layer", "B").exit_code == 0
    assert_is_the_scene(Shot.open(tmp_path / "shot"))


def test_a_blender_file_without_motion_names_the_pass_to_enable(tmp_path: Path) -> None:
    kept = {name: array for name, array in blender_frame(0, "V").items() if "Vector" not in name}
    write_exr(tmp_path / "0001.exr", kept)
    with pytest.raises(ShotError, match=r"0001\.exr: has no layer with all passes; .*Turn on the passes"):
        import_blender(tmp_path)


def test_jitter_is_that_of_the_list_again_and_again_or_none(tmp_path: Path) -> None:
    write_blender(tmp_path, "V")
    (tmp_path / "jitter.json").unlink()
    pairs, none = [(0.0, 0.25), (0.125, -0.5)], (0.0, 0.0)
    want = [*pairs, pairs[0]]
    for jitter, found in ((None, [none] * COUNT), (pairs, want), (pairs * 3, want)):
        shot = import_blender(tmp_path, jitter=jitter)
        assert [shot.read(index).frame.jitter for index in range(COUNT)] == found
    with pytest.raises(ArgumentError, match=r"jitter is .*; want pairs \[x, y\]"):
        import_blender(tmp_path, jitter=[])


@pytest.mark.parametrize(
    "content", [[], [[0]] * 3, 3, {"a": 1}, {"00": 1}, ["ab", "cd", "ef"], ["00"] * 3, [["0", "0"]] * 3]
)
def test_a_jitter_file_of_another_shape_is_refused(tmp_path: Path, content: object) -> None:
    write_blender(tmp_path, "V")
    (tmp_path / "jitter.json").write_text(json.dumps(content))
    with pytest.raises(ShotError, match=r"jitter\.json: is .* pairs \[x, y\], one for each frame"):
        import_blender(tmp_path)


# --- `import_channels`: signs, units and order of the imported frames ---


def test_a_channel_map_reads_files_of_any_renderer(tmp_path: Path) -> None:
    write_channels(tmp_path)
    shot = import_channels(
        tmp_path, {**MAP, "roughness": "rough"}, conventions=CONVENTIONS, jitter=UNREAL_JITTER, cuts=[CUT],
        name="ue",
    )  # fmt: skip
    assert_is_the_scene(shot)
    assert (shot.name, shot.conventions) == ("ue", CONVENTIONS)
    assert ((shot.read(2).frame.gbuffer or {})["roughness"] == np.float32(0.3)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"conventions": {"depth": "deep"}}, r"channels\.json: is not valid: depth is 'deep'; want"),
        ({"channels": {"color": ["R"]}}, r"channels\.json: is not valid: channel_map\['color'\] is"),
        ({"channels": {"color": 3}}, r"channel_map\['color'\] is 3; want 3 channel names"),
        ({"channel": {}}, r"channels\.json: is not as expected: Object contains unknown field `channel`"),
        ({"cuts": ["a"]}, r"channels\.json: .* at `\$\.cuts\[0\]`, is 'a'"),
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
        ({"colour": "R"}, "a map with 'colour'; want one of color, depth.* Did you mean 'color'?"),
        ({"color": ["c/*.jpg:R"] * 3}, r"\['color'\] is 'c/\*\.jpg:R'; want EXR, PNG or TIFF files"),
        (
            {"channels": MAP},
            "a map with 'channels'.* Pass this object alone. A whole channels.json is read from",
        ),
        ({"aovs": ["R"] * 1025}, "want 1024 channel names"),
        ({"motion": "X"}, r"channel_map\['motion'\] is 'X'; want 2 channel names"),
        ({"motion": ["X", "motion/*.exr:Y"]}, r"is files of \*\.exr and motion/\*\.exr; want channels of"),
        ({"depth": None}, "is a map without 'depth'; want depth and motion at least"),
    ],
)
def test_a_wrong_map_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    write_channels(tmp_path, 1)
    channel_map = {name: value for name, value in {**MAP, **change}.items() if value is not None}
    with pytest.raises(ArgumentError, match=message):
        import_channels(tmp_path, channel_map, conventions=CONVENTIONS)


def test_files_that_do_not_pair_up_are_named(tmp_path: Path) -> None:
    write_channels(tmp_path)
    (tmp_path / "motion" / "0002.exr").unlink()
    with pytest.raises(ShotError, match=r"frame 2 is among \*\.exr and not among motion/\*\.exr"):
        import_channels(tmp_path, MAP, conventions=CONVENTIONS)


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
    copy = copy_shot(shot, tmp_path.with_name(f"{tmp_path.name} copy"))
    assert_is_the_scene(copy)
    assert_same_shot(copy, shot)


# --- `import_arm`: signs, units and order of the imported frames ---


@pytest.mark.parametrize("far", [math.inf, 50.0])
def test_an_arm_sequence_comes_out_as_ours(tmp_path: Path, far: float) -> None:
    shot = import_arm(write_safetensors(tmp_path / "street.safetensors", arm_tensors(far)))
    assert_is_the_scene(shot)
    assert (shot.name, shot.frame_rate, shot.display_size) == ("street", 60.0, DISPLAY_SIZE)
    assert shot.reference_indices == [0, 1, 2]
    assert [item.frame.exposure for item in shot] == pytest.approx([1, 2, 4])
    reference = np.asarray(shot.read(1).reference)
    assert reference.dtype == np.float32
    np.testing.assert_allclose(reference, truth(1), atol=1e-3)


def test_an_arm_sequence_without_the_optional_tensors_is_read(tmp_path: Path) -> None:
    optional = {"ground_truth_linear", "exposure", "seq", "EmulatedFramerate"}
    tensors = {name: array for name, array in arm_tensors().items() if name not in optional}
    shot = import_arm(write_safetensors(tmp_path / "a.safetensors", tensors))
    assert_is_the_scene(shot)
    assert (shot.display_size, shot.reference_indices, shot.read(0).frame.exposure) == (None, [], None)
    tensors["seq"] = np.array([[1], [1], [2]], np.int64)  # a change of sequence is a cut, too
    del tensors["camera_cut"]
    assert_is_the_scene(import_arm(write_safetensors(tmp_path / "b.safetensors", tensors)))


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
        ({"depth_params": np.zeros((3, 3), np.float32)}, r"tensor depth_params is \(3, 3\); want \(frames"),
        ({"colour_linear": np.zeros((3, 36, 64), np.float16)}, r"tensor colour_linear is \(3, 36, 64\)"),
    ],
)
def test_a_missing_or_misshapen_tensor_is_named(
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


# --- `open_source`: it detects each layout, and names what it found otherwise ---


def test_the_layout_is_detected_from_the_files(tmp_path: Path) -> None:
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


def test_given_conventions_replace_those_of_a_channels_json(tmp_path: Path) -> None:
    folder = write_channels(tmp_path)
    stated = Conventions(srgb=True).to_json()
    (folder / "channels.json").write_text(json.dumps({"channels": MAP, "conventions": stated}))
    assert open_source(folder).conventions == Conventions(srgb=True)
    assert open_source(folder, conventions=CONVENTIONS).conventions == CONVENTIONS


def test_an_unrecognised_layout_is_answered_with_the_channels_found(tmp_path: Path) -> None:
    def refused(path: Path, message: str) -> None:
        with pytest.raises(ShotError, match=message):
            open_source(path)

    refused(tmp_path / "nowhere", r"nowhere: there is no such file or folder\. Supported")
    refused(tmp_path, "holds nothing")
    for index in range(10):
        (tmp_path / f"{index}.txt").write_text("")
    refused(tmp_path, r"holds 0\.txt, .*, 7\.txt and 2 more\. Supported: a folder with shot\.json")
    refused(tmp_path / "0.txt", "is neither a folder nor")
    write_exr(tmp_path / "a_1.exr", {"R": plane(0), "Z": plane(1)})
    refused(tmp_path, r"holds frames with the channels R, Z\. Map them in a channels\.json")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"conventions": "unreal"}, r"conventions is 'unreal'; want .* Write Conventions\.unreal\(\)\."),
        ({"conventions": {"srgb": True}}, "conventions is {'srgb': True}; want supersampler.Conventions"),
        ({"channel_map": ["R"]}, r"channel_map is \['R'\]; want a mapping"),
        ({"frames": (1, 2, 3)}, r"frames is \(1, 2, 3\); want \(first, last\)"),
        ({"frames": "1-2"}, "frames is '1-2'; want"),
        ({"cuts": 5}, "cuts is 5; want indices of frames"),
        ({"cuts": [1.5]}, r"cuts is \[1.5\]; want indices of frames"),
        ({"display_size": 640}, "display_size is 640; want"),
    ],
)
def test_an_argument_of_another_type_is_named(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    write_channels(tmp_path)
    given = {"layout": "channels", "channel_map": MAP, "conventions": CONVENTIONS, **options}
    with pytest.raises(ArgumentError, match=message):
        open_source(tmp_path, **given)


def test_an_option_that_the_layout_does_not_take_is_refused_by_name(tmp_path: Path) -> None:
    folder = write_blender(tmp_path / "blender", "V")
    with pytest.raises(ArgumentError, match="channel_map is given; want left out: the layout 'blender'"):
        open_source(folder, layout="blender", channel_map={})
    arm = write_safetensors(tmp_path / "arm.safetensors", arm_tensors())
    with pytest.raises(ArgumentError, match="frame_rate is given; want left out: the layout 'arm'"):
        open_source(arm, frame_rate=25.0)
    done = run("import", arm, "-o", tmp_path / "out", "--frame-rate", "25")
    assert "--frame-rate is given; want left out: the layout 'arm' does not use it" in done.stderr
    assert (done.exit_code, (tmp_path / "out").exists()) == (2, False)
