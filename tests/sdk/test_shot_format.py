"""Tests of shot.json: errors name the file, the key and the frame."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler import ArgumentError, Frame, ShotError
from supersampler.conventions import Conventions
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import (
    ClassMaps,
    FrameEntry,
    Shot,
    ShotInfo,
    ShotWriter,
    copy_shot,
    import_described_channels,
    open_source,
)
from supersampler.io.shot.format import load_shot_json, shot_json
from supersampler_model.data.scenes.analytic import Plane, checker

INFO = ShotInfo(
    name="dæmo",
    render_size=(8, 6),
    display_size=(16, 12),
    frame_rate=29.97,
    conventions=Conventions.unreal(),
    license="CC0 1.0",
    attribution=("Ann", "Bob"),
    aov_names=("A", "Emit.R"),
)
ENTRIES = [
    FrameEntry(
        file="0000.exr", jitter=(1 / 3, -0.1), reset=True, exposure=0.1, reference="reference/0000.exr"
    ),
    FrameEntry(file="0001.exr", jitter=(0.0, 0.0), render_size=(7, 5), display_file="d.exr", shaded=False),
]


def write(folder: Path, **changes: object) -> Path:
    """Write the shot.json of INFO and ENTRIES with keys changed; None takes a key out."""
    content: dict[str, Any] = json.loads(shot_json(INFO, ENTRIES))
    for key, value in changes.items():
        target = content["frames"][1] if key in ENTRY_KEYS else content
        target[key] = value
        if value is None:
            del target[key]
    path = folder / "shot.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


ENTRY_KEYS = ("file", "jitter", "reset", "exposure", "reference", "typo")


@pytest.mark.parametrize("display_size", [None, (16, 12)])
def test_what_is_written_is_read(tmp_path: Path, display_size: tuple[int, int] | None) -> None:
    info = replace(INFO, display_size=display_size)
    (tmp_path / "shot.json").write_text(shot_json(info, ENTRIES), encoding="utf-8")
    assert load_shot_json(tmp_path / "shot.json") == (info, ENTRIES)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 2}, "is of version 2; this package reads 1. .*update supersampler"),
        ({"version": None}, "missing required field `version`"),
        ({"render_size": None}, "missing required field `render_size`"),
        ({"render_size": [8, 0]}, r"Expected `int` >= 1 - at `\$\.render_size\[1\]`, is 0"),
        ({"display_size": [8.5, 3]}, r"Expected `int`, got `float` - at `\$\.display_size\[0\]`, is 8.5"),
        ({"frame_rate": 0}, r"Expected `float` > 0.0 - at `\$\.frame_rate`, is 0"),
        ({"attribution": [1]}, r"at `\$\.attribution\[0\]`, is 1"),
        ({"aov_names": ["A", "A"]}, r"aov_names is .*; want names that differ, and are not R, G or B"),
        ({"aov_names": ["G"]}, r"aov_names is .*; want names that differ"),
        ({"aov_names": [""]}, r"length >= 1 - at `\$\.aov_names\[0\]`, is ''"),
        ({"conventions": {"no_such": 1}}, '"conventions" is not valid: '),
        ({"frames": {}}, r"Expected `array`, got `object` - at `\$\.frames`, is {}"),
        ({"frames": [3]}, r"Expected `object`, got `int` - at `\$\.frames\[0\]`, is 3"),
        ({"fps": 3}, "unknown field `fps`"),
        ({"jitter": None}, r"missing required field `jitter` - at `\$\.frames\[1\]`"),
        ({"jitter": [0.1]}, r"array` of length 2 - at `\$\.frames\[1\]\.jitter`, is \[0.1\]"),
        ({"jitter": ["a", 0]}, r"at `\$\.frames\[1\]\.jitter\[0\]`, is 'a'"),
        ({"reset": 1}, r"Expected `bool`, got `int` - at `\$\.frames\[1\]\.reset`, is 1"),
        ({"exposure": "auto"}, r"at `\$\.frames\[1\]\.exposure`, is 'auto'"),
        ({"file": ""}, r"frames\[1\] has the file ''; want a file inside"),
        ({"file": "../0001.exr"}, r"frames\[1\] has the file '../0001.exr'; want a file inside"),
        ({"file": "/etc/passwd"}, r"frames\[1\] has the file '/etc/passwd'; want a file inside"),
        ({"file": "C:\\a.exr"}, r"frames\[1\] has the file .*with forward slashes"),
        ({"file": "0000.exr"}, "0000.exr is listed twice: in frame 0 and frame 1"),
        ({"reference": "reference/0000.exr"}, "reference/0000.exr is listed twice"),
        ({"typo": 1}, r"unknown field `typo` - at `\$\.frames\[1\]`"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    path = write(tmp_path, **changes)
    with pytest.raises(ShotError, match=message) as caught:
        load_shot_json(path)
    assert caught.value.path == path


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", r"is not JSON \(Input data was truncated"),
        (b"\xff\xfe\x00", "is not JSON"),
        (b"[]", r"is not as expected: Expected `object`, got `array`"),
    ],
)
def test_a_file_that_is_not_json_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "shot.json").write_bytes(content)
    with pytest.raises(ShotError, match=rf"shot\.json: {message}"):
        load_shot_json(tmp_path / "shot.json")


def test_a_folder_without_shot_json_is_named(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match=r"shot\.json: there is no such file"):
        load_shot_json(tmp_path / "shot.json")


def test_the_files_shown_in_the_docs_are_read(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "shots.md").read_text(encoding="utf-8")
    shot, channels, _ = re.findall(r"```json\n(.*?)```", text, flags=re.DOTALL)
    (tmp_path / "shot.json").write_text(shot)
    info, entries = load_shot_json(tmp_path / "shot.json")
    assert (info.name, len(entries), entries[2].render_size) == ("plaza", 3, (288, 162))
    (tmp_path / "channels.json").write_text(channels)
    for name in ("depth", "motion", "reference"):
        write_exr(tmp_path / name / "0001.exr", np.ones((2, 2, 3), np.float32))
    with pytest.raises(ShotError, match=r"has no file \*\.exr"):  # all is right but the colour's files
        import_described_channels(tmp_path)
    for number in range(49):
        for folder in (".", "depth", "motion"):
            write_exr(
                tmp_path / folder / f"{number:04d}.exr", np.ones((2, 2, 3), np.float32), compression="none"
            )
    assert import_described_channels(tmp_path).read(48).frame.reset


# --- shots that share their display-size files; class maps beside a reference ---


DISPLAY_SIZE = (32, 18)
SIZES = {"2x": (16, 9), "4x": (8, 5)}
SCENE = Plane(checker, (2.0, -1.0))
RANDOM = np.random.default_rng(0)
CLASSES = ClassMaps(*(RANDOM.integers(0, 3, (18, 32)).astype(np.uint8) for _ in range(2)))


def frame(index: int, size: tuple[int, int]) -> Frame:
    plain = SCENE.frame(index, size, (0.1 * index, 0.0))
    depth = SCENE.frame(index, DISPLAY_SIZE, (0.0, 0.0)).depth
    return Frame(
        color=plain.color,
        depth=plain.depth,
        motion=plain.motion,
        jitter=plain.jitter,
        gbuffer_display={"depth": depth * (1 + index)},
    )


def writer(folder: Path, variant: str, *, resume: bool = False) -> ShotWriter:
    return ShotWriter(
        folder, name="test", display_size=DISPLAY_SIZE, frame_rate=30, variant=variant, resume=resume
    )


def write_all(folder: Path, count: int = 2) -> None:
    writers = {variant: writer(folder, variant) for variant in SIZES}
    for index in range(count):
        for variant, size in SIZES.items():
            writers[variant].write(
                frame(index, size),
                reference=SCENE.truth(index, DISPLAY_SIZE, 1),
                classes=CLASSES,
                shared=variant != "2x",
            )


def test_variants_are_shots_of_their_own_over_one_set_of_references(tmp_path: Path) -> None:
    write_all(tmp_path)
    files = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*"))
    below = [f"{part}/000{i}.exr" for part in ("2x", "4x", "display", "reference") for i in (0, 1)]
    assert files == sorted([*below, "2x.json", "4x.json"])
    for variant, size in SIZES.items():
        for shot in (Shot.open(tmp_path / f"{variant}.json"), open_source(tmp_path / f"{variant}.json")):
            assert (len(shot), shot.render_size, shot.reference_indices) == (2, size, [0, 1])
            for item in shot:
                assert item.frame.gbuffer_display is not None
                wanted = frame(item.index, size)
                np.testing.assert_array_equal(item.frame.depth, wanted.depth)
                np.testing.assert_array_equal(item.reference, SCENE.truth(item.index, DISPLAY_SIZE, 1))


def test_a_variant_is_resumed_without_the_others(tmp_path: Path) -> None:
    write_all(tmp_path, count=1)
    with writer(tmp_path, "4x", resume=True) as again:
        assert len(again) == 1
        again.write(frame(1, SIZES["4x"]), reference=SCENE.truth(1, DISPLAY_SIZE, 1))
    assert len(Shot.open(tmp_path / "4x.json")) == 2
    assert len(Shot.open(tmp_path / "2x.json")) == 1
    with writer(tmp_path, "2x", resume=True) as first:  # the reference that is there is the other variant's
        first.write(frame(1, SIZES["2x"]), reference=SCENE.truth(1, DISPLAY_SIZE, 1))
    assert len(Shot.open(tmp_path / "2x.json")) == 2
    with pytest.raises(ShotError, match=r"4x\.json: a shot of 2 frames is there already"):
        writer(tmp_path, "4x")


def test_a_missing_shared_file_is_named_with_the_description_that_lists_it(tmp_path: Path) -> None:
    write_all(tmp_path)
    (tmp_path / "display" / "0001.exr").unlink()
    with pytest.raises(
        ShotError, match=r"display.0001\.exr: the file of frame 1 is missing\. 4x\.json lists it"
    ):
        Shot.open(tmp_path / "4x.json")


@pytest.mark.parametrize("compression", ["zip", "dwab:45"])
@pytest.mark.parametrize("thin", [None, CLASSES.ghost % 2])
def test_classes_are_read_as_they_were_written(
    tmp_path: Path, compression: str, thin: NDArray[np.uint8] | None
) -> None:
    classes = replace(CLASSES, thin=thin)
    with ShotWriter(
        tmp_path / "a",
        name="test",
        display_size=DISPLAY_SIZE,
        frame_rate=30,
        reference_compression=compression,
    ) as out:
        out.write(frame(0, (16, 9)), reference=SCENE.truth(0, DISPLAY_SIZE, 1), classes=classes)
        out.write(frame(1, (16, 9)), reference=SCENE.truth(1, DISPLAY_SIZE, 1))
        out.write(frame(2, (16, 9)))
    shot = Shot.open(tmp_path / "a")
    copy = copy_shot(shot, tmp_path / "b")
    for read in (shot.read_classes(0), copy.read_classes(0)):
        assert read is not None
        assert list(read.known()) == list(classes.known())
        for array, wanted in zip(read.known().values(), classes.known().values(), strict=True):
            assert array.dtype == np.uint8
            np.testing.assert_array_equal(array, wanted)
    assert shot.read_classes(1) is None
    assert shot.read_classes(2) is None
    assert set(read_exr(tmp_path / "a" / "reference" / "0001.exr")) == {"R", "G", "B"}


def test_classes_of_another_size_or_without_a_reference_are_refused(tmp_path: Path) -> None:
    out, small = writer(tmp_path, "2x"), ClassMaps(CLASSES.ghost[:-1], CLASSES.alias[:-1])
    with pytest.raises(ArgumentError, match=r"classes\.ghost is 32x17; want the shot's display size"):
        out.write(frame(0, (16, 9)), reference=SCENE.truth(0, DISPLAY_SIZE, 1), classes=small)
    with pytest.raises(ArgumentError, match=r"classes\.thin is 32x17"):
        out.write(
            frame(0, (16, 9)),
            reference=SCENE.truth(0, DISPLAY_SIZE, 1),
            classes=replace(CLASSES, thin=small.alias),
        )
    with pytest.raises(ArgumentError, match="classes is without a reference"):
        out.write(frame(0, (16, 9)), classes=CLASSES)
    assert len(out) == 0


def test_planes_of_truth_are_read_as_they_were_written(tmp_path: Path) -> None:
    planes = {name: RANDOM.random((18, 32)).astype(np.float16) for name in ("thin", "moving")}
    with ShotWriter(tmp_path / "a", name="test", display_size=DISPLAY_SIZE, frame_rate=30) as out:
        for index, truth in enumerate((planes, None, planes)):
            out.write(frame(index, (16, 9)), reference=SCENE.truth(index, DISPLAY_SIZE, 1), truth=truth)
        out.write(frame(3, (16, 9)))
    shot = Shot.open(tmp_path / "a")
    last = shot.cropped(2, 3)
    for read in (shot.read_truth(0), copy_shot(shot, tmp_path / "b").read_truth(0), last.read_truth(0)):
        assert set(read) == set(planes)
        for name, plane in planes.items():
            np.testing.assert_array_equal(read[name], plane)
    assert shot.read_truth(1) == shot.read_truth(3) == {}


def test_planes_of_truth_of_another_size_or_without_a_reference_are_refused(tmp_path: Path) -> None:
    out, reference = writer(tmp_path, "2x"), SCENE.truth(0, DISPLAY_SIZE, 1)
    with pytest.raises(ArgumentError, match=r"truth\.thin is 32x17; want the shot's display size"):
        out.write(frame(0, (16, 9)), reference=reference, truth={"thin": np.zeros((17, 32), np.float16)})
    with pytest.raises(ArgumentError, match="truth is without a reference"):
        out.write(frame(0, (16, 9)), truth={"thin": np.zeros((18, 32), np.float16)})
    assert len(out) == 0


# --- the shipped shot, which opens by its name ---


def test_the_shipped_shot_is_small_and_whole() -> None:
    shot = Shot.open("plaza")
    assert sum(path.stat().st_size for path in shot.path.rglob("*.*")) < 18e6
    assert (shot.render_size, shot.display_size, len(shot)) == ((320, 180), (640, 360), 32)
    assert shot.reference_indices == list(range(15, 32))
    assert (shot.info.license, shot.info.attribution) == ("Apache-2.0", ())
    first = shot.read(15)
    assert first.frame.color is not None
    assert first.frame.color.dtype == np.float16
    assert first.frame.depth.dtype == np.float32
    assert first.reference is not None
    assert first.reference.shape == (360, 640, 3)
    classes = shot.read_classes(15)
    assert classes is not None
    assert {0, 1, 2} == set(np.unique(classes.ghost)) == set(np.unique(classes.alias))


@pytest.mark.parametrize("open_shot", [Shot.open, open_source])
def test_a_shipped_shot_opens_by_name_unless_a_folder_has_that_name(
    open_shot: Callable[[str], Shot], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(open_shot("plaza")) == 32
    shutil.copytree(open_shot("plaza").path, "plaza")
    assert open_shot("plaza").path == Path("plaza")


@pytest.mark.parametrize(
    ("name", "hint"), [("sponza", "Shots that ship: plaza."), ("Plazza", "Did you mean 'plaza'?")]
)
def test_a_name_that_no_shot_has_is_answered_with_those_that_ship(name: str, hint: str) -> None:
    with pytest.raises(ShotError, match=re.escape(hint)):
        Shot.open(name)
