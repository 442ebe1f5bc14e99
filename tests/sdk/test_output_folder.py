"""Tests that `upscale`, `replay` and `import` replace and remove only files that they wrote."""

import json
import os
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noise import noise
from supersampler import ShotError
from supersampler.cli.results import Results, read_run_record
from supersampler.io.files import FolderLock, check_apart, check_inside, is_regular, remove_partial_files
from supersampler.io.images import write_exr
from supersampler.io.shot import Shot, ShotWriter, copy_shot
from upscale_runs import interrupt_at, refusal, run, upscale, write_shot

COUNT = 4
FOREIGN = "upscale.json does not list it"


def content(folder: Path) -> dict[str, bytes | str]:
    """All that is in a folder: bytes of files, targets of links."""
    return {
        path.relative_to(folder).as_posix(): str(path.readlink()) if path.is_symlink() else path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_symlink() or path.is_file()
    }


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    return write_shot(tmp_path / "shot", COUNT)


def refused(shot: Path, output: Path, *options: object) -> str:
    return refusal("upscale", shot, "-o", output, "--method", "bilinear", *options)


@pytest.mark.parametrize("where", ["shot", "shot/out", ".", "link", "link/out"])
@pytest.mark.parametrize("options", [(), ("--overwrite",)])
def test_an_output_that_overlaps_the_shot_is_refused(
    shot: Path, where: str, options: tuple[str, ...]
) -> None:
    (shot.parent / "link").symlink_to("shot")
    before = content(shot.parent)
    for source in (shot, shot / "shot.json"):
        assert "the input" in refused(source, shot.parent / where, *options)
    assert content(shot.parent) == before


@pytest.mark.parametrize("is_range", [False, True])
@pytest.mark.parametrize("options", [("--overwrite",), ("--frames", "1-2")])
def test_runs_write_into_one_folder_at_once_only_if_they_have_ranges(
    shot: Path, tmp_path: Path, is_range: bool, options: tuple[str, ...]
) -> None:
    upscale(shot, tmp_path / "out")
    before = content(tmp_path / "out")
    with FolderLock(tmp_path / "out", is_shared=is_range):
        if is_range and "--frames" in options:
            upscale(shot, tmp_path / "out", *options, "--preroll", "4", "--at-rest", "converge")
        else:
            assert "out: another run writes to it. Wait for it" in refused(shot, tmp_path / "out", *options)
            assert content(tmp_path / "out") == before
    upscale(shot, tmp_path / "out")


def test_a_run_that_began_in_a_new_folder_after_the_checks_of_another_is_kept(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, check = tmp_path / "out", Results._check_free

    def other_begins(results: Results, *arguments: Any) -> None:
        check(results, *arguments)
        monkeypatch.undo()
        upscale(shot, out)

    monkeypatch.setattr(Results, "_check_free", other_begins)
    assert "another run are there: method was bilinear, is now bicubic" in refused(
        shot, out, "--method", "bicubic"
    )
    upscale(shot, out)


def test_a_run_stopped_before_its_first_image_may_be_followed_by_another(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        interrupt_at(0, patch)
        assert run("upscale", shot, "-o", tmp_path / "out", "--method", "bicubic").exit_code == 130
    upscale(shot, tmp_path / "out")


def test_overwrite_removes_what_the_record_lists_and_nothing_else(shot: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    upscale(shot, out, "--format", "png", "--format", "exr", "--compare")
    foreign = {
        "20240102.png": b"a",
        "exr/0099.exr": b"b",
        "png/notes.txt": b"c",
        "0000.exr": b"d",
        "1.png": b"e",
    }
    for name, data in foreign.items():
        (out / name).write_bytes(data)
    assert "formats was ['exr', 'png'], is now ['png']. Choose another folder, or --overw" in refused(
        shot, out, "--format", "png"
    )
    upscale(shot, out, "--format", "png", "--overwrite")
    after = content(out)
    assert after.keys() == {*foreign, "upscale.json", *(f"{i:04d}.png" for i in range(COUNT))}
    assert {name: after[name] for name in foreign} == foreign


@pytest.mark.parametrize("kind", ["file", "folder", "link", "dangling link"])
@pytest.mark.parametrize("run", ["first", "first with --overwrite", "second with --overwrite"])
def test_a_foreign_file_in_the_way_is_kept(shot: Path, tmp_path: Path, run: str, kind: str) -> None:
    out, options = tmp_path / "out", ("--overwrite",) if "--overwrite" in run else ()
    if "second" in run:
        upscale(shot, out, "--format", "png")
    path = out / "0002.exr"
    path.parent.mkdir(exist_ok=True)
    match kind:
        case "file":
            path.write_bytes(b"mine")
        case "folder":
            path.mkdir()
        case _:
            path.symlink_to(shot / "0001.exr" if kind == "link" else "nowhere")
    before = content(tmp_path)
    assert f"{path}: already exists, and {FOREIGN}" in refused(shot, out, *options)
    assert content(tmp_path) == before


def test_a_foreign_page_is_not_replaced(shot: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "compare.html").write_text("mine")
    assert f"compare.html: already exists, and {FOREIGN}" in refused(shot, out, "--compare")
    assert content(out) == {"compare.html": b"mine"}
    upscale(shot, out)
    assert f"compare.html: already exists, and {FOREIGN}" in refused(shot, out, "--compare")
    assert (out / "compare.html").read_text() == "mine"


def test_a_file_is_listed_before_it_is_written(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, write = tmp_path / "out", write_exr

    def checked(path: Path, *values: Any, **options: Any) -> None:
        record = read_run_record(out)  # otherwise a run that continues a killed one would refuse the file
        assert record is not None
        assert record.lists("####.exr", int(path.stem))
        write(path, *values, **options)

    monkeypatch.setattr("supersampler.cli.results.images.write_exr", checked)
    upscale(shot, out)


def test_a_record_of_any_depth_is_read_or_refused(tmp_path: Path) -> None:
    """Two JSON readers run in turn; their limits of nesting differ."""
    for depth in range(100, 1100):
        nested = "[" * depth + "]" * depth
        (tmp_path / "upscale.json").write_text(f'{{"a": {nested}, "files": {{}}}}')
        with suppress(ShotError):
            read_run_record(tmp_path)


def test_a_record_that_does_not_list_its_files_is_refused_with_what_to_do(shot: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    upscale(shot, out)
    settings = json.loads((out / "upscale.json").read_text())
    del settings["files"]
    (out / "upscale.json").write_text(json.dumps(settings))
    before = content(out)
    for options in ((), ("--overwrite",)):
        message = refused(shot, out, *options)
        assert "does not list the files of its run: it is of an earlier version" in message
        assert "Remove the files of that run and upscale.json yourself, or choose another folder." in message
        assert content(out) == before


@pytest.mark.parametrize("linked", ["0001.exr", "exr", "upscale.json"])
def test_links_in_place_of_listed_files_are_kept(shot: Path, tmp_path: Path, linked: str) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    formats = ("--format", "exr", "--format", "png") if linked == "exr" else ()
    upscale(shot, out, *formats)
    (out / linked).rename(elsewhere)
    (out / linked).symlink_to(elsewhere)
    before = content(tmp_path)
    assert "upscale.json does not list it" in refused(shot, out, *formats, "--overwrite")
    assert content(tmp_path) == before


@pytest.mark.parametrize("option", ["--record", "-o"])
def test_files_in_the_way_of_a_recording_or_replay_are_kept(shot: Path, tmp_path: Path, option: str) -> None:
    recording, out = tmp_path / "a.recording", tmp_path / "out"
    upscale(shot, out, "--record", recording)
    before = content(tmp_path)
    if option == "-o":
        assert f"{out}: already exists" in refusal("replay", recording, "-o", out)
    for options in ((), ("--overwrite",)):
        assert f"{recording}: already exists" in refused(shot, out, *options, "--record", recording)
    assert content(tmp_path) == before


@pytest.mark.parametrize("recording", ["out", "."])
def test_a_recording_is_not_the_output_or_around_it(shot: Path, tmp_path: Path, recording: str) -> None:
    folder = tmp_path / "new"
    message = refused(shot, folder / "out", "--record", folder / recording)
    assert f"is or holds the output, {folder / 'out'}" in message
    assert not folder.exists()


def test_a_run_that_failed_before_its_first_image_leaves_no_record(shot: Path, tmp_path: Path) -> None:
    out, frame = tmp_path / "out", (shot / "0000.exr").read_bytes()
    (shot / "0000.exr").write_bytes(frame[:-1000])
    assert "cannot be read" in refused(shot, out)
    assert not content(out)
    (shot / "0000.exr").write_bytes(frame)
    upscale(shot, out, "--format", "png")


def test_a_replay_writes_its_images_into_a_folder_of_their_own(shot: Path, tmp_path: Path) -> None:
    recording, out = tmp_path / "a.recording", tmp_path / "again"
    upscale(shot, tmp_path / "out", "--record", recording)
    assert "holds the input" in refusal("replay", recording, "-o", tmp_path)
    assert run("replay", recording, "-o", out).exit_code == 0
    assert sorted(content(out)) == [f"{i:04d}.exr" for i in range(COUNT)]


# --- import ---


@pytest.mark.parametrize("where", ["shot", "shot/copy", "."])
def test_an_import_into_its_source_is_refused(shot: Path, where: str) -> None:
    (shot / "shot.json").rename(shot.parent / "kept.json")
    channels = {"color": ["R", "G", "B"], "depth": "depth.Z", "motion": ["motion.X", "motion.Y"]}
    (shot / "channels.json").write_text(json.dumps({"channels": channels, "conventions": {}}))
    before = content(shot.parent)
    assert "the input" in refusal("import", shot, "-o", shot.parent / where)
    assert content(shot.parent) == before


@pytest.mark.parametrize("name", ["0000.exr", "0001.exr"])
def test_a_shot_does_not_overwrite_foreign_files(shot: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / name).write_bytes(b"mine")
    with pytest.raises(ShotError, match=rf"{name}: already exists, and shot\.json does not list it"):
        copy_shot(Shot.open(shot), tmp_path / "copy", resume=True)
    assert (tmp_path / "copy" / name).read_bytes() == b"mine"
    (tmp_path / "copy" / name).unlink()
    assert len(copy_shot(Shot.open(shot), tmp_path / "copy", resume=True)) == COUNT
    assert not list((tmp_path / "copy").glob(".*"))


def test_a_run_killed_before_a_frame_is_listed_goes_on(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object) -> None:
        raise SystemExit

    with monkeypatch.context() as patch:
        patch.setattr("supersampler.io.shot.writer.shot_json", killed)
        with pytest.raises(SystemExit):
            copy_shot(Shot.open(shot), tmp_path / "copy")
    assert "0000.exr" in content(tmp_path / "copy")
    assert len(copy_shot(Shot.open(shot), tmp_path / "copy")) == COUNT
    assert not list((tmp_path / "copy").glob(".*"))


def test_a_shot_is_not_written_through_a_link_out_of_its_folder(shot: Path, tmp_path: Path) -> None:
    frame = noise(0, gbuffer_display={"depth": np.ones((36, 64), np.float32)})
    (tmp_path / "elsewhere").mkdir()
    writer = ShotWriter(tmp_path / "new", name="new", display_size=(64, 36), frame_rate=30)
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "display").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ShotError, match="leads out of"):
        writer.write(frame)
    assert content(tmp_path / "elsewhere") == {}


# --- removal of files and checks of paths ---


NUMBERED = re.compile(r"\d{4}\.exr|shot\.json")


def made(*paths: Path) -> None:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")


def test_only_leftovers_of_the_files_that_were_being_written_are_removed(tmp_path: Path) -> None:
    ours = [".0003.01234567.partial.exr", "below/.shot.89abcdef.partial.json"]
    kept = [
        ".a.01234567.partial.exr",  # not one of NUMBERED
        ".0003.partial.exr", ".0003.0123456g.partial.exr",  # not called as we call them
        "below/deep/.0003.01234567.partial.exr", "other/.0003.01234567.partial.exr", "0003.exr",
    ]  # fmt: skip
    made(*(tmp_path / name for name in [*ours, *kept]))
    (tmp_path / ".0004.01234567.partial.exr").symlink_to(tmp_path / "0003.exr")
    (tmp_path / "link").symlink_to(tmp_path / "other")
    remove_partial_files(tmp_path, NUMBERED.fullmatch, ["below", "link", "none"])
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
