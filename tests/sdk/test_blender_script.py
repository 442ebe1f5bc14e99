"""Tests of the settings that render_frames.py makes inside Blender, on a scene of plain objects."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import msgspec
import pytest

import supersampler
from native_build import module_of

FILE = Path(supersampler.__file__).parent / "integrations" / "blender" / "render_frames.py"
WIDE = ("BLACKMAN_HARRIS", 1.5)  # a pixel filter


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The script as a module, with the notes that it has reported."""
    monkeypatch.setitem(sys.modules, "bpy", ModuleType("bpy"))
    monkeypatch.setenv("SUPERSAMPLER_RENDER", json.dumps({"token": ""}))
    module: Any = module_of(FILE)
    module.notes = []
    monkeypatch.setattr(module, "report", lambda note: module.notes.append(note))
    return module


def camera(name: str, *, kind: str = "PERSP", focused: bool = False, hidden: bool = False) -> SimpleNamespace:
    curve = SimpleNamespace(driver=SimpleNamespace())
    dof = SimpleNamespace(use_dof=focused, driver_remove=lambda _: None, driver_add=lambda _: curve)
    data = SimpleNamespace(type=kind, dof=dof)
    return SimpleNamespace(name=name, name_full=name, type="CAMERA", data=data, hide_render=hidden)


def scene(engine: str = "CYCLES", *, blurred: bool = False, **attributes: Any) -> SimpleNamespace:
    layer = SimpleNamespace(
        use=True, name="ViewLayer", samples=0, use_pass_z=False, use_pass_vector=False, use_pass_normal=False,
        use_pass_diffuse_color=False,
        cycles=SimpleNamespace(use_denoising=False, denoising_store_passes=False),
    )  # fmt: skip
    cycles = SimpleNamespace(
        samples=64, use_layer_samples="USE", seed=3, driver_remove=lambda _: None, use_denoising=False,
        use_animated_seed=False, use_adaptive_sampling=True,
        pixel_filter_type=WIDE[0], filter_width=WIDE[1], denoiser="OPTIX", denoising_input_passes="RGB",
        denoising_prefilter="FAST",
    )  # fmt: skip
    render = SimpleNamespace(
        engine=engine, use_motion_blur=blurred, use_freestyle=False, frame_map_old=100, frame_map_new=100
    )  # fmt: skip
    found: dict[str, Any] = {"name": "Scene", "cycles": cycles, "render": render, "view_layers": [layer]}
    found |= {"timeline_markers": [], "camera": camera("A"), "objects": []}
    return SimpleNamespace(**found | attributes)


def markers(*switches: tuple[int, SimpleNamespace | None]) -> list[SimpleNamespace]:
    return [SimpleNamespace(frame=frame, camera=item) for frame, item in switches]


@pytest.mark.parametrize(
    ("engine", "denoise", "scale", "want"),
    [
        ("CYCLES", None, None, "temporal"), ("CYCLES", None, 2.0, "frame"), ("CYCLES", "off", None, "off"),
        ("CYCLES", "frame", 1.0, "frame"), ("CYCLES", "temporal", None, "temporal"),
        ("BLENDER_EEVEE_NEXT", None, None, "off"), ("BLENDER_WORKBENCH", "frame", None, "off"),
    ],
)  # fmt: skip
def test_cycles_is_denoised_over_time_unless_asked_otherwise(
    script: Any, engine: str, denoise: str | None, scale: float | None, want: str
) -> None:
    assert script.chosen_denoising(scene(engine), denoise, scale) == want
    with pytest.raises(script.BlenderSceneError, match=r"BLENDER_EEVEE has no noise .* --engine cycles"):
        script.chosen_denoising(scene("BLENDER_EEVEE"), "temporal", None)


def prepared(script: Any, denoise: str) -> tuple[Any, Any, Any]:
    """Return a scene of Cycles that is set to be denoised so, its settings and its layer."""
    ours = scene()
    script.set_engine(ours, ours.view_layers[0], None, denoise)
    script.set_passes(ours, ours.view_layers[0], denoise)
    return ours, ours.cycles, ours.view_layers[0]


def test_frames_to_denoise_have_the_scenes_samples_and_filter_and_clean_guides(script: Any) -> None:
    ours, cycles, layer = prepared(script, "temporal")
    assert (cycles.samples, cycles.use_adaptive_sampling) == (64, True)
    assert (cycles.pixel_filter_type, cycles.filter_width) == WIDE
    assert (cycles.use_denoising, cycles.denoiser) == (True, "OPENIMAGEDENOISE")
    assert (cycles.denoising_prefilter, cycles.denoising_input_passes) == ("ACCURATE", "RGB_ALBEDO_NORMAL")
    assert (layer.use_pass_z, layer.use_pass_vector, layer.use_pass_normal) == (True, True, False)
    assert cycles.use_animated_seed
    assert layer.cycles.denoising_store_passes
    assert layer.cycles.use_denoising
    assert "Cycles renders at full size with 64 samples, and denoises; --scale 2" in script.notes[0]
    for number, use, given, want in (
        (9, "USE", None, 9), (9, "USE", 4, 4), (90, "BOUNDED", None, 64), (9, "IGNORE", None, 64),
    ):  # fmt: skip
        layer.samples, cycles.use_layer_samples, cycles.samples = number, use, 64
        script.set_engine(ours, layer, given, "temporal")
        assert (cycles.samples, cycles.use_layer_samples) == (want, "IGNORE")


@pytest.mark.parametrize("denoise", ["frame", "off"])
def test_frames_to_upscale_have_points_as_pixels(script: Any, denoise: str) -> None:
    _, cycles, layer = prepared(script, denoise)
    assert (cycles.samples, cycles.use_adaptive_sampling) == (16, False)
    assert (cycles.filter_width, cycles.denoising_prefilter) == (0.01, "NONE")
    assert cycles.use_denoising == layer.cycles.use_denoising == (denoise == "frame")
    assert layer.use_pass_normal
    assert not layer.cycles.denoising_store_passes


def test_a_trial_has_other_noise_and_a_fixed_number_of_samples(script: Any) -> None:
    ours = scene()
    with pytest.raises(script.BlenderSceneError, match="samples adaptively, up to 64 times: pass --samples"):
        script.set_trial(ours, None, 1)
    pencil = SimpleNamespace(name="Stroke", type="GREASEPENCIL", hide_render=False)
    ours.objects = ours.view_layers[0].objects = [pencil]
    ours.render.use_freestyle = ours.view_layers[0].use_freestyle = True
    assert script.strokes(ours, ours.view_layers[0]) == ["Stroke", "Freestyle"]
    assert "Stroke, Freestyle: Blender adds these strokes after Cycles has denoised" in script.notes[-1]
    script.set_trial(ours, 8, 1)
    assert (ours.cycles.seed, ours.cycles.use_adaptive_sampling) == (4, False)
    assert script.strokes(ours, ours.view_layers[0]) == []  # noisy colours, which trials compare, lack it


def test_frames_are_written_in_the_space_of_the_scene_whatever_its_output_is(script: Any) -> None:
    ours = scene(sequence_editor=None, use_nodes=False, view_settings=SimpleNamespace(use_curve_mapping=True))
    output = ours.render.image_settings = SimpleNamespace(color_management="OVERRIDE")
    ours.render.use_compositing = ours.render.use_sequencer = False
    ours.render.use_stamp = True
    script.set_output(ours, "temporal")
    assert (output.color_management, output.file_format) == ("FOLLOW_SCENE", "OPEN_EXR_MULTILAYER")
    assert not ours.render.use_stamp, "text of the metadata is no part of the scene"
    assert "metadata is not burned into the frames" in script.notes[0]
    assert "curves and white balance of the colour management are not applied" in script.notes[1]


def test_the_compositor_is_where_blender_4_or_5_has_it(script: Any) -> None:
    tree = object()
    effects = [
        SimpleNamespace(enable_for_render=is_on, node_group=group)
        for is_on, group in ((True, tree), (False, object()), (True, None))
    ]
    for attributes, want in (
        ({"use_nodes": False, "node_tree": tree}, []), ({"use_nodes": True, "node_tree": tree}, [tree]),
        ({"use_nodes": True, "compositing_node_group": None}, []),
        ({"use_nodes": True, "compositing_node_group": tree}, [tree]),
        ({"use_nodes": True, "compositing_node_group": object(), "compositor_effects": effects}, [tree]),
    ):  # fmt: skip
        assert script.compositors_of(scene(**attributes)) == want


@pytest.mark.parametrize(("modifiers", "points"), [(["GENERATOR"], []), ([], [(0.0, 0.0), (1.0, 1.0)])])
def test_a_driven_shift_has_the_keys_of_the_frames_alone(
    script: Any, modifiers: list[str], points: list[tuple[float, float]]
) -> None:
    """Blender 4 gives the curve of a new driver a modifier, Blender 5 two keys; both are removed."""
    target = SimpleNamespace()
    variables = SimpleNamespace(new=lambda: SimpleNamespace(targets=[target]))
    curve = SimpleNamespace(
        driver=SimpleNamespace(variables=variables), modifiers=modifiers, keyframe_points=points
    )
    data = SimpleNamespace(driver_remove=lambda _: None, driver_add=lambda _: curve)
    assert script.shift_curve(scene(), data, "shift_x") is curve
    assert (modifiers, points, target.data_path) == ([], [], "frame_current")


@pytest.mark.parametrize(
    ("first", "last", "most", "want"),
    [(1, 48, None, (1, 48)), (1, 48, 5, (22, 26)), (7, 9, 5, (7, 9)), (0, 0, 5, (0, 0)), (3, 8, 5, (3, 7))],
)
def test_a_trial_takes_the_middle_of_the_scene(
    script: Any, first: int, last: int, most: int | None, want: tuple[int, int]
) -> None:
    assert script.own_range(scene(frame_start=first, frame_end=last), most) == want


@pytest.mark.parametrize("denoise", ["temporal", "frame"])
def test_blur_is_off_and_a_note_says_how_to_keep_it(script: Any, denoise: str) -> None:
    ours = scene(blurred=True, camera=camera("A", focused=True))
    script.set_blur(ours, keep=False, denoise=denoise)
    assert not ours.render.use_motion_blur
    assert not ours.camera.data.dof.use_dof
    assert ours.camera.data.dof.driver_add("use_dof").driver.type == "SUM"  # where its animation turns it on
    assert [note.split(":")[0] for note in script.notes] == ["motion blur is off", "depth of field is off"]
    assert all(("--keep-blur" in note) == (denoise == "temporal") for note in script.notes)


def test_blur_that_is_kept_costs_the_vectors_and_a_note_says_so(script: Any) -> None:
    ours = scene(blurred=True, camera=camera("A", focused=True))
    script.set_blur(ours, keep=True, denoise="temporal")
    script.set_passes(ours, ours.view_layers[0], "temporal")
    assert ours.render.use_motion_blur
    assert ours.camera.data.dof.use_dof
    assert not ours.view_layers[0].use_pass_vector
    assert [note.split(":")[0] for note in script.notes] == ["motion blur is kept", "depth of field is kept"]
    with pytest.raises(script.BlenderSceneError, match="--keep-blur is for temporal denoising"):
        script.set_blur(ours, keep=True, denoise="frame")


def test_each_marker_of_another_camera_is_a_cut(script: Any) -> None:
    a, b, hidden = camera("A"), camera("B", focused=True), camera("C", hidden=True)
    ours = scene(timeline_markers=markers((30, a), (1, a), (10, a), (12, None), (20, b), (25, hidden)))
    assert script.camera_switches(ours) == [20, 30]
    assert script.used_cameras(ours) == [a, b]
    ours.render.frame_map_new = 250
    assert script.camera_switches(ours) == [50, 75]
    script.set_blur(ours, keep=False, denoise="temporal")
    assert not b.data.dof.use_dof


def test_a_camera_that_is_named_is_used_without_cuts(script: Any) -> None:
    a, b = camera("A"), camera("B")
    ours = scene(timeline_markers=markers((1, a), (9, b)), objects=[a, b])
    script.choose_camera(ours, "B")
    assert (ours.camera, script.camera_switches(ours), script.notes) == (b, [], [])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda ours: setattr(ours, "camera", None), "no active camera: add one"),
        (lambda ours: setattr(ours.camera.data, "type", "PANO"), "camera 'A' is panoramic"),
        (lambda ours: setattr(ours.camera, "type", "LIGHT"), "camera 'A' is of type LIGHT"),
    ],
)
def test_unusable_cameras_are_refused(script: Any, change: Callable[[Any], None], message: str) -> None:
    ours = scene()
    change(ours)
    with pytest.raises(script.BlenderSceneError, match=message):
        script.choose_camera(ours, None)


@pytest.mark.parametrize(
    ("engine", "kind", "camera_moves", "noted"),
    [
        ("CYCLES", "ORTHO", True, True), ("CYCLES", "ORTHO", False, False), ("CYCLES", "PERSP", True, False),
        ("BLENDER_EEVEE", "ORTHO", True, False), ("BLENDER_WORKBENCH", "PERSP", False, True),
    ],
)  # fmt: skip
def test_objects_that_move_are_named_where_their_motion_is_unknown(
    script: Any, engine: str, kind: str, camera_moves: bool, noted: bool
) -> None:
    """Vectors of Cycles are wrong only while an orthographic camera moves."""
    script.bpy.context = SimpleNamespace(evaluated_depsgraph_get=lambda: None)
    eye, cube = camera("A", kind=kind), SimpleNamespace(name="Cube", type="MESH", hide_render=False)
    eye.data.ortho_scale = 8.0
    for item in (eye, cube):
        item.matrix_world, item.evaluated_get = [0.0], lambda _, item=item: item
    warner = script.MovedObjects(scene(engine, camera=eye, objects=[eye, cube]))
    for index in range(3):
        cube.matrix_world, eye.matrix_world = [float(index)], [float(camera_moves * index)]
        warner.warn()
    assert sum("objects move, and will blur: Cube" in note for note in script.notes) == noted


def test_objects_that_move_are_not_named_for_an_orthographic_camera_that_is_not_in_use(script: Any) -> None:
    """Nor at a cut to one, where the history is dropped."""
    script.bpy.context = SimpleNamespace(evaluated_depsgraph_get=lambda: None)
    eye, other = camera("A"), camera("B", kind="ORTHO")
    cube = SimpleNamespace(name="Cube", type="MESH", hide_render=False)
    for item in (eye, other, cube):
        item.matrix_world, item.evaluated_get = [0.0], lambda _, item=item: item
    eye.data.ortho_scale = other.data.ortho_scale = 8.0
    ours = scene(camera=eye, objects=[eye, other, cube], timeline_markers=markers((1, eye), (3, other)))
    warner = script.MovedObjects(ours)
    for index in range(1, 5):
        cube.matrix_world, eye.matrix_world = [float(index)], [float(index)]
        ours.camera = eye if index < 3 else other
        warner.warn()
    assert script.notes == []
    other.matrix_world = cube.matrix_world = [9.0]
    warner.warn()
    assert len(script.notes) == 1


@pytest.mark.parametrize(
    ("version", "denoise", "length", "refused"),
    [
        ((4, 5, 0), "temporal", 45, False),
        ((4, 5, 0), "temporal", 46, True),
        ((4, 5, 0), "frame", 53, False),
        ((4, 5, 0), "off", 54, True),
        ((5, 0, 0), "temporal", 63, False),
    ],
)
def test_a_view_layer_is_refused_where_blender_cuts_off_the_names_of_its_channels(
    script: Any, version: tuple[int, ...], denoise: str, length: int, *, refused: bool
) -> None:
    script.bpy.app = SimpleNamespace(version=version)
    layer = SimpleNamespace(name="\u00e9" + "a" * (length - 2))  # two bytes in UTF-8
    if not refused:
        script.check_name(layer, denoise)
        return
    with pytest.raises(script.BlenderSceneError, match=f"has {length} bytes; want at most {length - 1}"):
        script.check_name(layer, denoise)


def test_files_that_are_missing_are_noted(script: Any, tmp_path: Path) -> None:
    def item(name: str, source: str = "FILE", *, users: int = 1, packed: object = None) -> SimpleNamespace:
        return SimpleNamespace(filepath=name, source=source, users=users, packed_file=packed, library=None)

    (tmp_path / "there.png").touch()
    images = [item("//there.png"), item("//gone.png"), item("//packed.png", packed=object())]
    images += [item("//unused.png", users=0), item("", "VIEWER"), item("")]
    script.bpy.data = SimpleNamespace(libraries=[item("//lib.blend")], images=images)
    script.bpy.app = SimpleNamespace(version=(4, 5, 0), autoexec_fail=False)
    script.bpy.ops = SimpleNamespace(wm=SimpleNamespace(open_mainfile=lambda **_: None))
    script.bpy.path = SimpleNamespace(
        abspath=lambda path, **_: path and str(tmp_path / path.removeprefix("//"))
    )
    script.open_scene("scene.blend")
    assert script.notes == ["files are missing, and frames lack what they hold: //lib.blend, //gone.png"]


def test_a_path_that_is_not_utf8_is_reported(
    script: Any, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SUPERSAMPLER_RENDER", json.dumps({"token": "TOKEN"}))
    module_of(Path(script.__file__)).report(note="//\udcff\u00e9\n.png")
    assert msgspec.json.decode(capfd.readouterr().out.strip().removeprefix("TOKEN")) == {
        "note": "//?\u00e9\n.png"
    }
