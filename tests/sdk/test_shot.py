"""Tests of `Shot` and `ShotWriter`: reading on demand, order, exact pixels, atomic writes."""

import gc
import json
import re
import shutil
import threading
import time
import weakref
from collections.abc import Callable, Collection
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from noise import full_noise, noise
from supersampler import (
    ArgumentError,
    Conventions,
    Frame,
    FrameError,
    RawFrame,
    ShotError,
    denoise_sequence,
    upscale_sequence,
)
from supersampler.io.files import partial_name
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

SIZE, DISPLAY_SIZE = (16, 9), (32, 18)
SCENE = Plane(checker, (2.0, -1.0))


def frame(index: int, *, size: tuple[int, int] = SIZE) -> Frame:
    """Frame of a checker that pans by (2, -1) units, which are 0.5 and -0.25 pixels."""
    return SCENE.frame(index, size, (0.1 * (index % 4), -0.05 * index % 0.5))


def truth_of(index: int) -> np.ndarray:
    return SCENE.truth(index, DISPLAY_SIZE, 1)


def write_shot(folder: Path, count: int = 4, **options: Any) -> Shot:
    """Write frames of the test scene, with a reference on each even one."""
    with ShotWriter(folder, name="test", display_size=DISPLAY_SIZE, frame_rate=24, **options) as writer:
        for index in range(len(writer), count):
            writer.write(frame(index), reference=truth_of(index) if index % 2 == 0 else None)
    return Shot.open(folder)


def assert_same(a: Frame | RawFrame, b: Frame | RawFrame, *, tolerance: float = 0.0) -> None:
    """All fields of two frames are equal; arrays within a tolerance, and of one type."""
    for name in ("color", "depth", "motion", "reactive", "aovs"):
        x, y = getattr(a, name), getattr(b, name)
        assert (x is None) == (y is None), name
        if x is not None:
            assert tolerance or x.dtype == y.dtype, name
            np.testing.assert_allclose(x, y, rtol=0, atol=tolerance, err_msg=name)
    np.testing.assert_allclose(a.jitter or (0, 0), b.jitter or (0, 0), rtol=0, atol=tolerance)
    assert (a.reset, a.exposure, a.pre_exposure) == (b.reset, b.exposure, b.pre_exposure)
    for name in ("gbuffer", "gbuffer_display"):
        np.testing.assert_equal(getattr(a, name) or {}, getattr(b, name) or {})


def test_written_frames_are_read_in_order(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, license="CC0", attribution=["Ann"])
    assert (shot.name, shot.render_size, shot.display_size) == ("test", SIZE, DISPLAY_SIZE)
    assert (shot.frame_rate, shot.info.license, shot.info.attribution) == (24.0, "CC0", ("Ann",))
    assert (shot.path, len(shot), shot.reference_indices) == (tmp_path, 4, [0, 2])
    for index, item in enumerate(shot):
        assert item.index == index
        assert_same(item.frame, frame(index))
        np.testing.assert_equal(item.reference, truth_of(index) if index % 2 == 0 else None)
        assert item.reference is None or item.reference.dtype == np.float32


def test_every_input_a_frame_can_have_is_kept(tmp_path: Path) -> None:
    full = replace(full_noise(1, SIZE, DISPLAY_SIZE), ids=None)  # shots have none
    one = replace(noise(0, SIZE), color=None, aovs=np.full((*SIZE[::-1], 1), 0.3, np.float16))
    with ShotWriter(tmp_path, name="full", display_size=DISPLAY_SIZE, frame_rate=30) as writer:
        writer.write(full)
        writer.write(one)
    for item, written in zip(Shot.open(tmp_path), (full, one), strict=True):
        assert_same(item.frame, written)


def test_the_render_size_may_change_from_frame_to_frame(tmp_path: Path) -> None:
    sizes = [SIZE, (11, 7), SIZE, (20, 12)]
    with ShotWriter(tmp_path, name="dynamic", display_size=None, frame_rate=30) as writer:
        for index, size in enumerate(sizes):
            writer.write(frame(index, size=size))
    shot = Shot.open(tmp_path)
    assert shot.render_size == SIZE
    assert [item.frame.size for item in shot] == sizes


def test_frames_are_stored_in_the_shots_conventions_and_read_in_ours(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, conventions=Conventions.unreal())
    for index, item in enumerate(shot):
        assert_same(item.frame, frame(index), tolerance=1e-5)
        assert not np.allclose(item.raw.motion, item.frame.motion)
    assert shot.conventions == Conventions.unreal()


def test_any_frame_can_be_read_on_its_own(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, conventions=Conventions(motion_jittered=True))
    in_order = [item.frame for item in shot]
    for index in (3, 0, 2, 1):
        assert_same(shot.read(index).frame, in_order[index], tolerance=1e-6)
        assert_same(shot.read(index).frame, frame(index), tolerance=1e-5)
        assert_same(next(shot.frames(index)).frame, in_order[index], tolerance=1e-6)
    for index in (-1, 4):
        with pytest.raises(IndexError, match=f"frame {index} of 4"):
            shot.read(index)
    assert [[item.index for item in shot.frames(*part)] for part in ((1, 3), (2, 99))] == [[1, 2], [2, 3]]


# --- lazy reading ---


def counted(shot: Shot) -> list[int]:
    """Record which frames a shot reads."""
    reads: list[int] = []
    read = shot._raw

    def recording(index: int, gbuffers: Collection[str] | None) -> RawFrame:
        reads.append(index)
        return read(index, gbuffers)

    shot._raw = recording
    return reads


def shot_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith("shot")]


def test_frames_are_read_ahead_by_threads_but_not_far(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, 8)
    reads = counted(shot)
    frames = shot.frames()
    assert reads == []  # nothing before the first is asked for
    next(frames)
    assert 2 <= len(shot_threads()) <= 3
    deadline = time.monotonic() + 60
    while len(reads) < 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.05)  # long enough for more, if more were to come
    assert sorted(reads) == [0, 1, 2]
    assert [item.index for item in frames] == list(range(1, 8))
    assert shot_threads() == []


def test_the_threads_end_when_the_iterator_is_dropped(tmp_path: Path) -> None:
    frames = iter(write_shot(tmp_path, 8))
    next(frames)
    assert 2 <= len(shot_threads()) <= 3
    del frames
    gc.collect()
    assert shot_threads() == []


def test_an_error_is_raised_where_its_frame_is_reached(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, 4)
    (tmp_path / "0002.exr").write_bytes(b"")
    seen: list[int] = []
    with pytest.raises(ShotError, match=r"0002\.exr"):
        seen.extend(item.index for item in shot)
    assert seen == [0, 1]
    assert shot_threads() == []


def test_the_last_cut_is_found_without_a_file(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, 6)
    entries = enumerate(shot._entries)
    shot._entries = tuple(msgspec.structs.replace(entry, reset=index == 3) for index, entry in entries)
    for path in tmp_path.glob("*.exr"):
        path.unlink()
    assert [shot.last_cut(index) for index in range(6)] == [0, 0, 0, 3, 3, 3]


def test_memory_holds_a_few_frames_at_a_time(tmp_path: Path) -> None:
    alive: list[weakref.ref[object]] = []
    most = 0
    for item in write_shot(tmp_path, 12):
        alive.append(weakref.ref(item.frame.depth))
        most = max(most, sum(reference() is not None for reference in alive))
    assert most <= 2  # the one at hand and the one before, which `item` held until it was replaced


# --- bad files ---


def rewrite(path: Path, columns: slice = slice(None), without: str = "") -> None:
    write_exr(path, {name: array[:, columns] for name, array in read_exr(path).items() if name != without})


@pytest.mark.parametrize(
    ("file", "spoil", "message"),
    [
        ("0001.exr", Path.unlink, "the file of frame 1 is missing. shot.json lists it"),
        ("reference/0002.exr", Path.unlink, "the file of frame 2 is missing"),
        (
            "0001.exr",
            lambda path: path.write_bytes(path.read_bytes()[:-200]),
            "to its end .*damaged or cut off",
        ),
        ("0001.exr", lambda path: rewrite(path, slice(1, None)), "is 15x9; the shot says 16x9"),
        ("reference/0002.exr", lambda path: rewrite(path, slice(1, None)), "is 31x18; the shot says 32x18"),
        (
            "0001.exr",
            lambda path: rewrite(path, without="depth.Z"),
            r"no channel depth\.Z. It has R, G, B, mo",
        ),
        ("0001.exr", lambda path: rewrite(path, without="G"), "has no channel G. It has R, B, depth"),
        ("0001.exr", lambda path: rewrite(path, without="motion.X"), r"has no channel motion\.X"),
        ("reference/0002.exr", lambda path: rewrite(path, without="B"), "has no channel B. It has R, G"),
    ],
)
def test_a_bad_file_is_named_with_the_problem_and_the_fix(
    tmp_path: Path, file: str, spoil: Callable[[Path], object], message: str
) -> None:
    write_shot(tmp_path)
    spoil(tmp_path / file)
    with pytest.raises(ShotError, match=message) as caught:
        list(Shot.open(tmp_path))
    assert caught.value.path == tmp_path / file


def test_a_frame_that_breaks_the_contract_is_named(tmp_path: Path) -> None:
    write_shot(tmp_path, 2)
    text = (tmp_path / "shot.json").read_text().replace('"jitter": [0.1', '"jitter": [3.1')
    (tmp_path / "shot.json").write_text(text)
    with pytest.raises(ShotError, match=r"0001\.exr: frame 1 breaks the contract: frame\.jitter is \(3\.1"):
        list(Shot.open(tmp_path))


# --- writing ---


def test_a_shot_is_neither_overwritten_nor_resumed_with_other_properties(tmp_path: Path) -> None:
    write_shot(tmp_path, 2)
    with pytest.raises(ShotError, match=r"a shot of 2 frames already exists\. Resume it"):
        write_shot(tmp_path, 2)
    with pytest.raises(ShotError, match=r"its frame_rate is 24\.0; this run's is 30\.0"):
        writer(tmp_path, resume=True)


def test_a_write_that_fails_can_be_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jittered = Conventions(motion_jittered=True)  # the writer must not have moved on to the failed frame
    writer = ShotWriter(tmp_path, name="t", display_size=None, frame_rate=24, conventions=jittered)
    writer.write(frame(0))
    before = sorted(path.name for path in tmp_path.rglob("*"))

    rename = Path.replace

    def full(path: Path, target: Path) -> None:
        if path.suffix == ".exr":
            raise OSError(28, "No space left on device")
        rename(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        with pytest.raises(ShotError, match=r"0001\.exr: cannot be written \(.*No space left"):
            writer.write(frame(1))
    assert sorted(path.name for path in tmp_path.rglob("*")) == before
    assert len(writer) == len(Shot.open(tmp_path)) == 1
    writer.write(frame(1))
    assert_same(Shot.open(tmp_path).read(1).frame, frame(1), tolerance=1e-6)


def test_a_frame_that_a_reader_would_refuse_is_not_written(tmp_path: Path) -> None:
    writer = ShotWriter(tmp_path, name="test", display_size=None, frame_rate=24)
    flat = np.zeros((9, 16), np.float32)
    with pytest.raises(FrameError, match=r"frame\.motion is of shape \(9, 16\)"):
        writer.write(RawFrame(depth=flat, motion=flat))
    with pytest.raises(FrameError, match=r"frame\.jitter is \(3\.0, 0\.0\)"):
        writer.write(RawFrame(depth=flat, motion=np.zeros((9, 16, 2), np.float32), jitter=(3.0, 0.0)))
    assert list(tmp_path.iterdir()) == []


def test_ids_and_aovs_that_a_reader_would_lose_or_refuse_are_not_written(tmp_path: Path) -> None:
    def raw(count: int, *names: str) -> RawFrame:
        aovs = np.ones((9, 16, count), np.float32)
        motion = np.zeros((9, 16, 2), np.float32)
        return RawFrame(depth=aovs[..., 0], motion=motion, aovs=aovs, aov_names=names or None)

    first = ShotWriter(tmp_path, name="test", display_size=None, frame_rate=24)
    with pytest.raises(FrameError, match=r"frame\.ids is .*; want None\. Shots have none"):
        first.write(replace(frame(0), ids=np.ones((*SIZE[::-1], 1), np.int32)))
    with pytest.raises(FrameError, match=r"frame\.aovs is 2 channels; want 1, named \('A',\)"):
        first.write(raw(2, "A"))
    with pytest.raises(ShotError, match=r"aov_names is \('A', 'R'\); want names that differ"):
        first.write(raw(2, "A", "R"))
    assert list(tmp_path.iterdir()) == []
    first.write(raw(2, "A", "Z"))
    with pytest.raises(
        FrameError, match=r"frame\.aov_names is \('Z', 'A'\); want \('A', 'Z'\), as in the first"
    ):
        first.write(raw(2, "Z", "A"))
    with pytest.raises(FrameError, match=r"frame\.aovs is 3 channels; want 2"):
        first.write(raw(3))
    first.write(raw(2))
    assert [item.raw.aov_names for item in Shot.open(tmp_path)] == [("A", "Z")] * 2


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"display_size": 5}, ArgumentError, "display_size is 5; want"),
        ({"frame_rate": "24"}, ArgumentError, "frame_rate is '24'; want"),
        ({"conventions": "fsr"}, ArgumentError, r"conventions is 'fsr'; want .*Write Conventions\.fsr\(\)"),
        ({"attribution": "Ann"}, ArgumentError, "attribution is 'Ann'; want names in a tuple"),
        ({"name": 5}, ShotError, r"could not be read again: Expected `str`, got `int` - at `\$\.name`"),
        ({"file_names": "a"}, ShotError, "file_names is 'a'; want a name with one ####"),
    ],
)
def test_properties_that_a_reader_would_refuse_are_not_written(
    tmp_path: Path, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    given = {"name": "test", "display_size": None, "frame_rate": 24, **options}
    with pytest.raises(error, match=message):
        ShotWriter(tmp_path, **given)


def test_a_path_is_not_a_shot(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match=r"has no shot\.json\. .*open_source` opens frames of other programs"):
        Shot.open(tmp_path)
    calls: list[Callable[[Any], object]] = [
        upscale_sequence, denoise_sequence, lambda path: copy_shot(path, tmp_path)
    ]  # fmt: skip
    for call in calls:
        with pytest.raises(ArgumentError, match=r"is 'plaza'; want a Shot.*open_source` opens files"):
            call("plaza")


LARGE, SMALL = np.zeros((18, 32), np.uint8), np.zeros((17, 32), np.uint8)
REFERENCE = np.zeros((18, 32, 3), np.float32)


@pytest.mark.parametrize(
    ("size", "arrays", "message"),
    [
        (DISPLAY_SIZE, {"reference": REFERENCE[:9]}, r"reference is 32x9; want the shot's display size"),
        (None, {"reference": REFERENCE}, "Give the ShotWriter a display_size"),
        (DISPLAY_SIZE, {"classes": ClassMaps(LARGE, LARGE)}, "classes is without a reference"),
        (DISPLAY_SIZE, {"truth": {"thin": LARGE}}, "truth is without a reference"),
        (DISPLAY_SIZE, {"reference": REFERENCE, "truth": {"thin": SMALL}}, r"truth\.thin is 32x17"),
        *(
            (DISPLAY_SIZE, {"reference": REFERENCE, "classes": maps}, rf"classes\.{name} is 32x17")
            for name, maps in (("ghost", ClassMaps(SMALL, LARGE)), ("thin", ClassMaps(LARGE, LARGE, SMALL)))
        ),
    ],
)
def test_arrays_of_the_wrong_display_size_or_without_a_reference_are_refused(
    tmp_path: Path, size: tuple[int, int] | None, arrays: dict[str, Any], message: str
) -> None:
    writer = ShotWriter(tmp_path, name="test", display_size=size, frame_rate=24)
    with pytest.raises(ArgumentError, match=message):
        writer.write(frame(0), **arrays)
    assert len(writer) == 0


@pytest.mark.parametrize(
    "name", ["0003.exr", "display/0003.exr", "reference/0003.exr", "shot.json", ".shot.json.writing"]
)
def test_a_writer_removes_the_temporary_file_that_a_killed_one_left(tmp_path: Path, name: str) -> None:
    write_shot(tmp_path, 3)
    left = partial_name(tmp_path / name)
    left.parent.mkdir(exist_ok=True)
    left.write_bytes(b"half")
    write_shot(tmp_path, 4, resume=True)
    assert not left.exists()


def test_a_copy_is_the_same_and_can_be_resumed(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "a", 5, conventions=Conventions.fsr(), license="CC0")
    copy_shot(shot.cropped(0, 1), tmp_path / "b")
    copy = copy_shot(shot, tmp_path / "b", resume=True)
    assert (copy.info, copy.reference_indices) == (shot.info, shot.reference_indices)
    for a, b in zip(shot, copy, strict=True):
        assert_same(a.raw, b.raw)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda raw: replace(raw, jitter=(0.5, 0.25)), r"another jitter than in .*, there \(0.5, 0.25\)"),
        (lambda raw: replace(raw, reset=True), "another reset than in .*: False, there True"),
        (lambda raw: replace(raw, color=raw.color[::-1]), "another color than in"),
        (lambda raw: replace(raw, motion=raw.motion.astype(np.float16)), "another motion than in"),
    ],
)
def test_a_copy_is_not_resumed_from_frames_that_have_changed(
    tmp_path: Path, change: Callable[[RawFrame], RawFrame], problem: str
) -> None:
    shot = write_shot(tmp_path / "a", 3)
    copy_shot(shot, tmp_path / "copy")
    with ShotWriter(tmp_path / "b", name="test", display_size=DISPLAY_SIZE, frame_rate=24) as writer:
        for index in range(3):
            raw = shot.read_raw(index)
            raw = change(raw) if index == 1 else raw
            writer.write(raw, reference=shot.read_reference(index))
    before = (tmp_path / "copy" / "shot.json").read_bytes()
    with pytest.raises(ShotError, match=f"copy: frame 1 has {problem}"):
        copy_shot(Shot.open(tmp_path / "b"), tmp_path / "copy", resume=True)
    with pytest.raises(ShotError, match=r"copy: has 3 frames; .* has 2"):
        copy_shot(shot.cropped(0, 1), tmp_path / "copy", resume=True)
    assert (tmp_path / "copy" / "shot.json").read_bytes() == before


# --- shot.json: errors name the file, the key and the frame ---


INFO = ShotInfo(
    name="dæmo", render_size=(8, 6), display_size=(16, 12), frame_rate=29.97, license="CC0 1.0",
    conventions=Conventions.unreal(), attribution=("Ann", "Bob"), aov_names=("A", "Emit.R"),
)  # fmt: skip
ENTRIES = [
    FrameEntry(file="0.exr", jitter=(1 / 3, -0.1), reset=True, exposure=0.1, reference="reference/0.exr"),
    FrameEntry(file="1.exr", jitter=(0.0, 0.0), render_size=(7, 5), display_file="d.exr", shaded=False),
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
def test_written_values_are_read_back(tmp_path: Path, display_size: tuple[int, int] | None) -> None:
    info = msgspec.structs.replace(INFO, display_size=display_size)
    (tmp_path / "shot.json").write_text(shot_json(info, ENTRIES), encoding="utf-8")
    assert load_shot_json(tmp_path / "shot.json") == (info, ENTRIES)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 2}, "is of version 2; this package reads 1. .*update supersampler"),
        ({"render_size": None}, "missing required field `render_size`"),
        ({"render_size": [8, 0]}, r"Expected `int` >= 1 - at `\$\.render_size\[1\]`, is 0"),
        ({"file_names": "a/####"}, "file_names is 'a/####'; want a name with one ####"),
        ({"file_names": "beauty"}, "file_names is 'beauty'; want a name with one ####"),
        ({"frame_rate": 0}, r"Expected `float` > 0.0 - at `\$\.frame_rate`, is 0"),
        ({"aov_names": ["A", "A"]}, r"aov_names is .*; want names that differ, and are not R, G or B"),
        ({"aov_names": ["G"]}, r"aov_names is .*; want names that differ"),
        ({"aov_names": [""]}, r"length >= 1 - at `\$\.aov_names\[0\]`, is ''"),
        ({"conventions": {"no_such": 1}}, '"conventions" is not valid: '),
        ({"frames": {}}, r"Expected `array`, got `object` - at `\$\.frames`, is {}"),
        ({"fps": 3}, "unknown field `fps`"),
        ({"jitter": None}, r"missing required field `jitter` - at `\$\.frames\[1\]`"),
        ({"jitter": ["a", 0]}, r"at `\$\.frames\[1\]\.jitter\[0\]`, is 'a'"),
        ({"reset": 1}, r"Expected `bool`, got `int` - at `\$\.frames\[1\]\.reset`, is 1"),
        ({"file": ""}, r"frames\[1\] has the file ''; want a file inside"),
        ({"file": "../0001.exr"}, r"frames\[1\] has the file '../0001.exr'; want a file inside"),
        ({"file": "/etc/passwd"}, r"frames\[1\] has the file '/etc/passwd'; want a file inside"),
        ({"file": "C:\\a.exr"}, r"frames\[1\] has the file .*with forward slashes"),
        ({"file": "0.exr"}, "0.exr is listed twice: in frame 0 and frame 1"),
        ({"typo": 1}, r"unknown field `typo` - at `\$\.frames\[1\]`"),
    ],
)
def test_invalid_fields_are_named(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    path = write(tmp_path, **changes)
    with pytest.raises(ShotError, match=message) as caught:
        load_shot_json(path)
    assert caught.value.path == path


def test_the_files_shown_in_the_docs_are_read(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "shots.md").read_text(encoding="utf-8")
    shot, channels, *_ = re.findall(r"```json\n(.*?)```", text, flags=re.DOTALL)
    (tmp_path / "shot.json").write_text(shot)
    info, entries = load_shot_json(tmp_path / "shot.json")
    assert (info.name, len(entries), entries[2].render_size) == ("plaza", 3, (288, 162))
    (tmp_path / "channels.json").write_text(channels)
    for name in ("depth", "motion", "reference"):
        write_exr(tmp_path / name / "0001.exr", np.ones((2, 2, 3), np.float32))
    with pytest.raises(ShotError, match=r"has no file \*\.exr"):  # all is right but the colour's files
        import_described_channels(tmp_path)
    for number, folder in product(range(49), (".", "depth", "motion")):
        write_exr(tmp_path / f"{folder}/{number:04d}.exr", np.ones((2, 2, 3), np.float32), compression="none")
    assert import_described_channels(tmp_path).read(48).frame.reset


# --- shots that share their display-size files; class maps beside a reference ---


SIZES = {"2x": (16, 9), "4x": (8, 5)}
RANDOM = np.random.default_rng(0)
CLASSES = ClassMaps(*(RANDOM.integers(0, 3, (18, 32)).astype(np.uint8) for _ in range(2)))


def sized_frame(index: int, size: tuple[int, int] = SIZE) -> Frame:
    depth = SCENE.frame(index, DISPLAY_SIZE, (0.0, 0.0)).depth
    return replace(frame(index, size=size), gbuffer_display={"depth": depth * (1 + index)})


def writer(folder: Path, **options: Any) -> ShotWriter:
    return ShotWriter(folder, name="test", display_size=DISPLAY_SIZE, frame_rate=30, **options)


def write_all(folder: Path, count: int = 2) -> None:
    writers = {variant: writer(folder, variant=variant) for variant in SIZES}
    for index, (variant, size) in product(range(count), SIZES.items()):
        given: dict[str, Any] = {"reference": truth_of(index), "classes": CLASSES, "shared": variant != "2x"}
        writers[variant].write(sized_frame(index, size), **given)


def test_variants_are_shots_of_their_own_over_one_set_of_references(tmp_path: Path) -> None:
    write_all(tmp_path)
    files = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*"))
    below = [f"{part}/000{i}.exr" for part in ("2x", "4x", "display", "reference") for i in (0, 1)]
    assert files == sorted([*below, "2x.json", "4x.json"])
    for variant, size in SIZES.items():
        for shot in (Shot.open(tmp_path / f"{variant}.json"), open_source(tmp_path / f"{variant}.json")):
            assert (len(shot), shot.render_size, shot.reference_indices) == (2, size, [0, 1])
            for item in shot:
                assert_same(item.frame, sized_frame(item.index, size))
                np.testing.assert_array_equal(item.reference, truth_of(item.index))


def test_a_variant_is_resumed_without_the_others(tmp_path: Path) -> None:
    write_all(tmp_path, count=1)
    for variant, lengths in (("4x", (1, 2)), ("2x", (2, 2))):  # the reference of the latter is the former's
        with writer(tmp_path, variant=variant, resume=True) as again:
            assert len(again) == 1
            again.write(sized_frame(1, SIZES[variant]), reference=truth_of(1))
        assert tuple(len(Shot.open(tmp_path / f"{name}.json")) for name in SIZES) == lengths
    with pytest.raises(ShotError, match=r"4x\.json: a shot of 2 frames already exists"):
        writer(tmp_path, variant="4x")


@pytest.mark.parametrize("compression", ["zip", "dwab:45"])
@pytest.mark.parametrize("thin", [None, CLASSES.ghost % 2])
def test_classes_and_planes_of_truth_are_kept(
    tmp_path: Path, compression: str, thin: NDArray[np.uint8] | None
) -> None:
    classes = replace(CLASSES, thin=thin)
    planes = {name: RANDOM.random((18, 32)).astype(np.float16) for name in ("thin", "moving")}
    with writer(tmp_path / "a", reference_compression=compression) as out:
        out.write(sized_frame(0), reference=truth_of(0))
        out.write(sized_frame(1))
        out.write(sized_frame(2), reference=truth_of(2), classes=classes, truth=planes)
    shot = Shot.open(tmp_path / "a")
    for one, index in ((shot, 2), (copy_shot(shot, tmp_path / "b"), 2), (shot.cropped(2, 9), 0)):
        found, truth = one.read_classes(index), one.read_truth(index)
        assert found is not None
        assert truth.keys() == planes.keys()
        np.testing.assert_equal(found.known(), classes.known())
        assert {array.dtype for array in found.known().values()} == {np.dtype(np.uint8)}
        for name, plane in planes.items():
            np.testing.assert_allclose(truth[name], plane, atol=0 if compression == "zip" else 0.2)
    for index in (0, 1):
        assert (shot.read_classes(index), shot.read_truth(index)) == (None, {})
    assert set(read_exr(tmp_path / "a" / "reference" / "0000.exr")) == {"R", "G", "B"}


# --- the shipped shot, which opens by its name ---


def test_the_shipped_shot_is_small_and_whole() -> None:
    shot = Shot.open("plaza")
    assert sum(path.stat().st_size for path in shot.path.rglob("*.*")) < 8e6
    assert (shot.render_size, shot.display_size, len(shot)) == ((320, 180), (640, 360), 16)
    assert shot.reference_indices == list(range(11, 16))
    assert (shot.info.license, shot.info.attribution) == ("Apache-2.0", ())
    last: Any = shot.read(15)
    assert (last.frame.color.dtype, last.frame.depth.dtype) == (np.float16, np.float32)
    assert last.reference.shape == (360, 640, 3)
    classes: Any = shot.read_classes(15)
    assert {0, 1, 2} == set(np.unique(classes.ghost)) == set(np.unique(classes.alias))


@pytest.mark.parametrize("open_shot", [Shot.open, open_source])
def test_a_shipped_shot_opens_by_name_unless_a_folder_has_that_name(
    open_shot: Callable[[str], Shot], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(open_shot("plaza")) == 16
    shutil.copytree(open_shot("plaza").path, "plaza")
    assert open_shot("plaza").path == Path("plaza")
