"""Tests of `supersampler blender` with a recorded render: resuming, errors, frames upscaled meanwhile."""

import json
import re
import shutil
import sys
import threading
import time
from pathlib import Path
from threading import Timer
from typing import Any

import msgspec
import numpy as np
import pytest
from OpenImageIO import FLOAT, ImageBuf
from typer.testing import Result

from blender_files import NUMBERS, RECORDED, fake_blender, is_running, scene_file, wait_until
from blender_motion import camera_motion_of
from supersampler import ArgumentError, ShotError
from supersampler.cli import denoise_run
from supersampler.conventions import jittered_projection
from supersampler.integrations.blender.render import RenderRequest, find_blender, rendering
from supersampler.io.display_transforms import ocio_transform
from supersampler.io.files import FolderLock
from supersampler.io.images import read_exr, read_header, write_exr
from supersampler.io.shot import Shot, open_source
from supersampler.io.shot.blender import RenderedCamera, read_render_record
from supersampler.upscaler import Upscaler
from supersampler.validation import detect_conventions
from upscale_runs import pixels, run, succeeded


@pytest.fixture(autouse=True)
def without_oidn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recorded frames have no Noisy Image, which OIDN would denoise where it is installed."""
    monkeypatch.setattr(denoise_run, "has_oidn", lambda: False)


METHOD = ("--method", "bilinear")
IMAGES = ["0005.exr", "0006.exr", "0007.exr", "0008.exr"]


def command(folder: Path, *options: object, program: object = None, method: Any = METHOD) -> Result:
    """Run the command on the scene in a folder, into folder/out."""
    program = program or fake_blender(folder)
    return run(
        "blender", folder / "scene.blend", "-o", folder / "out", *method, "--blender", program, *options
    )


def blender(
    folder: Path, *options: object, program: object = None, method: Any = METHOD, **plan: Any
) -> Result:
    """Run the command on a scene of this plan."""
    folder.mkdir(exist_ok=True)
    scene_file(folder, **plan)
    return command(folder, *options, program=program, method=method)


def one_line(result: Result) -> str:
    """Return the error of a command, once it is sure that it is the only one."""
    assert result.exit_code in (1, 2), result.output
    [line] = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    return str(line)


def images(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "out").glob("*.exr"))}


def rendered(folder: Path) -> list[int]:
    """Numbers of the frames that Blender rendered in the last run."""
    log = (folder / "out" / "render" / "blender.log").read_text()
    return [int(number) for number in re.findall(r"^Fra:(\d+)", log, re.MULTILINE)]


def test_images_have_blenders_numbers_and_are_those_of_the_rendered_shot(tmp_path: Path) -> None:
    done = succeeded(blender(tmp_path))
    assert list(images(tmp_path)) == IMAGES
    assert "motion blur is off" in done.stderr
    assert read_render_record(tmp_path / "out" / "render").settings["scale"] == 2.0  # a method chooses it
    upscaler = Upscaler("bilinear", display_size=(96, 64))
    for item, name in zip(open_source(RECORDED), IMAGES, strict=True):
        assert read_exr(tmp_path / "out" / name).keys() == {*"RGBA"}
        image = upscaler.step(item.frame).astype(np.float16)
        np.testing.assert_array_equal(pixels(tmp_path / "out" / name), image)


def test_the_page_renders_and_upscales_frames_in_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parents[2] / "docs/tutorials/blender.md").read_text(encoding="utf-8")
    [snippet] = re.findall("```python\n(.*?)```", page, re.DOTALL)
    scene_file(tmp_path).rename(tmp_path / "kitchen.blend")
    fake_blender(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    found: dict[str, Any] = {}
    exec(snippet.replace("(1, 48)", f"{NUMBERS}"), found)  # noqa: S102
    frames = list(found["upscaled"](tmp_path / "render"))
    assert [number for number, _ in frames] == [5, 6, 7, 8]
    assert {image.shape for _, image in frames} == {(64, 96, 3)}


@pytest.mark.parametrize("frames", [(8, 5), (-1, 5), (5,), 5, ("5", "8")])
def test_a_request_of_no_range_of_frames_is_refused(tmp_path: Path, frames: Any) -> None:
    request = RenderRequest(blend=scene_file(tmp_path), frames=frames, program=str(fake_blender(tmp_path)))
    with (
        pytest.raises(ArgumentError, match=r"^frames is .*; want \(first, last\)"),
        rendering(request, tmp_path / "render", note=print),
    ):
        pass
    assert not (tmp_path / "render").exists()


DENOISED = {"scene": {"denoise": "temporal", "display_size": [48, 32]}}
"""What the script reports of Cycles where neither --scale nor --method is given."""


def test_a_scene_that_the_script_denoises_is_denoised_over_time_and_continues(tmp_path: Path) -> None:
    whole, part, out = tmp_path / "whole", tmp_path / "part", tmp_path / "whole" / "out"
    succeeded(blender(whole, method=(), **DENOISED))
    assert list(images(whole)) == IMAGES
    channels, record = read_exr(out / IMAGES[1]), read_render_record(out / "render")
    assert (channels["R"].shape, {*"RGBA"} <= channels.keys()) == ((32, 48), True)
    assert (record.jitter, record.settings["scale"]) == (((0.0, 0.0),), None)
    assert "Error: out of memory" in one_line(blender(tmp_path, method=(), error_at=7, **DENOISED))
    succeeded(blender(tmp_path, method=(), **DENOISED))
    assert rendered(tmp_path) == [7, 8]
    for frames in ("5-6", "5-8"):  # those that are rendered later are neighbours of the earlier ones
        succeeded(blender(part, "--frames", frames, method=(), **DENOISED))
    assert images(tmp_path) == images(part) == images(whole)


def test_a_scene_that_has_changed_is_not_continued_and_another_blender_is_noted(tmp_path: Path) -> None:
    one_line(blender(tmp_path, error_at=7))
    other = blender(tmp_path, scene={"engine": "BLENDER_EEVEE"})  # by a linked file: scene.blend is the same
    assert "frames of another render are there: engine was CYCLES, is now BLENDER_EEVEE" in one_line(other)
    done = succeeded(blender(tmp_path, scene={"blender": "5.3.0"}))
    assert "Blender 4.5.15 LTS has rendered the frames before, now it is 5.3.0" in done.stderr
    assert rendered(tmp_path) == [7, 8]


def test_a_render_that_began_in_a_new_folder_after_the_checks_of_another_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other_begins(path: str) -> str:
        monkeypatch.undo()
        succeeded(blender(tmp_path))
        return find_blender(path)

    monkeypatch.setattr("supersampler.integrations.blender.render.find_blender", other_begins)
    assert "frames of another render are there: samples was None" in one_line(
        blender(tmp_path, "--samples", 2)
    )
    assert rendered(tmp_path) == [5, 6, 7, 8]


COMPOSITED = ["0005.png", "0006.png", "0007.png", "0008.png"]


def composited(folder: Path) -> list[str]:
    return sorted(path.name for path in (folder / "out" / "composited").glob("*.png"))


def test_finished_frames_are_composited_and_again_by_the_same_command(tmp_path: Path) -> None:
    for _ in range(2):
        done = succeeded(blender(tmp_path, "--composite", "--motion-blur", method=(), **DENOISED))
        assert "PNG images are written instead" in done.stderr
        assert composited(tmp_path) == COMPOSITED
    for name, data in zip(COMPOSITED, images(tmp_path).values(), strict=True):
        assert (tmp_path / "out" / "composited" / name).read_bytes() == data


def test_a_compositor_that_fails_keeps_the_results_and_says_where_they_are(tmp_path: Path) -> None:
    line = one_line(blender(tmp_path, "--composite", method=(), composite_error_at=7, **DENOISED))
    assert "scene.blend: its compositor ended after 2 frames: node 'Render Layers' reads view layer" in line
    assert "The frames are complete in " in line
    assert composited(tmp_path) == COMPOSITED[:2]
    assert list(images(tmp_path)) == IMAGES
    assert not list((tmp_path / "out" / "composited").glob(".*"))


def test_a_foreign_file_in_the_way_of_a_composited_frame_is_kept(tmp_path: Path) -> None:
    (tmp_path / "out" / "composited").mkdir(parents=True)
    foreign = tmp_path / "out" / "composited" / "0006.png"
    foreign.write_text("mine")
    line = one_line(blender(tmp_path, "--composite", method=(), **DENOISED))
    assert "0006.png: already exists, and is not listed by composite.json" in line
    assert foreign.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--motion-blur", "--keep-blur"), "--keep-blur is given with --motion-blur; want one of the two"),
        (("--composite", "--format", "png"), "--format is png; want exr, too"),
        (("--depth-of-field", *METHOD), "--depth-of-field is given with upscaled frames; want --denoise"),
        (("--scale", "9"), "--scale is 9; want 1 to 3, the ratios of classifier"),
        (
            ("--frames=-2-1",),
            "--frames is '-2-1'; want FIRST-LAST, such as 10-50, or one frame number, not below 0",
        ),
        (("--method", "nope"), "no model 'nope'"),
        (("--denoise", "temporal", *METHOD), "--method is given with --denoise temporal; want one of"),
        (("--denoise", "temporal", "--scale", "2"), "scale is 2, with temporal denoising; want one of"),
    ],
)
def test_impossible_options_are_refused(tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    assert message in one_line(blender(tmp_path, *options, method=()))
    assert not images(tmp_path)


def test_a_frame_is_upscaled_while_the_next_ones_render(tmp_path: Path) -> None:
    succeeded(blender(tmp_path, wait_at=8, **{"for": str(tmp_path / "out" / "0005.exr")}))
    assert list(images(tmp_path)) == IMAGES


@pytest.mark.parametrize(
    ("how", "said"), [("error_at", "Error: out of memory"), ("crash_at", "with SIGABRT")]
)
def test_a_render_that_fails_keeps_its_frames_and_continues(tmp_path: Path, how: str, said: str) -> None:
    blender(tmp_path / "whole")
    line = one_line(blender(tmp_path, **{how: 7}))
    assert "scene.blend: the render ended after 2 frames: " in line
    assert said in line
    assert line.endswith("blender.log.")
    assert list(images(tmp_path)) == IMAGES[:2]
    succeeded(blender(tmp_path))
    assert rendered(tmp_path) == [7, 8]
    assert images(tmp_path) == images(tmp_path / "whole")


def test_more_frames_may_follow_and_a_complete_render_needs_no_blender(tmp_path: Path) -> None:
    blender(tmp_path, "--frames", "5-6")
    succeeded(blender(tmp_path, "--frames", "5-8"))
    assert rendered(tmp_path) == [7, 8]
    again = succeeded(blender(tmp_path, "--frames", "5-8", program="nowhere"))
    assert "All 4 frames are complete already" in again.stderr
    (tmp_path / "out" / "render" / "0006.exr").unlink()
    (tmp_path / "out" / "0007.exr").unlink()
    succeeded(blender(tmp_path))
    assert rendered(tmp_path) == [6, 7, 8]
    assert list(images(tmp_path)) == IMAGES


def test_a_render_without_complete_frames_does_not_block_another(tmp_path: Path) -> None:
    assert "no camera" in one_line(blender(tmp_path, "--camera", "Other", error="no camera is named 'Other'"))
    succeeded(blender(tmp_path, "--camera", "Camera"))
    assert list(images(tmp_path)) == IMAGES


def test_frames_of_another_request_are_refused_until_overwritten(tmp_path: Path) -> None:
    blender(tmp_path)
    before = images(tmp_path)
    assert "samples was None, is now 4" in one_line(blender(tmp_path, "--samples", 4))
    assert "begins with 6" in one_line(blender(tmp_path, "--frames", "6-8"))
    scene_file(tmp_path).write_text("BLENDER with a change")
    assert "frames of another render are there: the file has changed" in one_line(command(tmp_path))
    assert images(tmp_path) == before
    succeeded(blender(tmp_path, "--frames", "6-8", "--overwrite"))
    assert list(images(tmp_path)) == IMAGES[1:]
    assert sorted(path.name for path in (tmp_path / "out" / "render").glob("*.exr")) == IMAGES[1:]


@pytest.mark.parametrize("options", [(), ("--overwrite",)])
def test_two_renders_into_one_folder_at_once_are_refused(tmp_path: Path, options: tuple[str, ...]) -> None:
    blender(tmp_path, "--frames", "5-6")
    render = tmp_path / "out" / "render"
    before = {path.name: path.read_bytes() for path in render.iterdir()}
    with FolderLock(render):
        assert "render: another run writes to it" in one_line(blender(tmp_path, "--frames", "5-8", *options))
    assert {path.name: path.read_bytes() for path in render.iterdir()} == before
    succeeded(blender(tmp_path, "--frames", "5-8", *options))


def test_a_program_that_is_not_blender_is_named(tmp_path: Path) -> None:
    line = one_line(blender(tmp_path, program=sys.executable))
    assert f"{sys.executable} is not Blender, and cannot import bpy" in line
    assert "--blender is nowhere, which is not a program" in one_line(blender(tmp_path, program="nowhere"))
    other = fake_blender(tmp_path)
    other.write_text("#!/bin/sh\n")
    assert "before the first frame: Blender ended with code 0" in one_line(blender(tmp_path, program=other))


OCIO = """
ocio_profile_version: 2
roles: {scene_linear: linear, default: linear}
file_rules: [!<Rule> {name: Default, colorspace: default}]
displays: {sRGB: [!<View> {name: AgX, colorspace: linear}]}
colorspaces: [!<ColorSpace> {name: linear}]
"""


@pytest.fixture
def view(tmp_path: Path) -> dict[str, Any]:
    """The plan of a scene that can be shown."""
    path = tmp_path / "config.ocio"
    path.write_text(OCIO)
    return {"scene": {"ocio": str(path)}}


def test_a_view_that_is_missing_is_one_line_before_the_first_result(tmp_path: Path, view: Any) -> None:
    Path(view["scene"]["ocio"]).write_text(OCIO.replace("name: AgX", "name: Filmic"))
    assert "view is 'AgX'; want one of Filmic" in one_line(blender(tmp_path, "--format", "png", **view))
    assert not list((tmp_path / "out").glob("*.png"))
    Path(view["scene"]["ocio"]).write_text(OCIO)
    succeeded(blender(tmp_path, "--format", "png", **view))
    assert len(list((tmp_path / "out").glob("*.png"))) == 4


def test_results_state_the_linear_space_of_blenders_configuration(tmp_path: Path) -> None:
    config = {"scene": {"ocio": "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1"}}
    succeeded(blender(tmp_path, **config))
    assert read_header(tmp_path / "out" / "0005.exr").color_space == "ACEScg"
    assert open_source(tmp_path / "out" / "render").info.color_space == "ACEScg"


def test_a_linear_space_of_the_file_is_stated_and_shown(tmp_path: Path) -> None:
    config, display = "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1", "sRGB - Display"
    scene = {
        "ocio": config, "linear": "Linear Rec.2020", "interop_id": "lin_rec2020_scene",
        "view": {"display": display, "view": "Un-tone-mapped", "look": "None", "exposure": 0.0, "gamma": 1.0},
    }  # fmt: skip
    succeeded(blender(tmp_path, "--format", "png", "--format", "exr", scene=scene))
    result = tmp_path / "out" / "exr" / "0005.exr"
    assert read_header(result).color_space == "lin_rec2020"
    assert open_source(tmp_path / "out" / "render").info.color_space == "lin_rec2020"
    channels = read_exr(result)
    light = np.stack([channels[axis] for axis in "RGB"], axis=-1).astype(np.float32)
    transform = ocio_transform(config, display, "Un-tone-mapped", color_space="Linear Rec.2020")
    png = np.asarray(ImageBuf(str(tmp_path / "out" / "png" / "0005.png")).get_pixels(FLOAT))
    assert np.abs(png[..., :3] - transform.show(light)).max() < 0.01


def test_a_video_waits_for_the_first_frame(tmp_path: Path, view: dict[str, Any]) -> None:
    timer = Timer(1.0, (tmp_path / "go").touch)
    timer.start()
    succeeded(blender(tmp_path, "--format", "mp4", wait_at=5, **{"for": str(tmp_path / "go")}, **view))
    timer.join()
    assert (tmp_path / "out" / "video.mp4").stat().st_size > 0


def test_no_blender_at_all_is_an_error_that_says_where_to_get_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(ArgumentError, match=r"no Blender was found; .* Install it from blender\.org"):
        find_blender()


# --- attacks by a .blend file, an add-on or a hanging Blender: on files, on the terminal, and hangs ---


CAMERA = json.loads((RECORDED / "render.json").read_text())["frames"][0]


@pytest.mark.parametrize("prefix", ["supersampler ", "", "0" * 32, "\x1b[2K"])
def test_a_forged_message_of_a_scene_moves_no_file(tmp_path: Path, prefix: str) -> None:
    """Blender prints the path of a missing image as it is, with line ends."""
    secret = tmp_path / "id_ed25519"
    secret.write_text("key")
    forged = json.dumps({"frame": 5, "file": str(secret), **CAMERA})
    succeeded(blender(tmp_path, prints=f"cannot read 'a\n{prefix}{forged}\n{prefix}{{}}\nb'\n"))
    assert len(list((tmp_path / "out" / "render").glob("*.exr"))) == 4
    succeeded(blender(tmp_path, "--overwrite"))
    assert secret.read_text() == "key"


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
def test_an_invalid_message_ends_the_render_with_one_line(tmp_path: Path, line: str, want: str) -> None:
    assert want in one_line(blender(tmp_path, ours=[line]))
    assert not list((tmp_path / "out").rglob("*.exr"))


def test_lines_are_printed_without_markup_or_control_codes_however_long_they_are(tmp_path: Path) -> None:
    note = "view layer 'beauty [/x] [red]\x1b]0;title\x07\u202e' is rendered :smile:"
    done = succeeded(blender(tmp_path, note=note, prints="\x1b[31mred\x07\nWarning: " + "x" * 3_000_000))
    assert "view layer 'beauty [/x] [red]?]0;title??' is rendered :smile:" in done.stderr
    assert "?[31mred?" in (tmp_path / "out" / "render" / "blender.log").read_text("utf-8")


@pytest.mark.parametrize(
    "name", ["out/0006.exr", "out/render/0006.exr", "out/render/blender.log", "out/render/render.json"]
)
@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize("options", [(), ("--overwrite",)])
def test_foreign_files_are_kept(tmp_path: Path, name: str, *, linked: bool, options: tuple[str, ...]) -> None:
    path, other = tmp_path / name, tmp_path / "other"
    path.parent.mkdir(parents=True)
    (other if linked else path).write_text("mine")
    if linked:
        path.symlink_to(other)
    assert str(path) in one_line(blender(tmp_path, *options))
    assert path.read_text() == "mine"


def test_a_foreign_file_that_appears_during_the_run_is_kept(tmp_path: Path) -> None:
    late = tmp_path / "out" / "render" / "0007.exr"

    def appear() -> None:
        while not (tmp_path / "out" / "0005.exr").exists():
            time.sleep(0.01)
        late.write_text("mine")
        (tmp_path / "go").touch()

    thread = threading.Thread(target=appear)
    thread.start()
    line = one_line(blender(tmp_path, wait_at=7, **{"for": str(tmp_path / "go")}))
    thread.join(60)
    assert "0007.exr: already exists, and is not listed by render.json" in line
    assert late.read_text() == "mine"


def test_a_link_in_place_of_a_frame_is_not_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The temporary names of a run are drawn, but a program could look at the folder."""
    monkeypatch.setattr("supersampler.integrations.blender.render.secrets.token_hex", lambda _: "01234567")
    (tmp_path / "secret").write_text("key")
    render = tmp_path / "out" / "render"
    render.mkdir(parents=True)
    (render / ".0005.01234567.partial.exr").symlink_to(tmp_path / "secret")
    record = json.loads((RECORDED / "render.json").read_text())
    scene, message = json.dumps({"scene": record["scene"]}), json.dumps({"frame": 5, **CAMERA})
    assert "0005.exr: was not written" in one_line(blender(tmp_path, ours=[scene, message], error="end"))
    assert (tmp_path / "secret").read_text() == "key"


@pytest.mark.long  # waits for seconds
def test_a_blender_that_ignores_signals_is_killed(tmp_path: Path) -> None:
    began = time.monotonic()
    assert "no camera" in one_line(blender(tmp_path, stubborn=True, error="no camera"))
    assert time.monotonic() - began < 200  # it would hang for 600
    wait_until(lambda: not is_running(int((tmp_path / "pid").read_text())))


@pytest.mark.long  # waits for seconds
def test_a_process_orphaned_by_blender_does_not_block_the_command(tmp_path: Path) -> None:
    began = time.monotonic()
    assert "SIGABRT" in one_line(blender(tmp_path, daughter=250, crash_at=6))
    assert time.monotonic() - began < 200


# --- the shot that `supersampler blender` renders: motion, sky, jitter, and its render.json ---


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(RECORDED, tmp_path / "render"))


def test_links_of_rendered_frames_out_of_their_folder_are_not_followed(folder: Path) -> None:
    (folder / "0006.exr").rename(folder.parent / "away.exr")
    (folder / "0006.exr").symlink_to(folder.parent / "away.exr")
    with pytest.raises(ShotError, match=r"0006\.exr: leads out of"):
        open_source(folder)


def test_motion_holds_the_change_of_the_lens_shift_and_the_turn_of_the_sky() -> None:
    shot, record = open_source(RECORDED), read_render_record(RECORDED)
    for index in (1, 2, 3):
        frame, want = shot.read(index).frame, camera_motion_of(shot, record, index)
        wrong = np.abs(frame.motion - want).max(axis=-1)
        assert np.percentile(wrong, 90) < 1e-3  # but the cube that moves
        change = np.subtract(record.frames[index].shift, record.frames[index - 1].shift)
        assert np.abs(change).min() > 0.4
        sky = frame.depth == 0
        assert 0.2 < sky.mean() < 0.8
        assert wrong[sky].max() < 1e-4
        assert np.abs(frame.motion[sky]).max() > 0.3


def test_jitter_numbers_size_and_buffers_are_as_rendered() -> None:
    shot, record = open_source(RECORDED), read_render_record(RECORDED)
    assert (len(shot), shot.first_number) == (4, NUMBERS[0])
    assert (shot.render_size, shot.display_size, shot.frame_rate) == ((48, 32), (96, 64), 24.0)
    frames = [item.frame for item in shot]
    assert [frame.jitter for frame in frames] == list(record.jitter[:4])
    assert [frame.reset for frame in frames] == [True, False, False, False]
    assert {*(frames[0].gbuffer or {})} == {"normal", "base_color"}
    assert frames[0].aovs is not None
    assert shot.read_raw(1, gbuffers=()).gbuffer is None


def test_the_checks_find_the_frames_as_stated() -> None:
    detection = detect_conventions(open_source(RECORDED))
    assert detection.agrees, detection.summary()
    assert detection.jitter.margin > 1.2  # and sure of it
    assert detection.depth.margin > 4


def opened_as(engine: str, folder: Path) -> Shot:
    """Open a recorded render of Cycles as that of another engine."""
    path = folder / "render.json"
    path.write_text(path.read_text().replace('"CYCLES"', f'"{engine}"'))
    return open_source(folder)


def test_vectors_of_eevee_hold_all_but_their_jitter_is_taken_out(folder: Path) -> None:
    truth, record = open_source(folder).read(2).frame.motion, read_render_record(folder)
    path = folder / "0007.exr"
    channels = read_exr(path)
    now, before = record.jitter[2], record.jitter[1]
    channels["ViewLayer.Vector.X"] = truth[..., 0] + np.float32(now[0] - before[0])
    channels["ViewLayer.Vector.Y"] = -(truth[..., 1] + np.float32(now[1] - before[1]))
    write_exr(path, channels)
    motion = opened_as("BLENDER_EEVEE_NEXT", folder).read(2).frame.motion
    np.testing.assert_allclose(motion, truth, atol=1e-5)


def test_without_a_vector_pass_motion_is_the_cameras(folder: Path) -> None:
    record = read_render_record(folder)
    for path in folder.glob("*.exr"):
        write_exr(path, {name: a for name, a in read_exr(path).items() if "Vector" not in name})
    shot = opened_as("BLENDER_WORKBENCH", folder)
    np.testing.assert_allclose(shot.read(3).frame.motion, camera_motion_of(shot, record, 3), atol=1e-4)


NEAR, FAR = 0.1, 50.0
STILL: dict[str, Any] = {"at": (0.0, -7.0, 3.0), "turn": 0.0, "wide": 8.0}


def orthographic(index: int, at: tuple[float, float, float], turn: float, wide: float) -> RenderedCamera:
    """Return a camera above the ground that looks along +y and down, with a shift and the recorded jitter."""
    c, s = np.cos(turn), np.sin(turn)
    world = np.eye(4)
    world[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ [[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]]
    world[:3, 3] = at
    projection = np.diag([2 / wide, 3 / wide, -2 / (FAR - NEAR), 1.0])
    projection[2, 3] = -(FAR + NEAR) / (FAR - NEAR)
    shift, (x, y) = (0.3 * index, -0.2 * index), read_render_record(RECORDED).jitter[index]
    matrix = jittered_projection(projection, (x + shift[0], y - shift[1]), (48, 32)) @ np.linalg.inv(world)
    found = {"camera": matrix.tolist(), "shift": shift, "world": world.tolist()}
    return msgspec.convert(found, RenderedCamera)


def with_cameras(folder: Path, *cameras: RenderedCamera) -> Shot:
    msgspec.structs.replace(read_render_record(folder), frames=cameras).write(folder)
    return open_source(folder)


@pytest.mark.parametrize(
    "change", [{"at": (0.4, -7.0, 3.0)}, {"at": (1e-12, -7.0, 3.0)}, {"turn": 0.03}, {"wide": 8.5}], ids=str
)
def test_while_an_orthographic_camera_moves_motion_is_the_cameras(folder: Path, change: Any) -> None:
    """Cycles then projects it as a perspective camera."""
    before, now = orthographic(0, **STILL), orthographic(1, **{**STILL, **change})
    shot = with_cameras(folder, before, now)
    distance = read_exr(folder / "0006.exr")["ViewLayer.Depth.Z"].astype(np.float64)
    y, x = np.mgrid[:32, :48]
    seen, world = now.matrix, np.array(now.world)
    sides = np.stack([seen[0, :3], seen[1, :3], -world[:3, 2]])
    clip = np.stack([(x + 0.5) / 24 - 1, 1 - (y + 0.5) / 16, distance - world[:3, 2] @ world[:3, 3]], axis=-1)
    places = (clip - [*seen[:2, 3], 0.0]) @ np.linalg.inv(sides).T
    earlier = places @ before.matrix[:2, :3].T + before.matrix[:2, 3]
    moved = (earlier - clip[..., :2]) * (24, -16)  # with the change of the jitter
    jitter = read_render_record(folder).jitter
    wrong = np.abs(shot.read(1).frame.motion + np.subtract(jitter[1], jitter[0]) - moved)
    assert wrong[distance < 1e9].max() < 2e-3, "on surfaces"


def test_a_moving_orthographic_camera_of_an_old_record_has_no_known_place(folder: Path) -> None:
    cameras = orthographic(0, **STILL), orthographic(1, **{**STILL, "turn": 0.03})
    shot = with_cameras(folder, *(msgspec.structs.replace(camera, world=None) for camera in cameras))
    with pytest.raises(ShotError, match="has no position of its orthographic camera"):
        shot.read(1)


def test_while_an_orthographic_camera_is_still_objects_move_as_cycles_writes(folder: Path) -> None:
    cameras = orthographic(0, **STILL), orthographic(1, **STILL)
    channels = read_exr(folder / "0006.exr")
    want = np.stack([channels["ViewLayer.Vector.X"] + 0.3, -(channels["ViewLayer.Vector.Y"] - 0.2)], axis=-1)
    for each in (cameras, [msgspec.structs.replace(camera, world=None) for camera in cameras]):
        motion = with_cameras(folder, *each).read(1).frame.motion
        np.testing.assert_allclose(motion, want, atol=1e-5)


def test_a_record_is_read_as_it_was_written(folder: Path) -> None:
    before = read_render_record(folder)
    text = (folder / "render.json").read_text()
    before.write(folder)
    assert (folder / "render.json").read_text() == text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "is of version 2; this package reads 1"),
        ({"first": -1}, r"Expected `int` >= 0 - at `\$\.first`, is -1"),
        ({"jitter": []}, r"length >= 1 - at `\$\.jitter`, is \[\]"),
        ({"frames": [{"camera": [[1]], "shift": [0, 0]}]}, r"length 4 - at `\$\.frames\[0\]\.camera\[0\]`"),
        ({"frames": [{"camera": [[0] * 4] * 4, "shift": [0, 0]}]}, "not an invertible matrix"),
        ({"frames": [{"camera": np.eye(4).tolist()}]}, "missing required field `shift`"),
        ({"frames": []}, "has no complete frame"),
        ({"scene": {"name": "Scene"}}, r"missing required field `blender` - at `\$\.scene`"),
        ({"scene": None}, "does not describe the scene"),
    ],
)
def test_a_damaged_record_is_refused(folder: Path, change: dict[str, Any], message: str) -> None:
    path = folder / "render.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(ShotError, match=message):
        open_source(folder)
