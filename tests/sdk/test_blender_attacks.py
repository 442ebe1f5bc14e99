"""Attacks by a .blend file, an add-on or a hanging Blender: on files, on the terminal, and hangs."""

import json
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from blender_files import RECORDED, fake_blender, scene_file
from supersampler.cli import app

CAMERA = json.loads((RECORDED / "render.json").read_text())["frames"][0]


def blender(folder: Path, *options: object, **plan: Any) -> Result:
    command = ["blender", scene_file(folder, **plan), "-o", folder / "out", "--method", "bilinear"]
    command += ["--blender", fake_blender(folder), *options]
    before = threading.active_count()
    result = CliRunner().invoke(app, [str(word) for word in command])
    until = time.monotonic() + 5.0
    while threading.active_count() > before and time.monotonic() < until and "daughter" not in plan:
        time.sleep(0.01)
    return result


def error_of(result: Result) -> str:
    assert result.exit_code == 1, result.output
    return result.stderr.splitlines()[-1]


@pytest.mark.parametrize("prefix", ["supersampler ", "", "0" * 32, "\x1b[2K"])
def test_a_line_that_the_scene_forges_moves_no_file(tmp_path: Path, prefix: str) -> None:
    """Blender prints the path of a missing image as it is, with line ends."""
    secret = tmp_path / "id_ed25519"
    secret.write_text("key")
    forged = json.dumps({"frame": 5, "file": str(secret), **CAMERA})
    done = blender(tmp_path, prints=f"cannot read 'a\n{prefix}{forged}\n{prefix}{{}}\nb'\n")
    assert done.exit_code == 0, done.output
    assert secret.read_text() == "key"
    assert len(list((tmp_path / "out" / "render").glob("*.exr"))) == 4
    assert blender(tmp_path, "--overwrite").exit_code == 0
    assert secret.read_text() == "key"


def test_a_line_without_an_end_before_a_message_does_not_hide_it(tmp_path: Path) -> None:
    assert blender(tmp_path, prints="Warning: " + "x" * 3_000_000).exit_code == 0


@pytest.mark.parametrize(
    ("line", "want"),
    [
        ("[]", "Expected `object`, got `array`"),
        ("1", "Expected `object`, got `int`"),
        ("{}", "has no note, scene, frame or error"),
        ("{", "is not JSON"),
        ("[" * 100_000, "Expected `object`, got `array`"),
        ('{"frame": 5}', "has no note, scene, frame or error"),
        (json.dumps({"frame": 6, **CAMERA}), "reports frame 6; want 0, the next one"),
        (json.dumps({"frame": "../5", **CAMERA}), "got `str` - at `$.frame`, is '../5'"),
        (json.dumps({"frame": 10**30, **CAMERA}), "reports frame 1000"),
        (json.dumps({"scene": {}}), "missing required field `name` - at `$.scene`"),
        (json.dumps({"error": "a\x1b[31m\nb"}), "a?[31m?b"),
    ],
)
def test_a_message_that_is_none_ends_the_render_with_one_line(tmp_path: Path, line: str, want: str) -> None:
    assert want in error_of(blender(tmp_path, ours=[line]))
    assert not list((tmp_path / "out").rglob("*.exr"))


def test_names_are_no_markup_and_send_no_control_codes(tmp_path: Path) -> None:
    done = blender(tmp_path, note="view layer 'beauty [/x] [red]\x1b]0;title\x07\u202e' is rendered :smile:")
    assert done.exit_code == 0, done.output
    assert "view layer 'beauty [/x] [red]?]0;title??' is rendered :smile:" in done.stderr
    log = blender(tmp_path, "--overwrite", prints="\x1b[31mred\x07\n")
    assert log.exit_code == 0, log.output
    text = (tmp_path / "out" / "render" / "blender.log").read_text("utf-8")
    assert "?[31mred?" in text


@pytest.mark.parametrize("name", ["blender.log", "render.json"])
@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize("options", [(), ("--overwrite",)])
def test_files_of_others_beside_the_frames_are_kept(
    tmp_path: Path, name: str, *, linked: bool, options: tuple[str, ...]
) -> None:
    path, other = tmp_path / "out" / "render" / name, tmp_path / "other"
    path.parent.mkdir(parents=True)
    (other if linked else path).write_text("mine")
    if linked:
        path.symlink_to(other)
    assert name in error_of(blender(tmp_path, *options))
    assert path.read_text() == "mine"


def test_settings_of_others_are_kept_and_in_nobodys_way(tmp_path: Path) -> None:
    path = tmp_path / "out" / "render" / "settings.json"
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    assert blender(tmp_path).exit_code == 0
    assert path.read_text() == "mine"


def test_a_file_of_others_that_appears_meanwhile_is_kept(tmp_path: Path) -> None:
    late = tmp_path / "out" / "render" / "0007.exr"

    def appear() -> None:
        while not (tmp_path / "out" / "0005.exr").exists():
            time.sleep(0.01)
        late.write_text("mine")
        (tmp_path / "go").touch()

    thread = threading.Thread(target=appear)
    thread.start()
    line = error_of(blender(tmp_path, wait_at=7, **{"for": str(tmp_path / "go")}))
    thread.join(60)
    assert "0007.exr: is there already, and render.json does not list it" in line
    assert late.read_text() == "mine"


def test_a_link_in_place_of_a_frame_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The temporary names of a run are drawn, but a program could look at the folder."""
    monkeypatch.setattr("supersampler.integrations.blender.render.secrets.token_hex", lambda _: "01234567")
    (tmp_path / "secret").write_text("key")
    render = tmp_path / "out" / "render"
    render.mkdir(parents=True)
    (render / ".0005.01234567.partial.exr").symlink_to(tmp_path / "secret")
    record = json.loads((RECORDED / "render.json").read_text())
    scene, message = json.dumps({"scene": record["scene"]}), json.dumps({"frame": 5, **CAMERA})
    assert "0005.exr: was not written" in error_of(blender(tmp_path, ours=[scene, message], error="end"))
    assert (tmp_path / "secret").read_text() == "key"


@pytest.mark.long  # waits for seconds
def test_a_blender_that_ignores_signals_is_killed(tmp_path: Path) -> None:
    began = time.monotonic()
    assert "no camera" in error_of(blender(tmp_path, stubborn=True, error="no camera"))
    assert time.monotonic() - began < 60
    assert not is_running(int((tmp_path / "pid").read_text()))


@pytest.mark.long  # waits for seconds
def test_a_program_that_blender_started_and_left_behind_does_not_make_the_command_wait(
    tmp_path: Path,
) -> None:
    began = time.monotonic()
    assert "SIGABRT" in error_of(blender(tmp_path, daughter=120, crash_at=6))
    assert time.monotonic() - began < 60


def is_running(pid: int) -> bool:
    state = Path(f"/proc/{pid}/stat")
    return state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z"
