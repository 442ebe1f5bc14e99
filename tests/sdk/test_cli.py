"""Tests of the `supersampler` command: resuming, complete output files, one-line errors, fast `--help`."""

import ast
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from rich.table import Table

from commands import finished, ran
from supersampler import Conventions, Upscaler
from supersampler.cli import app
from supersampler.cli.app import EXTRAS, TOOLS
from supersampler.cli.results import DEMO, SOURCE, read_run_record
from supersampler.cli.terminal import Terminal
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import Shot, ShotWriter
from supersampler.methods.registry import methods
from upscale_runs import (
    DISPLAY_SIZE,
    images,
    interrupt_at,
    moving,
    pixels,
    refusal,
    run,
    succeeded,
    write_shot,
)

COUNT = 6
SHIPPED = "plaza"
UPSCALE = ("upscale", SHIPPED, "-o", "x")
HEAVY = ("onnxruntime", "OpenImageIO", "torch")


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    return write_shot(tmp_path / "shot", COUNT, cuts=(3,), references=(4,))


def image_files(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in sorted(folder.glob("*.exr"))}


def python(code: str, *words: str, **options: Any) -> "subprocess.CompletedProcess[str]":
    return finished(sys.executable, "-c", code, *words, **options)


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_load_nothing_heavy(option: str) -> None:
    code = f"""
import sys
from supersampler.cli import main
try:
    main()
except SystemExit as end:
    print([name for name in {HEAVY} if name in sys.modules], end.code)
"""
    assert python(code, option).stdout.splitlines()[-1] == "[] 0"


def test_the_module_is_the_command() -> None:
    assert ran(sys.executable, "-m", "supersampler", "--version").startswith("supersampler 0.")


def test_upscale_writes_what_the_library_makes(shot: Path, tmp_path: Path) -> None:
    assert run("upscale", shot, "-o", tmp_path / "out").exit_code == 0
    upscaler = Upscaler("classifier", display_size=DISPLAY_SIZE)
    for item in Shot.open(shot):
        stored = pixels(tmp_path / "out" / f"{item.index:04d}.exr")
        np.testing.assert_array_equal(stored, upscaler.step(item.frame).astype(np.float16))


@pytest.mark.parametrize(("option", "size"), [("--scale=1.5", (27, 48)), ("--display-size=40x20", (20, 40))])
def test_upscale_takes_scale_or_size(option: str, size: tuple[int, int], shot: Path, tmp_path: Path) -> None:
    assert run("upscale", shot, "-o", tmp_path / "out", option, "--method", "bilinear").exit_code == 0
    assert read_exr(tmp_path / "out" / "0005.exr")["R"].shape == size


@pytest.mark.parametrize("stop", [2, 4])
def test_a_stopped_run_continues(
    stop: int, shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run("upscale", shot, "-o", tmp_path / "whole")
    with monkeypatch.context() as patch:
        interrupt_at(stop, patch)
        stopped = run("upscale", shot, "-o", tmp_path / "out")
    assert stopped.exit_code == 130
    assert f"{stop} of {COUNT} frames are complete" in stopped.stderr
    before = image_files(tmp_path / "out")
    assert run("upscale", shot, "-o", tmp_path / "out").exit_code == 0
    after = image_files(tmp_path / "out")
    assert {name: after[name] for name in before} == before  # neither changed nor written anew
    whole = image_files(tmp_path / "whole")
    assert [data for data, _ in after.values()] == [data for data, _ in whole.values()]
    again = run("upscale", shot, "-o", tmp_path / "out")
    assert f"All {COUNT} frames are complete already" in again.stderr
    assert image_files(tmp_path / "out") == after


def test_a_page_requested_later_has_all_frames(shot: Path, tmp_path: Path) -> None:
    run("upscale", shot, "-o", tmp_path / "out")
    before = image_files(tmp_path / "out")
    assert run("upscale", shot, "-o", tmp_path / "out", "--compare").exit_code == 0
    html = (tmp_path / "out" / "compare.html").read_text(encoding="utf-8")
    assert html.count('/output">data:') == COUNT
    assert html.count('/error">data:') == 1
    assert image_files(tmp_path / "out") == before


def test_other_settings_need_overwrite(shot: Path, tmp_path: Path) -> None:
    run("upscale", shot, "-o", tmp_path / "out", "--format", "png")
    other = ("upscale", shot, "-o", tmp_path / "out", "--method", "bilinear", "--scale", "1")
    message = refusal(*other)
    assert "method was classifier, is now bilinear" in message
    assert "--overwrite" in message
    assert run(*other, "--overwrite").exit_code == 0
    assert len(image_files(tmp_path / "out")) == COUNT
    assert list((tmp_path / "out").glob("*.png")) == []  # the earlier run's


def test_overwrite_keeps_what_is_there_until_the_new_settings_work(shot: Path, tmp_path: Path) -> None:
    run("upscale", shot, "-o", tmp_path / "out")
    before = image_files(tmp_path / "out")
    assert "want a ratio from" in refusal("upscale", shot, "-o", tmp_path / "out", "--scale=9", "--overwrite")
    assert image_files(tmp_path / "out") == before


def test_a_doubtful_frame_is_named(tmp_path: Path) -> None:
    with ShotWriter(tmp_path / "shot", name="dark", display_size=None, frame_rate=30) as writer:
        for index in range(2):
            good = moving(index)
            writer.write(replace(good, color=np.full_like(good.color, np.nan)) if index == 1 else good)
    warned = run("upscale", tmp_path / "shot", "-o", tmp_path / "out")
    assert warned.exit_code == 0
    assert "warning: frame 1: frame.color" in warned.stderr
    message = refusal("upscale", tmp_path / "shot", "-o", tmp_path / "strict", "--validate", "strict")
    assert f"{tmp_path / 'shot'}: frame 1: frame.color" in message
    assert list(image_files(tmp_path / "strict")) == ["0000.exr"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("info", "nothing"), "nothing: there is no such file or folder"),
        (("upscale", SHIPPED, "-o", "x", "--scale=2", "--display-size=2x2"), "with --display-size; want one"),
        ((*UPSCALE, "--method=a", "--model=b"), "given with --model; want one of the two"),
        ((*UPSCALE, "--method", "nope"), "no model 'nope'"),
        ((*UPSCALE, "--providers", "abacus"), "no execution provider is called"),
        (("import", "a.safetensors", "-o", "x"), "a.safetensors"),
        (("import", ".", "-o", "x", "--layout=blender", "--channels=none.json"), "--channels is none.json"),
        (("info", "clasifier"), "Did you mean 'classifier'?\n"),
        (("info", "plazza"), "Did you mean 'plaza'?\n"),
        ((*UPSCALE, "--model", "tau"), "Did you mean 'taau'?\n"),
        ((*UPSCALE, "--model", "gbuffer"), "No weights of it ship: `supersampler info gbuffer`.\n"),
        ((*UPSCALE, "--providers", "cudda"), "Did you mean 'cuda'?\n"),
        (("export", "clasifier", "-o", "x"), "Did you mean 'classifier'?\n"),
        (("train", "clasifier", "-o", "x"), "Did you mean 'classifier'?\n"),
    ],
)
def test_bad_arguments_are_one_line(
    arguments: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert message in refusal(*arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (
            (*UPSCALE, "--preset", "fst"),
            "'--preset': 'fst' is not one of 'fast', 'balanced', 'high'. Did you mean",
        ),
    ],
)
def test_a_value_that_no_option_takes_is_named_with_the_nearest_one(
    words: tuple[str, ...], hint: str
) -> None:
    done = run(*words)
    assert done.exit_code == 2
    assert f"Error: Invalid value for {hint}" in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        (*UPSCALE[:2], "-o", ""),
        (*UPSCALE, "--scratch", ""),
        (*UPSCALE, "--record", ""),
        ("demo", "-o", ""),
        ("demo", "--web", "--write", ""),
        ("replay", "x", "-o", ""),
        ("render", ""),
        ("train", "taau", "-o", ""),
        ("export", "taau", "-o", ""),
        ("bench", "pareto", "-o", ""),
        ("bench", "shots", ""),
    ],
)
def test_an_unset_variable_of_a_shell_is_no_folder_to_write(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run(*words)
    assert (done.exit_code, "'' is no folder" in done.stderr) == (2, True), done.stderr
    assert list(tmp_path.iterdir()) == []


def test_debug_and_bugs_keep_their_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    assert type(run("--debug", "info", "nothing").exception).__name__ == "ShotError"
    monkeypatch.setattr("supersampler.methods.model_file.model_names", lambda: 1 / 0)
    assert type(run("info").exception).__name__ == "ZeroDivisionError"


RUNTIME_ONLY = dict.fromkeys(("torch", "onnx", "onnxscript", "tensorboard", "moderngl"))


@pytest.mark.parametrize("command", ["train", "export", "render"])
def test_help_of_a_tool_works_in_a_runtime_only_install(command: str) -> None:
    code = f"import sys; sys.modules.update({RUNTIME_ONLY}); from supersampler.cli import main; main()"
    done = python(code, command, "--help", COLUMNS="1000")
    assert (done.returncode, done.stderr) == (0, "")
    assert f"Usage: supersampler {command}" in done.stdout
    marked = "gbuffer (no weights ship), gbuffer-4x (no weights ship)"
    assert (marked in " ".join(done.stdout.split())) == (command != "render")


def test_info_says_which_providers_of_onnx_runtime_run_a_models_nodes() -> None:
    done = run("info", "taau", "--providers")
    assert done.exit_code == 0
    assert re.search(r"^cpu +\d{3,} nodes by CPUExecutionProvider$", done.stdout, re.MULTILINE)


@pytest.mark.parametrize("name", methods())
def test_info_knows_every_method_and_says_where_no_weights_ship(name: str) -> None:
    done = run("info", name)
    assert done.exit_code == 0
    assert re.search(rf"^method +{name}$", done.stdout, re.MULTILINE)
    assert ("none ship" in done.stdout) == (not methods()[name].ships)


def test_info_names_what_a_model_takes_and_a_shot_holds(shot: Path) -> None:
    assert "color  float32 (1, 3, render_height, render_width)" in run("info", "taau").stdout
    said = run("info", shot).stdout
    assert "render size   32x18" in said
    assert "references    1 frames" in said


def test_import_by_a_channel_map(tmp_path: Path) -> None:
    grey = np.full((6, 8), 0.5, np.float32)
    for index in range(2):
        layers = dict.fromkeys(("R", "G", "B", "Z", "U", "V"), grey)
        write_exr(tmp_path / "renders" / f"{index}.exr", layers)
    channel_map = {"color": ["R", "G", "B"], "depth": "Z", "motion": ["U", "V"]}
    (tmp_path / "map.json").write_text(json.dumps(channel_map), "utf-8-sig")  # as editors on Windows do
    arguments = ("import", tmp_path / "renders", "-o", tmp_path / "shot", "--channels", tmp_path / "map.json")
    assert "--conventions is left out; want given" in refusal(*arguments)
    info = ("info", tmp_path / "renders", "--channels", tmp_path / "map.json")
    assert "--conventions is left out; want given" in refusal(*info)
    assert "render size   8x6" in run(*info, "--conventions", "unreal").stdout
    done = run(*arguments, "--conventions", '{"motion_unit": "uv"}', "--frame-rate", "25", "--cuts", "1")
    assert done.exit_code == 0
    written = Shot.open(tmp_path / "shot")
    assert (len(written), written.frame_rate, written.conventions.motion_unit) == (2, 25.0, "uv")
    assert written.read(1).frame.reset


@pytest.mark.parametrize("sign", [1, -1])
def test_check_exits_with_1_and_an_option_where_a_shot_is_not_as_stated(tmp_path: Path, sign: int) -> None:
    assert run("check", SHIPPED).exit_code == 0
    source, subtract = Shot.open("plaza"), Conventions(motion_direction="current_minus_previous")
    renders = tmp_path / "renders"
    for index in range(6):
        raw = source.read_raw(index)
        planes = np.dstack([np.asarray(raw.color), raw.depth, raw.motion * sign]).astype(np.float32)
        write_exr(renders / f"{index}.exr", planes, ["R", "G", "B", "Z", "motion.X", "motion.Y"])
    (renders / "jitter.json").write_text(json.dumps([source.read_raw(index).jitter for index in range(6)]))
    stated, found = [json.dumps(subtract.to_json()), "supersampler"][::sign]
    done = run("check", renders, "--conventions", stated)
    assert done.exit_code == 1
    *_, write, option = done.stdout.splitlines()
    assert write == f"Write: {Conventions() if sign == 1 else subtract}"
    assert shlex.split(option) == ["--conventions", found]
    assert run("check", renders, *shlex.split(option)).exit_code == 0
    run("import", renders, "-o", tmp_path / "shot", "--conventions", stated)
    *_, line = run("check", tmp_path / "shot").stdout.splitlines()
    written = (tmp_path / "shot" / "shot.json").read_text()
    (tmp_path / "shot" / "shot.json").write_text(
        re.sub('"conventions": {.*}', line.removeprefix("In shot.json: "), written)
    )
    assert run("check", tmp_path / "shot").exit_code == 0
    assert "Change shot.json instead." in run("check", tmp_path / "shot", *shlex.split(option)).stderr


@pytest.mark.parametrize("srgb", [True, False])
def test_clipped_colour_is_no_news_where_the_shot_states_srgb(tmp_path: Path, srgb: bool) -> None:
    options: dict[str, Any] = {"display_size": None, "frame_rate": 24, "conventions": Conventions(srgb=srgb)}
    with ShotWriter(tmp_path / "shot", name="lit", **options) as writer:
        for index in range(2):
            frame = Shot.open("plaza").read(index).frame
            writer.write(replace(frame, color=np.minimum(np.float32(2.0) * np.asarray(frame.color), 1)))
    upscaled = run("upscale", tmp_path / "shot", "-o", tmp_path / "out", "--method", "bilinear")
    for told in (upscaled.stderr, run("check", tmp_path / "shot").stdout):
        assert ("color is never above 1" in told) != srgb


# --- damaged or strange input files give one line of error, never a traceback ---


DEEP = "[" * 100_000
CHANNELS = {"color": ["R", "G", "B"], "depth": "Z", "motion": ["U", "V"]}


def file(name: str, content: bytes = b"") -> Callable[[Path], str]:
    def made(folder: Path) -> str:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
        return str(folder / name)

    return made


def pipe(folder: Path) -> str:
    (folder / "shot").mkdir()
    os.mkfifo(folder / "shot" / "shot.json")
    return str(folder / "shot")


def inside(name: str, content: bytes) -> Callable[[Path], str]:
    """A folder that holds one file."""
    return lambda folder: os.path.dirname(file(f"in/{name}", content)(folder))  # noqa: PTH120


PATHS: dict[str, Callable[[Path], str]] = {
    "nothing": lambda folder: str(folder / "none"),
    "a long name": lambda folder: str(folder / ("a" * 300)),
    "a long path": lambda folder: str(folder / ("a/" * 3000)),
    "a name alone": lambda _: "b" * 5000,
    "below a file": lambda folder: file("plain")(folder) + "/shot.json",
    "a folder of nothing": lambda folder: str(folder),
    "a folder called as a file": lambda folder: os.path.dirname(file("a.json/x")(folder)),  # noqa: PTH120
    "an empty file": file("a.safetensors"),
    "no text": file("a.json", b"\xff\xfe\0"),
    "deep JSON": file("a.json", DEEP.encode()),
    "other JSON": file("a.json", b"[1, 2]"),
    "a pipe": pipe,
    "a broken EXR": inside("0000.exr", b"v/1\x01\2\0\0\0"),
    "another image as an EXR": inside("0000.exr", b"\x89PNG\r\n\x1a\n"),
    "a broken channels.json": inside("channels.json", b"{"),
    "no frames": inside("shot.json", b'{"version": 1}'),
    "a training set": inside("dataset.json", DEEP.encode()),
    "a training set of words": inside("dataset.json", b'{"version": 1, "sequences": "x"}'),
}


@pytest.mark.parametrize("command", ["info", "check", "upscale", "import", "replay"])
@pytest.mark.parametrize("path", PATHS)
def test_any_path_is_one_line_of_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, path: str
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    given = PATHS[path](tmp_path / "here")
    output = ("-o", str(tmp_path / "out")) if command in ("upscale", "import", "replay") else ()
    refusal(command, given, *output)
    assert not (tmp_path / "out").exists()


@pytest.fixture
def one_frame(tmp_path: Path) -> Path:
    return write_shot(tmp_path / "tiny", 1)


@pytest.mark.parametrize("output", ["plain", "plain/out", "a" * 300, "x/" * 3000, "/proc/none"])
@pytest.mark.parametrize("command", ["upscale", "import", "demo"])
def test_an_impossible_output_is_one_line(one_frame: Path, tmp_path: Path, command: str, output: str) -> None:
    (tmp_path / "plain").write_text("kept")
    source = () if command == "demo" else (str(one_frame),)
    options = ("--method", "bilinear") if command != "import" else ()
    done = run(command, *source, "-o", tmp_path / output, *options)
    assert isinstance(done.exception, SystemExit), repr(done.exception)
    assert (done.exit_code, done.stderr.splitlines()[-1][:7]) == (1, "error: ")
    assert ("A file has the name of the folder." in done.stderr) == output.startswith("plain")
    assert (tmp_path / "plain").read_text() == "kept"


@pytest.mark.parametrize("option", ["--jitter", "--channels", "--conventions"])
@pytest.mark.parametrize("content", [b"\xff\xfe", b"", DEEP.encode(), b"[1]", b'{"a": 1e999}', b"3"])
def test_any_file_of_an_option_is_one_line_of_error(tmp_path: Path, option: str, content: bytes) -> None:
    grey = np.full((6, 8), 0.5, np.float32)
    write_exr(tmp_path / "in" / "0000.exr", dict.fromkeys(("R", "G", "B", "Z", "U", "V"), grey))
    (tmp_path / "map.json").write_text(json.dumps(CHANNELS))
    (tmp_path / "given").write_bytes(content)
    options = {"--channels": tmp_path / "map.json", "--conventions": "unreal", option: tmp_path / "given"}
    listed = [str(part) for pair in options.items() for part in pair]
    refusal("import", tmp_path / "in", "-o", tmp_path / "out", *listed)
    assert not (tmp_path / "out").exists()


def test_an_error_that_quotes_much_of_a_file_is_short(tmp_path: Path) -> None:
    entry = {"dtype": "F32", "shape": [0], "data_offsets": [0, 0]}
    header = json.dumps({f"{number:0200}": entry for number in range(1000)}).encode()
    (tmp_path / "a.safetensors").write_bytes(len(header).to_bytes(8, "little") + header)
    line = refusal("info", tmp_path / "a.safetensors")
    assert len(line) < 2100
    assert "has no tensor colour_linear" in line
    assert line.rstrip().endswith("999.")


def test_names_in_a_file_cannot_control_the_terminal(one_frame: Path) -> None:
    content = (one_frame / "shot.json").read_text().replace('"tiny"', '"\\u001b[2J\\nwhat"')
    (one_frame / "shot.json").write_text(content)
    done = run("info", one_frame)
    assert (done.exit_code, "?[2J" in done.stdout) == (0, True)
    terminal = Terminal()
    with terminal.capture() as shown:
        terminal.print("\x1b[3J\nb", Table("\x1b[2J", title="[b]"), soft_wrap=True)
    assert "\x1b" not in shown.get()
    assert all(text in shown.get() for text in ("?[3J\nb", "?[2", "[b]"))
    (one_frame / "0000.exr").write_bytes(b"")
    refusal("info", one_frame)


def test_lines_are_printed_where_the_width_of_the_terminal_is_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "0")
    terminal = Terminal()
    with terminal.capture() as shown:
        terminal.print("a line")
        terminal.print("another", soft_wrap=True)
    assert shown.get() == "a line\nanother\n"


# --- option names: messages name only options that exist; one thing has one name ---


ROOT = Path(__file__).parents[2]
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
CALL = re.compile(r"`supersampler (\w+)([^`]*)")
OTHERS = {"--help", "--version", "--debug"} | {
    "--abbrev", "--always", "--dirty",  # git
    "--background", "--python", "--python-exit-code",  # Blender
    "--collect-all",  # PyInstaller
    "--reference-samples", "--variant",  # denoise_scenes.py, which runs where bpy is
}  # fmt: skip
"""Options of all commands, and of other programs."""


@cache
def commands() -> dict[str, frozenset[str]]:
    """Options of all commands; those of groups are called "bench quality"."""
    found = {}
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        each = typer.main.get_command(import_module(TOOLS[name][0]).app) if name in TOOLS else command
        for sub, one in getattr(each, "commands", {"": each}).items():
            options = (text for p in one.params for text in (*p.opts, *p.secondary_opts))
            found[f"{name} {sub}".strip()] = frozenset(options)
    return found


def test_every_command_has_help_and_the_top_lists_it() -> None:
    top = run("--help").output
    for command in commands():
        assert f"\n  {command.split()[0]} " in top
        assert run(*command.split(), "--help").exit_code == 0, command


def messages(file: Path) -> Iterator[str]:
    """Yield the texts of a module that name options; those of f-strings have NAME for each field."""
    tree = ast.parse(file.read_text("utf-8"))
    nodes = list(ast.walk(tree))
    skipped = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(p.value) if isinstance(p, ast.Constant) else "NAME" for p in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
            yield node.value


@pytest.mark.parametrize("folder", ["sdk/supersampler", "model", "export", "bench/supersampler_bench"])
def test_messages_name_only_options_that_exist(folder: str) -> None:
    known = frozenset().union(OTHERS, *commands().values())
    wrong = []
    for file in sorted((ROOT / folder).rglob("*.py")):
        for text in messages(file):
            wrong += [f"{file.name}: {option}" for option in OPTION.findall(text) if option not in known]
            for name, rest in CALL.findall(text):
                own = frozenset().union(*(o for c, o in commands().items() if c.split()[0] == name))
                wrong += [f"{file.name}: {name} {o}" for o in OPTION.findall(rest) if o not in own | OTHERS]
    assert not wrong, wrong


# --- what is printed where an extra is missing or the reader of a pipe has gone: a line, or nothing ---


IMPORTED_AS = {"flip-evaluator": "flip_evaluator", "cvvdp": "pycvvdp"}
NOT_COMMANDS = {"docs", "dev"}
CLOSED = """
import os, sys
out, pipe = os.pipe()
os.close(out)
os.dup2(pipe, 1)
from supersampler.cli import main
main()
"""


def test_every_package_of_an_extra_is_known_to_the_error_message() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for extra, packages in extras.items():
        for package in packages if extra not in NOT_COMMANDS else ():
            name = package.partition(">")[0].partition("=")[0]
            found = EXTRAS[IMPORTED_AS.get(name, name)]
            assert any(each.startswith(name) for each in extras[found])


@pytest.mark.parametrize(
    ("missing", "words", "extra"),
    [
        ("matplotlib", ["bench", "still", "-o", "x"], "bench"),
        ("matplotlib", ["bench", "pareto", "-o", "x"], "bench"),
        ("pycvvdp", ["bench", "quality", "plaza", "--cvvdp"], "cvvdp"),
        ("onnx", ["bench", "cost"], "train"),
        ("torch", ["bench", "parity"], "train"),
        ("moderngl", ["bench", "parity", "--methods", "bilinear", "--frames", "10"], "render"),
        ("torch", ["train", "classifier", "-o", "x"], "train"),
        ("torch", ["export", "taau", "-o", "x"], "train"),
        ("av", ["upscale", "plaza", "-o", "x", "--format", "mp4", "--method", "bilinear"], "video"),
    ],
)
def test_a_missing_extra_is_named_in_a_line(
    missing: str, words: list[str], extra: str, tmp_path: Path
) -> None:
    code = f"import sys; sys.modules.update({missing}=None); from supersampler.cli import main; main()"
    done = python(code, *words, folder=tmp_path)
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert f"needs {missing}" in last
    assert last.endswith(f'pip install "supersampler[{extra}]"')
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "words",
    [["--help"], ["bench", "--help"], ["bench", "latency", "--help"], ["train", "--help"], ["info", "plaza"]],
)
def test_a_closed_output_pipe_ends_without_a_message(words: list[str]) -> None:
    assert python(CLOSED, *words).stderr == ""


def test_a_run_whose_output_pipe_closes_does_not_count_as_done(tmp_path: Path) -> None:
    words = ["upscale", "plaza", "-o", str(tmp_path / "out"), "--method", "bilinear", "--json"]
    stopped = python(CLOSED, *words)
    assert (stopped.returncode, stopped.stderr) == (141, "")
    assert not (tmp_path / "out" / "0015.exr").exists()
    assert python("from supersampler.cli import main; main()", *words).returncode == 0
    assert (tmp_path / "out" / "0015.exr").exists()


# --- `supersampler demo` ---


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Demos of two frames."""
    whole = Shot.open
    monkeypatch.setattr(Shot, "open", lambda path: whole(path).cropped(0, 1))


@pytest.mark.usefixtures("short")
def test_demo_writes_frames_and_a_page_once(tmp_path: Path) -> None:
    page = tmp_path / "compare.html"
    assert str(page) in succeeded(run("demo", "-o", tmp_path)).stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["compare.html", "exr", "png", "upscale.json"]
    made = page.stat().st_mtime_ns
    run("demo", "-o", tmp_path)
    assert page.stat().st_mtime_ns == made


@pytest.mark.usefixtures("short")
def test_a_demo_of_another_method_replaces_the_earlier_one_and_leaves_other_files(tmp_path: Path) -> None:
    assert run("demo", "-o", tmp_path, "--method", "bilinear").exit_code == 0
    first = images(tmp_path)
    (tmp_path / "exr" / "mine.exr").write_bytes(b"mine")
    assert run("demo", "-o", tmp_path, "--method", "taa").exit_code == 0
    second = images(tmp_path)
    assert second.pop("exr/mine.exr") == b"mine"
    assert first.keys() == second.keys()
    assert first["png/0001.png"] != second["png/0001.png"]


@pytest.mark.usefixtures("short")
def test_a_demo_replaces_the_results_of_another_command_only_when_told(tmp_path: Path) -> None:
    run("upscale", "plaza", "-o", tmp_path, "--method", "bilinear", "--format", "exr", "--format", "png")
    upscaled = images(tmp_path)
    refused = run("demo", "-o", tmp_path, "--method", "taa")
    assert refused.exit_code == 1
    assert "or --overwrite to start over" in refused.stderr
    assert images(tmp_path) == upscaled
    assert run("demo", "-o", tmp_path, "--method", "taa", "--overwrite").exit_code == 0
    record: Any = read_run_record(tmp_path)
    assert record.settings[SOURCE] == DEMO


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("words", [["--help"], ["--version"], ["info", "plaza"]])
def test_a_full_disk_is_named_in_a_line(words: list[str]) -> None:
    code = """
import os
os.dup2(os.open("/dev/full", os.O_WRONLY), 1)
from supersampler.cli import main
main()
"""
    done = python(code, *words)
    assert (done.returncode, done.stderr) == (1, "error: [Errno 28] No space left on device\n")


def test_a_signal_before_the_command_begins_stops_it_in_a_line() -> None:
    code = """
import os, signal
import typer
from supersampler.cli import main
typer.main.get_command = lambda _: os.kill(os.getpid(), signal.SIGTERM)
main()
"""
    done = python(code)
    assert (done.returncode, done.stderr) == (143, "stopped\n")


@pytest.mark.skipif(os.name != "posix", reason="this system keeps the working directory of a process")
def test_a_working_directory_that_is_gone_is_named(tmp_path: Path) -> None:
    (gone := tmp_path / "gone").mkdir()
    code = f"""
import os
os.chdir({str(gone)!r})
os.rmdir({str(gone)!r})
from supersampler.cli import main
main()
"""
    done = python(code, "upscale", "plaza", "-o", "out")
    line = "error: the working directory no longer exists. Change to another one.\n"
    assert (done.returncode, done.stderr) == (1, line)
