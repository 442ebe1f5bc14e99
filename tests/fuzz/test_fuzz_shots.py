"""Fuzz tests of shot.json, channels.json, jitter.json and upscale.json: read or refused with ShotError."""

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fuzzing import damaged, dumped, examples, replaced, run_apart
from noise import noise
from supersampler import Conventions, ShotError
from supersampler.cli.results import RunRecord, read_run_record
from supersampler.io.files import JSON_BYTES
from supersampler.io.shot import Shot, ShotWriter, open_source

FILES = ("0000.exr", "0001.exr", "display/0001.exr", "reference/0001.exr")
CHANNELS = {
    "channels": {
        "color": ["R", "G", "B"], "depth": "depth.Z", "motion": ["motion.X", "motion.Y"],
        "reference": ["reference/*.exr:R", "reference/*.exr:G", "reference/*.exr:B"],
    },
    "conventions": {"depth": "linear", "motion_unit": "ndc"},
    "frame_rate": 24, "cuts": [1], "display_size": [64, 36], "name": "kitchen",
}  # fmt: skip
RECORD = RunRecord({"shot": "/shots/a"}, {"####.exr": 2, "exr/####.exr": 9, "compare.html": 1})


def write_tiny(folder: Path) -> None:
    """A shot of two frames with all that shot.json can say, jitter.json, and a run's record."""
    conventions = Conventions(motion_jittered=True, motion_unit="uv")
    with ShotWriter(
        folder, name="tiny", display_size=(64, 36), frame_rate=30, conventions=conventions, attribution=["Me"]
    ) as writer:
        writer.write(noise(0))
        display = {"depth": np.ones((36, 64), np.float32)}
        reference = np.zeros((36, 64, 3), np.float32)
        writer.write(noise(1, gbuffer_display=display, exposure=0.5), reference=reference)
    (folder / "jitter.json").write_text("[[0.1, -0.2], [0.25, 0]]")
    (folder / "channels.json").write_text(json.dumps(CHANNELS))
    (folder / RECORD.file_name).write_text(json.dumps({**RECORD.settings, "files": dict(RECORD.files)}))


def text_of(content: Any, rng: np.random.Generator) -> bytes:
    """JSON in which something is other than it was, or bytes in which something is."""
    if rng.random() < 0.3:
        return damaged(json.dumps(content).encode(), rng)
    for _ in range(int(rng.integers(1, 4))):
        content = replaced(content, rng)
    return dumped(content)


def prepare() -> Callable[[int], object]:
    with tempfile.TemporaryDirectory() as place:
        write_tiny(Path(place))
        whole = {path.relative_to(place): path.read_bytes() for path in Path(place).rglob("*.*")}
    described = {name: json.loads(data) for name, data in whole.items() if name.suffix == ".json"}

    def run(case: int) -> None:
        folder, rng = Path("shot"), np.random.default_rng(case)
        for name, data in whole.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
        target = list(described)[case % len(described)]
        (folder / target).write_bytes(text_of(described[target], rng))
        if target.name == "upscale.json":
            record = read_run_record(folder)
            assert record is not None
            assert all(path.parent.parent in (Path(), folder) for path in record.own_files(folder))
        elif target.name == "shot.json":
            for item in Shot.open(folder):
                assert item.frame.color is None or np.isfinite(item.frame.jitter).all()
            shot = Shot.open(folder)
            shot.read(len(shot) - 1)
        else:
            (folder / "shot.json").unlink()
            list(open_source(folder))

    return run


def test_no_description_of_frames_harms_its_reader() -> None:
    assert run_apart(prepare, examples(60)) == []


# --- what is refused, and how it is said ---


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    write_tiny(tmp_path / "shot")
    (tmp_path / "shot" / "channels.json").unlink()
    return tmp_path / "shot"


def change(shot: Path, text: str, other: str) -> None:
    content = (shot / "shot.json").read_text()
    assert text in content
    (shot / "shot.json").write_text(content.replace(text, other, 1))


CHANGES = {
    "a number without end": ('"frame_rate": 30.0', f'"frame_rate": {10**400}', r"\$.frame_rate`, is 1000"),
    "a huge size": ("[32, 18]", f"[{10**9}, {10**9}]", r"<= 32768 - at `\$.render_size\[0\]`"),
    "many pixels": ('"display_size": [64, 36]', '"display_size": [32768, 32768]', "134217728 pixels"),
    "a long name": ('"0001.exr"', f'"{"a" * 300}.exr"', "a name longer than 255 bytes"),
    "a long path": ('"0001.exr"', f'"{"a/" * 5000}a.exr"', "the file of frame 1 is missing"),
    "deep nesting": ('"attribution": ["Me"]', f'"attribution": {"[" * 100_000}', "is not JSON"),
    "a zero byte": ('"0001.exr"', '"00\\u000001.exr"', "a file inside the shot's folder"),
}


@pytest.mark.parametrize("case", CHANGES)
def test_an_invalid_shot_is_a_shot_error(shot: Path, case: str) -> None:
    text, other, message = CHANGES[case]
    change(shot, text, other)
    with pytest.raises(ShotError, match=message):
        Shot.open(shot)


def test_a_nested_value_in_place_of_a_number_is_a_shot_error(shot: Path) -> None:
    (shot / "shot.json").unlink()
    nested = "[" * 100_000
    (shot / "channels.json").write_text(f'{{"channels": {{}}, "frame_rate": {nested}')
    with pytest.raises(ShotError, match=r"Expected `float \| null`, got `array` - at `\$\.frame_rate`"):
        open_source(shot)


def test_a_description_that_never_ends_or_is_too_large_is_refused(shot: Path) -> None:
    (shot / "shot.json").write_bytes(b" " * (JSON_BYTES + 1))
    with pytest.raises(ShotError, match="is larger than"):
        Shot.open(shot)
    (shot / "shot.json").unlink()
    os.mkfifo(shot / "shot.json")
    with pytest.raises(ShotError, match="is not a regular file"):
        Shot.open(shot)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_frames_do_not_follow_links_out_of_their_folder(shot: Path, name: str, kind: str) -> None:
    linked = shot / name if kind == "file" else (shot / name).parent
    if linked == shot:  # the shot's folder itself may be a link
        linked.rename(shot.with_name("away"))
        linked.symlink_to("away")
        assert len(list(Shot.open(shot))) == 2
        return
    linked.rename(shot.parent / "away")
    linked.symlink_to(shot.parent / "away")
    with pytest.raises(ShotError, match="leads out of"):
        Shot.open(shot)


def test_links_within_a_folder_are_followed(shot: Path) -> None:
    (shot / "0001.exr").rename(shot / "kept.exr")
    (shot / "0001.exr").symlink_to("kept.exr")
    assert len(list(Shot.open(shot))) == 2


@pytest.mark.parametrize("pattern", ["../*.exr", "/*.exr", "reference/../../*.exr", "{absolute}/*.exr"])
def test_patterns_do_not_leave_the_folder(shot: Path, pattern: str) -> None:
    (shot / "shot.json").unlink()
    (shot.parent / "0000.exr").write_bytes((shot / "0000.exr").read_bytes())
    pattern = pattern.format(absolute=shot.parent)
    content = {**CHANNELS, "channels": {**CHANNELS["channels"], "depth": f"{pattern}:depth.Z"}}  # type: ignore[dict-item]
    (shot / "channels.json").write_text(json.dumps(content))
    with pytest.raises(ShotError, match="matches no files in it"):
        open_source(shot)


def test_no_byte_of_a_file_outside_is_read_to_guess_a_layout(shot: Path) -> None:
    (shot / "shot.json").unlink()
    (shot / "0000.exr").unlink()
    (shot.parent / "secret").write_text("root:x:0")
    (shot / "0000.exr").symlink_to(shot.parent / "secret")
    with pytest.raises(ShotError, match=r"0000\.exr: leads out of"):
        open_source(shot)


def test_numbered_files_do_not_follow_links_out_of_their_folder(shot: Path) -> None:
    (shot / "shot.json").unlink()
    (shot / "channels.json").write_text(json.dumps(CHANNELS))
    (shot / "0001.exr").rename(shot.parent / "away.exr")
    (shot / "0001.exr").symlink_to(shot.parent / "away.exr")
    with pytest.raises(ShotError, match=r"0001\.exr: leads out of"):
        open_source(shot)
