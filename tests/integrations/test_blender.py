"""Tests of `supersampler blender` with a real Blender, or a Python that has bpy: `make blender` runs them.

$SUPERSAMPLER_BLENDER names the program; without it `blender` on the path is taken.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OpenImageIO import FLOAT, UINT8, ImageBuf
from typer.testing import Result

import supersampler
from blender_files import HERE
from blender_motion import camera_motion_of
from supersampler.io.display import BT709
from supersampler.io.images import Channel, read_exr, read_header
from supersampler.io.shot import Shot, import_blender, open_source
from supersampler.io.shot.blender import RenderRecord, read_render_record
from supersampler.validation import detect_conventions
from supersampler_bench.cli.options import REFERENCES
from supersampler_bench.quality import denoise_record
from supersampler_bench.quality.denoise import measure_render
from supersampler_bench.quality.denoise_record import FRAME, MEDIAN
from supersampler_bench.quality.denoise_references import find_references
from upscale_runs import run, succeeded

PROGRAM = os.environ.get("SUPERSAMPLER_BLENDER") or shutil.which("blender")
DENOISE_SCENES = Path(denoise_record.__file__).with_name("denoise_scenes.py")  # only Blender can import it
NAMES = ["0006.exr", "0007.exr", "0008.exr"]
pytestmark = pytest.mark.skipif(
    PROGRAM is None, reason="no Blender: $SUPERSAMPLER_BLENDER is not set, and none is on the path"
)


def make_scene(folder: Path, **options: Any) -> Path:
    path = folder / "scene.blend"
    run_in_blender(HERE / "make_scene.py", str(path), json.dumps(options))
    return path


def run_in_blender(script: Path, *words: str, **variables: str) -> str:
    """Run a script in Blender, and return what it printed."""
    python = Path(str(PROGRAM)).stem.startswith("python")
    before = [] if python else ["--background", "--python-exit-code", "1", "--python"]
    command = [str(PROGRAM), *before, str(script), *([] if python else ["--"]), *words]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    environment |= variables
    return subprocess.run(command, check=True, capture_output=True, env=environment, text=True).stdout


def attempt(folder: Path, *options: object, **scene: Any) -> Result:
    """Render a scene by the command, which must leave the file as it is."""
    blend = make_scene(folder, **scene)
    before = blend.read_bytes()
    done = run("blender", blend, "-o", folder / "out", "--blender", PROGRAM, "--frames", "6-8", *options)
    assert blend.read_bytes() == before
    return done


def render(folder: Path, *options: object, **scene: Any) -> Result:
    """Render as `attempt`; skip the test where an engine has no GPU."""
    folder.mkdir(exist_ok=True)
    done = attempt(folder, *options, **scene)
    if done.exit_code and "GPU" in done.stderr and "--engine" in options:
        pytest.skip(f"no GPU, not even in software: {done.stderr}")
    return succeeded(done)


def rendered(folder: Path) -> tuple[Shot, RenderRecord]:
    return open_source(folder / "out" / "render"), read_render_record(folder / "out" / "render")


def wrong_motion(shot: Shot, record: RenderRecord, index: int) -> float:
    """Return how far motion is from that of the camera, in pixels, but for the cube that moves."""
    wrong = np.abs(shot.read(index).frame.motion - camera_motion_of(shot, record, index)).max(axis=-1)
    return float(np.percentile(wrong, 85))


@pytest.mark.parametrize(
    "scene",
    [
        {},
        {"size": [64, 96]},
        {"size": [64, 96], "sensor_fit": "HORIZONTAL"},
        {"sensor_fit": "VERTICAL"},
        {"size": [192, 128], "percentage": 50},
        {"properties": {"scene.render.pixel_aspect_y": 1.5}},
        {"lens": [35.0, 50.0]},
        {"properties": {"scene.render.frame_map_new": 80}},
    ],
    ids=str,
)
def test_vectors_agree_with_the_camera_for_any_sensor(tmp_path: Path, scene: dict[str, Any]) -> None:
    render(tmp_path, "--samples", 1, "--method", "bilinear", **scene)
    shot, record = rendered(tmp_path)
    for index in (1, 2):
        change = np.subtract(record.frames[index].shift, record.frames[index - 1].shift)
        assert np.abs(change).min() > 0.4
        assert 0.3 < (shot.read(index).frame.depth > 0).mean() < 0.9
        assert wrong_motion(shot, record, index) < 1e-3


def test_jitter_moves_the_samples_by_its_value(tmp_path: Path) -> None:
    render(tmp_path, "--samples", 4, "--method", "bilinear", size=[320, 192], shift=[[0.1, 0.05]] * 2)
    detection = detect_conventions(rendered(tmp_path)[0])
    assert detection.agrees, detection.summary()
    assert detection.jitter.margin > 1.2
    assert detection.motion.margin > 1.2


@pytest.mark.parametrize("engine", ["cycles", "eevee"])
def test_each_pixel_is_one_place_whatever_the_number_of_samples(tmp_path: Path, engine: str) -> None:
    render(tmp_path, "--samples", 16, "--engine", engine, "--method", "bilinear", size=[320, 192])
    gbuffer: Any = rendered(tmp_path)[0].read(0).frame.gbuffer
    axis = np.abs(gbuffer["normal"].astype(np.float32)).max(axis=-1)  # nothing in the scene is turned
    mixed = (axis > 1e-3) & (axis < 0.99)  # the sky has none
    assert mixed.mean() < 0.002


def test_an_orthographic_camera_is_jittered_and_its_motion_is_known(tmp_path: Path) -> None:
    done = render(tmp_path, "--samples", 4, "--method", "bilinear", camera_type="ORTHO", size=[320, 192])
    shot, record = rendered(tmp_path)
    detection = detect_conventions(shot)
    assert detection.agrees, detection.summary()
    assert "objects move, and will blur: Cube.003; Cycles has no motion of them" in done.stderr
    y, x = np.mgrid[:96, :160]
    for index in (1, 2):  # a pixel leads to the same place of the world in the frame before
        jitters = [shot.read(each).frame.jitter for each in (index - 1, index)]
        motion = shot.read(index).frame.motion + np.subtract(jitters[1], jitters[0])
        rows, columns = (np.rint(each).astype(int) for each in (y + motion[..., 1], x + motion[..., 0]))
        inside = (rows >= 0) & (rows < 96) & (columns >= 0) & (columns < 160)
        now, before = places(shot, record, index), places(shot, record, index - 1)
        apart = np.linalg.norm(now[inside] - before[rows[inside], columns[inside]], axis=-1)
        assert np.percentile(apart[apart < 1e6], 85) < 0.2, "half a pixel, on a slanted floor"


def places(shot: Shot, record: RenderRecord, index: int) -> Any:
    """Return (h, w, 3) the places of a frame's samples in the world; the camera is orthographic."""
    camera = record.frames[index]
    matrix, world = camera.matrix, np.array(camera.world)
    distance = shot.read_raw(index).depth.astype(np.float64)
    height, width = distance.shape
    y, x = np.mgrid[:height, :width] + 0.5
    sides = np.stack([matrix[0, :3], matrix[1, :3], -world[:3, 2]])
    at = 2 * x / width - 1 - matrix[0, 3], 1 - 2 * y / height - matrix[1, 3]
    return np.stack([*at, distance - world[:3, 2] @ world[:3, 3]], axis=-1) @ np.linalg.inv(sides).T


@pytest.mark.parametrize("engine", ["eevee", "workbench"])
def test_other_engines_give_the_same_motion_of_the_camera(tmp_path: Path, engine: str) -> None:
    done = render(tmp_path, "--samples", 1, "--engine", engine, "--method", "bilinear")
    shot, record = rendered(tmp_path)
    for index in (1, 2):
        assert wrong_motion(shot, record, index) < 0.02  # Eevee's vectors are half floats
    assert ("Cube.003" in done.stderr) == (engine == "workbench")


def test_upscaled_frames_are_nearer_to_the_truth_than_one_frame(tmp_path: Path) -> None:
    """Against the same scene at display size with many samples, in linear light."""
    for name, options in (
        ("truth", ("--scale", 1, "--samples", 64, "--method", "bilinear")),
        ("bicubic", ("--samples", 4, "--method", "bicubic")),
        ("ours", ("--samples", 4)),
    ):
        render(tmp_path / name, *options, "--frames", "5-10")

    def error(name: str) -> float:
        images = [read_exr(tmp_path / place / "out" / "0010.exr") for place in (name, "truth")]
        return float(np.mean([np.square(np.subtract(*(i[axis] for i in images))) for axis in "RGB"]))

    assert error("ours") < error("bicubic")


@pytest.mark.parametrize(
    ("scene", "size"),
    [
        ({"size": [640, 400], "percentage": 50}, (320, 200)),
        ({"size": [200, 320]}, (200, 320)),
        ({"size": [320, 200], "sensor_fit": "VERTICAL"}, (320, 200)),
        ({"size": [320, 200], "properties": {"scene.render.pixel_aspect_y": 1.5}}, (320, 200)),
    ],
    ids=str,
)
def test_the_docs_script_moves_the_camera(
    tmp_path: Path, scene: dict[str, Any], size: tuple[int, int]
) -> None:
    page = (HERE.parents[1] / "docs" / "shots.md").read_text(encoding="utf-8")
    snippet = re.findall(r"```python\n# jitter\.py\n(.*?)```", page, re.DOTALL)[0]
    blend, script, found = make_scene(tmp_path, **scene), tmp_path / "script.py", tmp_path / "found.json"
    script.write_text(PROJECTIONS + snippet + f"\nwrite(before, projections(), {str(found)!r})\n")
    run_in_blender(script, str(blend))
    before, after = np.array(json.loads(found.read_text()))
    jitter = np.array(json.loads((tmp_path / "jitter.json").read_text()))[: len(after)]
    assert np.abs(np.diff(before[:, 0, 2])).max() > 0.01  # the lens shift is animated
    change = (after - before)[:, :2, 2] * np.array(size) / 2  # pixels; of the projection's third column
    np.testing.assert_allclose(change, jitter * (1, -1), atol=1e-4)


PROJECTIONS = """
import json, sys
import bpy

bpy.ops.wm.open_mainfile(filepath=sys.argv[-1])


def projections():
    scene, found = bpy.context.scene, []
    share = scene.render.resolution_percentage / 100
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        found.append([list(row) for row in scene.camera.evaluated_get(depsgraph).calc_matrix_camera(
            depsgraph,
            x=int(scene.render.resolution_x * share),
            y=int(scene.render.resolution_y * share),
            scale_x=scene.render.pixel_aspect_x,
            scale_y=scene.render.pixel_aspect_y,
        )])
    return found


def write(before, after, path):
    with open(path, "w") as file:
        json.dump([before, after], file)


before = projections()
"""


def test_a_video_shows_the_frames_as_blender_shows_them_at_the_rate_of_the_scene(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    render(
        tmp_path, "--samples", 1, "--format", "mp4", "--format", "png", "--method", "bilinear",
        properties={"scene.render.fps": 30}, size=[96, 64],
    )  # fmt: skip
    with av.open(str(tmp_path / "out" / "video.mp4")) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert (stream.width, stream.height, stream.average_rate) == (96, 64, 30)
    for number, frame in zip((6, 7, 8), frames, strict=True):
        shown = np.asarray(ImageBuf(str(tmp_path / "out" / f"{number:04d}.png")).get_pixels(UINT8))[..., :3]
        assert np.abs((frame.astype(int) - shown) @ BT709).mean() < 4


def test_results_are_in_the_linear_space_of_the_file(tmp_path: Path) -> None:
    render(tmp_path, "--samples", 1, "--method", "bilinear", working_space="ACEScg", size=[32, 24])
    scene = rendered(tmp_path)[1].scene
    assert scene is not None
    want = "ACEScg" if int(scene.blender.split(".")[0]) >= 5 else "lin_rec709"
    for folder in ("out", "out/render"):
        assert read_header(tmp_path / folder / "0006.exr").color_space == want


@pytest.mark.parametrize(
    ("scene", "options", "message"),
    [
        ({"camera": False}, (), "has no active camera: add one"),
        ({}, ("--camera", "Other"), "no camera is named 'Other'; the scene has Camera"),
        ({}, ("--scene", "Other"), "no scene is named 'Other'; the file has Scene"),
        ({}, ("--view-layer", "Other"), "no view layer is named 'Other'; scene 'Scene' has ViewLayer"),
        ({"camera_type": "ORTHO"}, ("--engine", "workbench"), "no motion of orthographic cameras"),
        ({"camera_type": "PANO"}, (), "camera 'Camera' is panoramic, and cannot be jittered or followed"),
    ],
)
def test_an_unusable_scene_is_one_line(
    tmp_path: Path, scene: dict[str, Any], options: tuple[str, ...], message: str
) -> None:
    done = attempt(tmp_path, *options, **scene)
    assert done.exit_code == 1
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_simulation_that_is_not_baked_goes_on_where_a_run_stopped(tmp_path: Path) -> None:
    blend, out = make_scene(tmp_path, falls=True), tmp_path / "out"
    command = "blender", blend, "-o", out, "--blender", PROGRAM, "--samples", 1
    succeeded(run(*command))
    last = out / "render" / "0010.exr"
    want = read_exr(last)
    for path in (last, out / "0010.exr"):
        path.unlink()
    assert "frames 5 to 8 are simulated" in succeeded(run(*command)).stderr
    assert_rendered(last, want)
    succeeded(run(*command, "--overwrite", "--frames", "8-10"))
    assert_rendered(last, want)


def assert_rendered(path: Path, want: dict[str, Channel]) -> None:
    for name, channel in read_exr(path).items():
        np.testing.assert_array_equal(channel, want[name])


def test_the_view_layer_that_is_named_is_rendered(tmp_path: Path) -> None:
    done = render(tmp_path, "--samples", 1, "--method", "bilinear", compositor="Other", size=[32, 24])
    assert "view layer 'ViewLayer' is rendered, not Other; --view-layer" in done.stderr
    options = "--samples", 1, "--method", "bilinear", "--overwrite", "--view-layer", "Other"
    assert "is rendered, not" not in render(tmp_path, *options, compositor="Other", size=[32, 24]).stderr
    names = read_header(tmp_path / "out" / "render" / "0006.exr").types
    assert all(name.startswith("Other.") for name in names)


def test_python_in_the_file_is_not_run_and_the_command_says_so(tmp_path: Path) -> None:
    ran = tmp_path / "ran"
    done = render(tmp_path, "--samples", 1, "--method", "bilinear", script=f"open({str(ran)!r}, 'w')")
    assert not ran.exists()
    assert "Python in the file is not run (Text 'startup.py')" in done.stderr


def test_temporal_denoising_renders_at_full_size_with_guides_in_world_space(tmp_path: Path) -> None:
    properties = {"scene.render.use_motion_blur": True}
    done = render(tmp_path, "--samples", 1, markers=[[5, "Camera"], [8, "Other"]], properties=properties)
    assert "Cycles renders at full size with 1 samples" in done.stderr
    assert "motion blur is off" in done.stderr
    shot, record = rendered(tmp_path)
    assert record.scene is not None
    assert read_header(tmp_path / "out" / "render" / "0006.exr").metadata["cycles.ViewLayer.samples"] == "1"
    assert (record.scene.denoise, shot.render_size, shot.is_denoised) == ("temporal", (96, 64), True)
    items = list(shot)
    assert [item.frame.reset for item in items] == [True, False, True]
    assert {item.frame.jitter for item in items} == {(0.0, 0.0)}
    assert wrong_motion(shot, record, 1) < 1e-3
    assert items[0].frame.motion_next is not None
    assert np.median(np.abs(items[0].frame.motion_next + items[1].frame.motion)) < 0.1
    gbuffer, surface = items[0].frame.gbuffer, items[0].frame.depth > 0
    assert gbuffer is not None
    axis = np.abs(gbuffer["normal"].astype(np.float32)).max(axis=-1)[surface]  # none of the cubes is turned
    assert np.percentile(axis, 20) > 0.999
    assert list(items[0].raw.aov_names or ()) == ["A"]
    assert any("Noisy Image" in name for name in shot.ignored_channels)
    assert sorted(path.name for path in (tmp_path / "out").glob("*.exr")) == NAMES


def test_advice_compares_three_ways_and_writes_their_images(tmp_path: Path) -> None:
    done = render(tmp_path, "--samples", 1, "--advise", size=[192, 128])
    seconds, errors = np.array(
        re.findall(r"^\w.* (\d+\.\d) +(\d+\.\d)%$", done.stdout, re.MULTILINE), float
    ).T
    assert len(seconds) == 3
    assert (seconds > 0).all()
    assert (errors > 0).all()
    assert re.search("^Recommended: (full|half) size, .* Options: ", done.stdout, re.MULTILINE)
    folder = tmp_path / "out" / "advise"
    assert {path.name for path in folder.glob("*.png")} == {"plain.png", "temporal.png", "upscaled.png"}
    assert {ImageBuf(str(path)).spec().width for path in folder.glob("*.png")} == {96}
    assert not (tmp_path / "out" / "render").exists()


def test_kept_motion_blur_leaves_the_motion_of_the_camera(tmp_path: Path) -> None:
    properties = {"scene.render.use_motion_blur": True}
    done = render(tmp_path, "--samples", 1, "--keep-blur", properties=properties)
    assert "motion blur is kept: Cycles then writes no vectors" in done.stderr
    shot, record = rendered(tmp_path)
    np.testing.assert_allclose(shot.read(1).frame.motion, camera_motion_of(shot, record, 1), atol=1e-4)


def pixels(path: Path) -> Any:
    """Return (h, w, 3) of an image."""
    return np.asarray(ImageBuf(str(path)).get_pixels(FLOAT))[..., :3]


def test_the_compositor_of_the_file_runs_on_the_results_and_writes_no_other_file(tmp_path: Path) -> None:
    tmp_path = tmp_path / "ein {blend_name} #1"
    tmp_path.mkdir()
    done = render(tmp_path, "--samples", 1, "--composite", compositor="ViewLayer")
    assert "not those of File Output" in done.stderr
    assert "node 'Render Layers': the results replace Noisy Image, too" in done.stderr
    assert "the output is OPEN_EXR_MULTILAYER: OPEN_EXR images are written instead" in done.stderr
    for name in NAMES:
        assert set(read_exr(tmp_path / "out" / "composited" / name)) == set("RGBA")
        result, composited = pixels(tmp_path / "out" / name), pixels(tmp_path / "out" / "composited" / name)
        np.testing.assert_allclose(composited, 1.0 - result, atol=1e-6)
    assert not (tmp_path / "beside").exists()


def test_a_compositor_of_another_view_layer_is_refused_before_rendering(tmp_path: Path) -> None:
    done = attempt(tmp_path, "--samples", 1, "--composite", compositor="Other Layer")
    assert done.exit_code == 1
    assert "reads view layer 'Other Layer', but 'ViewLayer' is rendered" in done.stderr
    assert not [*tmp_path.rglob("*.exr")], "frames would be lost with the change of the file that it needs"


BLUR = {
    "--motion-blur": {"scene.render.use_motion_blur": True, "scene.render.motion_blur_shutter": 1.0},
    "--depth-of-field": {
        "scene.camera.data.dof.use_dof": True,
        "scene.camera.data.dof.aperture_fstop": 0.3,
        "scene.camera.data.dof.focus_distance": 3.0,
    },
}


@pytest.mark.parametrize("option", BLUR)
def test_blur_added_to_sharp_frames_is_nearer_to_blur_that_is_rendered(tmp_path: Path, option: str) -> None:
    output = {"scene.render.image_settings.file_format": "OPEN_EXR"}
    render(tmp_path, "--samples", 16, option, properties=BLUR[option] | output)
    render(tmp_path / "truth", "--samples", 64, "--keep-blur", properties=BLUR[option])
    truth = np.clip(pixels(tmp_path / "truth" / "out" / "0007.exr"), 0.0, 1.0)
    added, sharp = (
        np.square(np.clip(pixels(tmp_path / "out" / folder / "0007.exr"), 0.0, 1.0) - truth).mean()
        for folder in ("composited", "")
    )
    assert added < 0.9 * sharp


def test_a_marker_that_switches_cameras_is_a_cut(tmp_path: Path) -> None:
    options = ("--samples", 1, "--method", "bilinear", "--frames", "5-8")
    done = render(tmp_path, *options, markers=[[5, "Camera"], [7, "Other"]])
    assert "markers switch cameras at frame 7" in done.stderr
    shot, record = rendered(tmp_path)
    items = list(shot)
    assert [item.frame.reset for item in items] == [True, False, True, False]
    assert not items[2].frame.motion.any()
    for index in (1, 3):
        assert wrong_motion(shot, record, index) < 1e-3


def test_the_camera_that_is_named_is_rendered_whatever_the_markers_say(tmp_path: Path) -> None:
    for name in ("marked", "plain"):
        markers = [[5, "Camera"], [7, "Other"]] if name == "marked" else []
        options = ("--samples", 1, "--camera", "Camera", "--method", "bilinear")
        render(tmp_path / name, *options, markers=markers)
    for marked, plain in zip(*(rendered(tmp_path / n)[1].frames for n in ("marked", "plain")), strict=True):
        np.testing.assert_allclose(marked.matrix, plain.matrix, atol=1e-6)


def test_a_linked_scene_is_jittered_and_found_by_its_full_name(tmp_path: Path) -> None:
    options = ("--samples", 1, "--scale", 2, "--method", "bilinear")
    assert "the file has Scene, Scene [set.blend]" in attempt(tmp_path, "--scene", "Set", linked=True).stderr
    render(tmp_path, "--scene", "Scene [set.blend]", *options, linked=True)
    assert wrong_motion(*rendered(tmp_path), 1) < 1e-3


def test_every_second_frame_is_refused_as_motion_leads_to_the_one_before(tmp_path: Path) -> None:
    blend = make_scene(tmp_path, properties={"scene.frame_step": 2})
    done = run("blender", blend, "-o", tmp_path / "out", "--blender", PROGRAM)
    assert "pass --frames 5-10" in done.stderr


def test_the_extension_installs_renders_upscales_and_says_what_is_wrong(tmp_path: Path) -> None:
    extension = Path(supersampler.__file__).parent / "integrations" / "blender" / "extension"
    archive = tmp_path / "extension.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for name in ("__init__.py", "run.py", "blender_manifest.toml"):
            file.write(extension / name, name)
    blend, command = make_scene(tmp_path), Path(sys.executable).with_name("supersampler")
    words = map(str, (archive, blend, command, tmp_path / "out"))
    user = {"BLENDER_USER_RESOURCES": str(tmp_path / "user")}
    said = run_in_blender(HERE / "drive_extension.py", *words, **user)
    found = json.loads(next(line for line in said.splitlines() if line.startswith("{")))
    assert "Save the file first" in found["unsaved"]
    assert found["render"] == found["upscale"] == "FINISHED", found
    assert found["render denoised"] == found["denoise"] == "FINISHED", found
    assert found["again"] == "FINISHED"
    assert "frames of another render are there: the file has changed" in found["other"]
    assert "Choose the folder" in found["no source"]
    assert "/nowhere" in found["no command"]
    assert found["disabled"] == "False"
    for folder in ("out", "upscaled", "denoised", "denoised again"):
        assert sorted(p.name for p in (tmp_path / folder).glob("*.exr")) == ["0006.exr", "0007.exr"]


def test_the_scenes_of_the_denoising_bench_render_resume_and_are_measured(tmp_path: Path) -> None:
    small = ("-o", str(tmp_path), "--samples", "1", "--frames", "12", "14", "--size", "160", "90")
    run_in_blender(DENOISE_SCENES, *small, "--reference-samples", "0")
    assert len([*tmp_path.glob("*-1/*.exr")]) == 4 * 3
    words = ("lamps", *small, "--reference-samples", "256")
    run_in_blender(DENOISE_SCENES, *words)
    times = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.exr")}
    run_in_blender(DENOISE_SCENES, *words)
    assert times == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.exr")}
    shot = import_blender(tmp_path / "lamps-1", guides="denoising")
    assert np.abs(shot.read(1).frame.motion).max() > 0.3
    references = find_references(tmp_path / "lamps-1", "lamps", REFERENCES)
    row: Any = measure_render(tmp_path / "lamps-1", shot, references, None)
    assert row.reference_frames == [12, 13, 14]
    noisy, median = (row.scores(method).psnr or 0.0 for method in (FRAME, MEDIAN))
    assert median > noisy + 0.5
