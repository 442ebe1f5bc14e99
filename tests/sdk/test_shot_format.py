"""Tests of shot.json: errors name the file, the key and the frame."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from supersampler import ShotError
from supersampler.conventions import Conventions
from supersampler.io.images import write_exr
from supersampler.io.shot import FrameEntry, ShotInfo, import_described_channels
from supersampler.io.shot.format import load_shot_json, shot_json

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
        ({"version": None}, "the file has no 'version'"),
        ({"render_size": None}, "the file has no 'render_size'"),
        ({"render_size": [8, 0]}, r"render_size is \[8, 0\]; want \[width, height\], both > 0"),
        ({"display_size": [8.5, 3]}, r"display_size is \[8.5, 3\]"),
        ({"frame_rate": 0}, r"frame_rate is 0; want frames a second, > 0"),
        ({"attribution": [1]}, r"attribution is .*; want a list of texts"),
        ({"aov_names": ["A", "A"]}, r"aov_names is .*; want names that differ, and are not R, G or B"),
        ({"aov_names": ["G"]}, r"aov_names is .*; want names that differ"),
        ({"aov_names": [""]}, r"aov_names\[0\] is ''; want printable text"),
        ({"conventions": {"no_such": 1}}, '"conventions" is not valid: '),
        ({"frames": {}}, r"frames is {}; want a list"),
        ({"frames": [3]}, r"frames\[0\] is 3; want an object"),
        ({"fps": 3}, "the file has the unknown key 'fps'"),
        ({"jitter": None}, r"frames\[1\] has no 'jitter'"),
        ({"jitter": [0.1]}, r"frames\[1\]\.jitter is \[0.1\]; want \[x, y\]"),
        ({"jitter": ["a", 0]}, r"frames\[1\]\.jitter\[0\] is 'a'; want a number"),
        ({"reset": 1}, r"frames\[1\]\.reset is 1; want true or false"),
        ({"exposure": "auto"}, r"frames\[1\]\.exposure is 'auto'; want a number"),
        ({"file": ""}, r"frames\[1\]\.file is ''; want a file inside"),
        ({"file": "../0001.exr"}, r"frames\[1\]\.file is '../0001.exr'; want a file inside"),
        ({"file": "/etc/passwd"}, r"frames\[1\]\.file is '/etc/passwd'; want a file inside"),
        ({"file": "C:\\a.exr"}, r"frames\[1\]\.file is .*with forward slashes"),
        ({"file": "0000.exr"}, "0000.exr is listed twice: in frame 0 and frame 1"),
        ({"reference": "reference/0000.exr"}, "reference/0000.exr is listed twice"),
        ({"typo": 1}, r"frames\[1\] has the unknown key 'typo'"),
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
        (b"{", r"is not JSON \(Expecting .*line 1"),
        (b"\xff\xfe\x00", "is not JSON"),
        (b"[]", r"the file is \[\]; want an object"),
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
