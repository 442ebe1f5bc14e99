"""Child processes end with their parent, however it ends: commands, and the extension."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import supersampler
from blender_files import SECONDS, fake_blender, is_running, scene_file, wait_until
from native_build import module_of
from supersampler.cli import app
from supersampler.io.child_process import ChildProcess, end_text, run

TESTS = Path(__file__).parents[1]
EXTENSION = Path(supersampler.__file__).parent / "integrations" / "blender" / "extension" / "run.py"


def signals(*, ignored: bool) -> Callable[[], None]:
    """Return a function that ignores SIGINT and SIGHUP, as `nohup` does, or restores their defaults."""
    how = signal.SIG_IGN if ignored else signal.SIG_DFL

    def apply() -> None:
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, how)

    return apply


def command(folder: Path, *, ignored: bool = False, **plan: Any) -> "subprocess.Popen[str]":
    """A `supersampler blender` whose Blender hangs at its second frame."""
    program, scene = fake_blender(folder), scene_file(folder, hang_at=6, **plan)
    words = [sys.executable, "-m", "supersampler", "blender", str(scene), "-o", str(folder / "out")]
    process = subprocess.Popen(
        [*words, "--method", "bilinear", "--blender", str(program)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=signals(ignored=ignored),
    )
    wait_until(lambda: (folder / "out" / "0005.exr").exists())
    return process


@pytest.mark.parametrize(
    ("number", "code", "stubborn"),
    [
        (signal.SIGINT, 130, False),
        (signal.SIGHUP, 129, False),
        (signal.SIGTERM, 143, True),  # Blender ignores it
        (signal.SIGKILL, -9, True),
    ],
)
def test_blender_ends_with_its_command(
    tmp_path: Path, number: signal.Signals, code: int, *, stubborn: bool
) -> None:
    process = command(tmp_path, **({"stubborn": True} if stubborn else {}))
    pid = int((tmp_path / "pid").read_text())
    assert is_running(pid)
    process.send_signal(number)
    _, text = process.communicate(timeout=SECONDS)
    assert process.returncode == code
    wait_until(lambda: not is_running(pid))
    if number != signal.SIGKILL:
        assert "Stopped: 1 of 4 frames are complete." in text
        assert not [path for path in (tmp_path / "out").rglob("*") if ".partial" in path.name]


def test_signals_that_are_ignored_stay_ignored_and_sigterm_ends_the_command(tmp_path: Path) -> None:
    process = command(tmp_path, ignored=True)
    pid = int((tmp_path / "pid").read_text())
    for number in (signal.SIGINT, signal.SIGHUP):
        process.send_signal(number)
    time.sleep(1.0)
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=SECONDS)
    assert process.returncode == 143
    wait_until(lambda: not is_running(pid))


@pytest.fixture(scope="module")
def extension() -> Any:
    """The extension's module run.py, loaded without its package, which imports bpy."""
    return module_of(EXTENSION, "extension_run")


@pytest.fixture
def ignored() -> Any:
    """SIGINT is ignored in this process and those that it starts, as under `nohup` or `&`."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    yield
    signal.signal(signal.SIGINT, before)


def test_records_in_the_output_folder_neither_block_blender_nor_fill_its_memory(
    extension: Any, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "upscale.0001-0002.json")
    (tmp_path / "upscale.0003-0004.json").symlink_to("/dev/zero")
    (tmp_path / "upscale.0005-0006.json").write_text('{"files": {"####.exr": 2}}' + " " * (1 << 26))
    (tmp_path / "upscale.json").write_text('{"files": {"####.exr": 3}}')
    running = extension.Run([sys.executable, "-c", ""], tmp_path, 9)
    while running.wait(0.1):
        pass
    assert running.done == 3


@pytest.mark.usefixtures("ignored")
def test_cancel_works_where_sigint_is_ignored(
    extension: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extension, "_PATIENCE", 1e9)  # to ask is enough
    scene, program, out = scene_file(tmp_path, hang_at=6), fake_blender(tmp_path), tmp_path / "out"
    words = ["blender", str(scene), "-o", str(out), "--method", "bilinear", "--blender", str(program)]
    main = [sys.executable, "-P", "-c", "from supersampler.cli import main; main()"]
    running = extension.Run([*main, *words], out, 4)
    wait_until(lambda: (out / "0005.exr").exists())
    pid = int((tmp_path / "pid").read_text())
    began = time.monotonic()
    running.cancel()
    while running.wait(0.1):
        assert time.monotonic() - began < SECONDS
    assert (running.done, running.error) == (1, "")
    assert running.notes[-2] == "Stopped: 1 of 4 frames are complete."
    wait_until(lambda: not is_running(pid))


def test_a_command_that_ignores_cancel_is_killed(
    extension: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extension, "_PATIENCE", 1000.0)
    deaf = "import signal, time; {} open('begun', 'w').close(); time.sleep(600)"
    for ignore, code in (("", -15), ("signal.signal(signal.SIGTERM, signal.SIG_IGN);", -9)):
        folder = tmp_path / str(-code)
        folder.mkdir()
        monkeypatch.chdir(folder)
        running = extension.Run([sys.executable, "-c", deaf.format(ignore)], folder, 3)
        wait_until(lambda: (folder / "begun").exists())  # noqa: B023  # called at once
        running.cancel()
        assert running.pump()
        running._cancelled -= 1500.0  # terminated from now on
        assert running.pump()
        if ignore:
            running._cancelled -= 1000.0  # killed from now on
        while running.wait(0.05):
            pass
        assert (running._process.returncode, running.error) == (code, "")


def test_a_command_of_the_extension_ends_with_blender(tmp_path: Path) -> None:
    scene, program = scene_file(tmp_path, hang_at=6), fake_blender(tmp_path)
    code = f"""
import pathlib, sys, time
sys.path.insert(0, {str(TESTS)!r})
from native_build import module_of
module = module_of(pathlib.Path({str(EXTENSION)!r}))
words = ["from supersampler.cli import main; main()", "blender", {str(scene)!r}]
words += ["-o", {str(tmp_path / "out")!r}, "--method", "bilinear", "--blender", {str(program)!r}]
run = module.Run([sys.executable, "-P", "-c", *words], pathlib.Path("out"), 4)
print(run._process.pid, flush=True)
time.sleep(600)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as blender:
        assert blender.stdout is not None
        command_pid = int(blender.stdout.readline())
        wait_until(lambda: (tmp_path / "out" / "0005.exr").exists())
        blender.kill()
    pid = int((tmp_path / "pid").read_text())
    wait_until(lambda: not is_running(command_pid) and not is_running(pid))


LISTS_FRAMES = """
import json, pathlib, sys, time
out = pathlib.Path(sys.argv[1])
print("motion blur is off", file=sys.stderr, flush=True)
for count, name, done in (1, "", 1), (2, "", 2), (3, ".0004", 1):
    part = out / "part"
    part.write_text(json.dumps({"files": {"exr/####.exr": done, "png/####.png": done, "compare.html": 1}}))
    part.replace(out / f"upscale{name}.json")
    while not (out / f"go{count}").exists():
        time.sleep(0.01)
"""


def ended(running: Any) -> Any:
    """Wait until a command of the extension has ended, and return it."""
    while running.wait(0.1):
        pass
    return running


def test_progress_is_the_number_of_listed_frames(extension: Any, tmp_path: Path) -> None:
    running = extension.Run([sys.executable, "-c", LISTS_FRAMES, str(tmp_path)], tmp_path, 3)
    for count in (1, 2, 3):
        wait_until(lambda: running.pump() and running.done == count)  # noqa: B023  # called at once
        (tmp_path / f"go{count}").touch()
    ended(running)
    assert (running.done, running.error, running.notes) == (3, "", ["motion blur is off"])


def test_the_last_line_of_a_failed_command_is_the_error(extension: Any, tmp_path: Path) -> None:
    for code, error in (
        ("import sys; print('error: no camera', file=sys.stderr); sys.exit(1)", "no camera"),
        ("raise SystemExit(7)", "the command ended with 7"),
    ):
        running = ended(extension.Run([sys.executable, "-c", code], tmp_path, 3))
        assert (running.done, running.error) == (0, error)
    with pytest.raises(OSError, match="nowhere"):
        extension.Run([str(tmp_path / "nowhere")], tmp_path, 3)


def test_the_extensions_commands_are_accepted(extension: Any, tmp_path: Path) -> None:
    blender, frames = str(fake_blender(tmp_path)), tmp_path / "out" / "render"
    rendered = extension.render_command(
        "supersampler", str(scene_file(tmp_path)), tmp_path / "out", blender=blender, frames=(5, 6),
        scene="Scene", samples=4, scale=2.0, format="exr", overwrite=True,  # the recorded scene has no view
    )  # fmt: skip
    upscaled = extension.command_line(
        "supersampler", "upscale", frames, tmp_path / "again", scale=2.0, format="png", overwrite=False
    )
    for command in (rendered, upscaled):
        done = CliRunner().invoke(app, [*command[1:], "--method", "bilinear"])
        assert done.exit_code == 0, done.output
    assert sorted(path.name for path in (tmp_path / "again").glob("*.png")) == ["0005.png", "0006.png"]


@pytest.mark.parametrize("content", ["", "[]", '{"files": {"#": []}}', "[" * 100_000])
def test_a_foreign_record_counts_as_no_progress(extension: Any, tmp_path: Path, content: str) -> None:
    (tmp_path / "upscale.json").write_text(content)
    running = ended(extension.Run([sys.executable, "-c", "print('x' * 10**6)"], tmp_path, 3))
    assert (running.done, running.error) == (0, "")


def test_messages_of_a_command_are_bounded(extension: Any, tmp_path: Path) -> None:
    code = "import sys; sys.stderr.write('x' * 10**6 + '\\n' + 'line\\n' * 5000 + 'last\\n'); sys.exit(1)"
    running = ended(extension.Run([sys.executable, "-c", code], tmp_path, 3))
    assert running.error == "last"
    assert len(running.notes) <= 1000
    assert max(map(len, running.notes)) <= 4096


def test_a_program_runs_with_its_output_its_folder_and_its_code(tmp_path: Path) -> None:
    done = run(["sh", "-c", "pwd; echo e >&2; exit 3"], folder=tmp_path, seconds=SECONDS)
    assert (done.returncode, done.stdout, done.stderr) == (3, f"{tmp_path}\n".encode(), b"e\n")
    assert run(["sh", "-c", "kill -ABRT $$"], seconds=SECONDS).returncode == 128 + signal.SIGABRT
    assert [end_text(code) for code in (0, 3, 134, 255, None)] == [
        "code 0", "code 3", "SIGABRT", "code 255", "code None",
    ]  # fmt: skip
    with pytest.raises(FileNotFoundError, match="No such file"):
        run(["no-such-program"], seconds=SECONDS)


def test_a_program_that_takes_too_long_is_ended_with_what_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    communicate, started = subprocess.Popen.communicate, tmp_path / "pid"

    def begun(process: "subprocess.Popen[bytes]", timeout: float) -> object:
        wait_until(lambda: started.exists() and started.read_text())  # which may take longer than the time
        return communicate(process, timeout=timeout)

    monkeypatch.setattr(subprocess.Popen, "communicate", begun)
    script = f"trap '' TERM; sleep 300 & echo $! > {started}; while :; do sleep 1; done"
    with pytest.raises(subprocess.TimeoutExpired):
        run(["sh", "-c", script], seconds=0.5)
    wait_until(lambda: not is_running(int(started.read_text())))


@pytest.mark.parametrize("frozen", [False, True])
def test_close_ends_a_program_whose_supervisor_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, frozen: bool
) -> None:
    monkeypatch.setattr("supersampler.io.child_process.GRACE", 0.5)
    if frozen:
        monkeypatch.setattr(sys, "executable", str(shutil.which("sleep")))
    child: Any = ChildProcess(["sh", "-c", f"trap '' TERM; echo $$ > {tmp_path}/pid; sleep 300"])
    wait_until(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
    if not frozen:
        os.kill(child._process.pid, signal.SIGSTOP)
    child.close()
    child.output.close()
    child._process.wait(SECONDS)
    wait_until(lambda: not is_running(int((tmp_path / "pid").read_text())))


def test_a_child_is_not_inherited_by_another_one() -> None:
    """Otherwise the pipe of the first stays open as long as the second runs."""
    words = ["sleep", "300"]
    with ChildProcess(words) as first, ChildProcess(words) as second:
        first.stop()
        assert first.wait(SECONDS) is not None
    for child in (first, second):
        assert child.output is not None
        child.output.close()
