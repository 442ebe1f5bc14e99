"""Tests of file removal and path checks: temporary files, and output apart from the input."""

import os
import re
from pathlib import Path

import pytest

from supersampler import ShotError
from supersampler.io.files import check_apart, check_inside, is_regular, remove_partial_files

NAMES = re.compile(r"\d{4}\.exr|shot\.json")


def made(*paths: Path) -> None:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")


def test_only_leftovers_of_the_files_that_were_being_written_are_removed(tmp_path: Path) -> None:
    ours = [".0003.01234567.partial.exr", "below/.shot.89abcdef.partial.json"]
    kept = [
        ".a.01234567.partial.exr",  # not one of NAMES
        ".0003.partial.exr", ".0003.0123456g.partial.exr",  # not called as we call them
        "below/deep/.0003.01234567.partial.exr", "other/.0003.01234567.partial.exr", "0003.exr",
    ]  # fmt: skip
    made(*(tmp_path / name for name in [*ours, *kept]))
    (tmp_path / ".0004.01234567.partial.exr").symlink_to(tmp_path / "0003.exr")
    (tmp_path / "link").symlink_to(tmp_path / "other")
    remove_partial_files(tmp_path, NAMES.fullmatch, ["below", "link", "none"])
    left = sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if is_regular(p))
    assert left == sorted(kept)


def test_an_input_below_a_link_is_held_by_the_folder_that_the_link_leads_to(tmp_path: Path) -> None:
    (tmp_path / "disk" / "shot").mkdir(parents=True)
    (tmp_path / "here").symlink_to("disk")
    with pytest.raises(ShotError, match="holds the input"):
        check_apart(tmp_path / "disk", tmp_path / "here" / "shot")
    with pytest.raises(ShotError, match="lies in the input"):
        check_apart(tmp_path / "here" / "shot" / "out", tmp_path / "disk" / "shot")


def test_links_and_names_that_leave_a_folder_are_refused_and_others_are_not(tmp_path: Path) -> None:
    made(tmp_path / "shot" / "a", tmp_path / "shot" / "sub" / "b", tmp_path / "c", tmp_path / "d" / "e")
    shot = tmp_path / "shot"
    (shot / "inner").symlink_to("sub/b")
    (shot / "file").symlink_to(tmp_path / "c")
    (shot / "folder").symlink_to(tmp_path / "d")
    (tmp_path / "link").symlink_to("shot")
    check_inside(shot, [shot / "a", shot / "inner", shot / "sub" / ".." / "a"])
    check_inside(tmp_path / "link", [tmp_path / "link" / "a", tmp_path / "link" / "sub" / "b"])
    for name in ("file", "folder/e", "../c", os.fspath(tmp_path / "c")):
        with pytest.raises(ShotError, match="leads out of"):
            check_inside(shot, [shot / "a", shot / name])
