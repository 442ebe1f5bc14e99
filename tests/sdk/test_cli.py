"""Tests of the `supersampler` command: resuming, complete output files, one-line errors, fast `--help`."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from supersampler import Frame
from supersampler.conventions import Conventions
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import Shot, ShotWriter
from supersampler.methods.registry import methods
from supersampler.upscaler import Upscaler
from upscale_runs import interrupt_at, refusal, run

COUNT = 6
CUT = 3
SHIPPED = "plaza"
UPSCALE = ("upscale", SHIPPED, "-o", "x")
HEAVY = ("onnxruntime", "numba", "OpenImageIO", "torch")


def frame(index: int) -> Frame:
    noise = np.random.default_rng(index)
    return Frame(
        color=noise.random((6, 8, 3), np.float32),
        depth=np.full((6, 8), 0.5, np.float32),
        motion=np.zeros((6, 8, 2), np.float32),
        jitter=(0.25, -0.125 * (index % 3)),
        reset=index in (0, CUT),
    )


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    with ShotWriter(tmp_path / "shot", name="tiny", display_size=(16, 12), frame_rate=30) as writer:
        for index in range(COUNT):
            writer.write(frame(index), reference=np.ones((12, 16, 3), np.float32) if index == 4 else None)
    return tmp_path / "shot"


def upscaled(path: Path, display_size: tuple[int, int]) -> list[np.ndarray]:
    """Return the images that the library makes of the shot."""
    upscaler = Upscaler("classifier", display_size=display_size)
    return [upscaler.step(item.frame) for item in Shot.open(path)]


def image_files(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in sorted(folder.glob("*.exr"))}


def test_help_and_version_load_nothing_heavy() -> None:
    code = f"""
import sys
from supersampler.cli import main
try:
    main()
except SystemExit as end:
    print([name for name in {HEAVY} if name in sys.modules], end.code)
"""
    for option in ("--help", "--version"):
        command = [sys.executable, "-c", code, option]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert done.stdout.splitlines()[-1] == "[] 0"


def test_the_module_is_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "supersampler", "--version"], capture_output=True, text=True)
    assert done.stdout.startswith("supersampler 0.")


@pytest.mark.parametrize(
    "command", ["demo", "upscale", "info", "check", "replay", "import", "render", "export", "bench"]
)
def test_every_command_has_help_and_the_top_lists_it(command: str) -> None:
    assert f"\n  {command} " in run("--help").output
    assert run(command, "--help").exit_code == 0


def test_upscale_writes_what_the_library_makes(shot: Path, tmp_path: Path) -> None:
    assert run("upscale", shot, "-o", tmp_path / "out").exit_code == 0
    for index, image in enumerate(upscaled(shot, (16, 12))):
        channels = read_exr(tmp_path / "out" / f"{index:04d}.exr")
        pixels = np.stack([channels[name] for name in "RGB"], axis=-1)
        np.testing.assert_array_equal(pixels, image.astype(np.float16))


@pytest.mark.parametrize(("option", "size"), [("--scale=1.5", (9, 12)), ("--display-size=20x10", (10, 20))])
def test_upscale_takes_a_scale_or_a_size(
    option: str, size: tuple[int, int], shot: Path, tmp_path: Path
) -> None:
    assert run("upscale", shot, "-o", tmp_path / "out", option, "--method", "bilinear").exit_code == 0
    assert read_exr(tmp_path / "out" / "0005.exr")["R"].shape == size


@pytest.mark.parametrize("stop", [2, 4])
def test_a_stopped_run_continues_to_the_same_images(
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
    assert f"All {COUNT} frames are there already" in again.stderr
    assert image_files(tmp_path / "out") == after


def test_a_page_that_is_asked_for_later_has_all_frames(shot: Path, tmp_path: Path) -> None:
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


def test_overwrite_keeps_what_is_there_until_the_new_settings_are_known_to_work(
    shot: Path, tmp_path: Path
) -> None:
    run("upscale", shot, "-o", tmp_path / "out")
    before = image_files(tmp_path / "out")
    assert "want a ratio from" in refusal("upscale", shot, "-o", tmp_path / "out", "--scale=9", "--overwrite")
    assert image_files(tmp_path / "out") == before


def test_a_doubtful_frame_is_named(tmp_path: Path) -> None:
    with ShotWriter(tmp_path / "shot", name="dark", display_size=None, frame_rate=30) as writer:
        for index in range(2):
            good = frame(index)
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
        (
            ("upscale", SHIPPED, "-o", "x", "--display-size", "1080p"),
            "--display-size is '1080p'; want WIDTHx",
        ),
        (
            ("upscale", SHIPPED, "-o", "x", "--scale=2", "--display-size=2x2"),
            "both given; want one of the two",
        ),
        ((*UPSCALE, "--method=a", "--model=b"), "both given; want one of the two"),
        ((*UPSCALE, "--method", "nope"), "no model 'nope'"),
        (
            ("upscale", SHIPPED, "-o", "x", "--providers", "abacus"),
            "no execution provider is called 'abacus'",
        ),
        (("import", "a.safetensors", "-o", "x"), "a.safetensors"),
        (("import", ".", "-o", "x", "--layout=blender", "--channels=none.json"), "--channels is none.json"),
        (("import", ".", "-o", "x", "--conventions", "opengl"), "want one of supersampler, fsr, xess"),
        (("import", ".", "-o", "x", "--cuts", "1;2"), "--cuts is '1;2'"),
    ],
)
def test_bad_arguments_are_one_line(
    arguments: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert message in refusal(*arguments)
    assert list(tmp_path.iterdir()) == []


def test_debug_and_bugs_keep_their_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    assert type(run("--debug", "info", "nothing").exception).__name__ == "ShotError"
    monkeypatch.setattr("supersampler.methods.model_file.model_names", lambda: 1 / 0)
    assert type(run("info").exception).__name__ == "ZeroDivisionError"


RUNTIME_ONLY = dict.fromkeys(("torch", "onnx", "onnxscript", "tensorboard", "moderngl", "safetensors"))


@pytest.mark.parametrize("command", ["train", "export", "render"])
def test_help_of_a_tool_works_in_a_runtime_only_install(command: str) -> None:
    code = f"import sys; sys.modules.update({RUNTIME_ONLY}); from supersampler.cli import main; main()"
    words = [sys.executable, "-c", code, command, "--help"]
    done = subprocess.run(words, capture_output=True, text=True, env={**os.environ, "COLUMNS": "1000"})
    assert (done.returncode, done.stderr) == (0, "")
    assert f"Usage: supersampler {command}" in done.stdout
    marked = "gbuffer-4x (no weights ship), gbuffer-depth (no weights ship)"
    assert (marked in " ".join(done.stdout.split())) == (command != "render")


@pytest.mark.parametrize("name", methods())
def test_info_knows_every_method_and_says_where_no_weights_ship(name: str) -> None:
    done = run("info", name)
    assert done.exit_code == 0
    assert re.search(rf"^method +{name}$", done.stdout, re.MULTILINE)
    assert ("none ship" in done.stdout) == (not methods()[name].ships)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("info", "clasifier"), "Did you mean 'classifier'?"),
        (("info", "plazza"), "Did you mean 'plaza'?"),
        ((*UPSCALE, "--model", "tau"), "Did you mean 'taau'?"),
        ((*UPSCALE, "--model", "gbuffer"), "No weights of it ship: `supersampler info gbuffer`."),
        ((*UPSCALE, "--preset", "fst"), "Did you mean 'fast'?"),
        ((*UPSCALE, "--providers", "cudda"), "Did you mean 'cuda'?"),
        (("export", "clasifier", "-o", "x"), "Did you mean 'classifier'?"),
        (("train", "clasifier", "-o", "x"), "Did you mean 'classifier'?"),
    ],
)
def test_a_misspelt_word_is_answered_with_the_one_that_it_is_like(
    words: tuple[str, ...], hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run(*words)
    assert done.exit_code in (1, 2)
    assert done.stderr.endswith(f"{hint}\n")


def test_demo_writes_frames_and_a_page(shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short = Shot.open(shot)
    monkeypatch.setattr("supersampler.io.shot.Shot.open", lambda _: short)
    done = run("demo", "-o", tmp_path / "out")
    assert done.exit_code == 0
    page = tmp_path / "out" / "compare.html"
    made = page.stat().st_mtime_ns
    run("demo", "-o", tmp_path / "out")
    assert page.stat().st_mtime_ns == made  # not anew
    assert str(tmp_path / "out" / "compare.html") in done.stdout
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "compare.html",
        "exr",
        "png",
        "upscale.json",
    ]


def test_info_names_what_a_model_takes_and_a_shot_holds(shot: Path) -> None:
    assert "color  float32 (1, 3, render_height, render_width)" in run("info", "taau").stdout
    said = run("info", shot).stdout
    assert "render size   8x6" in said
    assert "references    1 frames" in said


def test_import_by_a_channel_map(tmp_path: Path) -> None:
    grey = np.full((6, 8), 0.5, np.float32)
    for index in range(2):
        layers = dict.fromkeys(("R", "G", "B", "Z", "U", "V"), grey)
        write_exr(tmp_path / "renders" / f"{index}.exr", layers)
    channel_map = {"color": ["R", "G", "B"], "depth": "Z", "motion": ["U", "V"]}
    (tmp_path / "map.json").write_text(json.dumps(channel_map))
    arguments = ("import", tmp_path / "renders", "-o", tmp_path / "shot", "--channels", tmp_path / "map.json")
    assert "--conventions is left out; want given" in refusal(*arguments)
    done = run(*arguments, "--conventions", '{"motion_unit": "uv"}', "--frame-rate", "25", "--cuts", "1")
    assert done.exit_code == 0
    written = Shot.open(tmp_path / "shot")
    assert (len(written), written.frame_rate, written.conventions.motion_unit) == (2, 25.0, "uv")
    assert written.read(1).frame.reset


def test_check_exits_with_1_where_the_shot_is_not_what_it_says(tmp_path: Path) -> None:
    assert run("check", SHIPPED).exit_code == 0
    source, wrong = Shot.open("plaza"), Conventions(motion_direction="current_minus_previous")
    with ShotWriter(
        tmp_path, name="wrong", display_size=(640, 360), frame_rate=30, conventions=wrong
    ) as writer:
        for index in range(6):
            writer.write(source.read_raw(index))
    done = run("check", tmp_path)
    assert done.exit_code == 1
    assert done.stdout.endswith("Write: Conventions()\n")
