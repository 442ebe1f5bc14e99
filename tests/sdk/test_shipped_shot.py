"""Tests that the shipped shot opens by its name."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from supersampler import ShotError
from supersampler.io.shot import Shot, open_source


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
