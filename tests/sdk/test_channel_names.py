"""Tests of EXR frames that are recognised by the names of their channels."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from supersampler import ArgumentError, Conventions, ShotError
from supersampler.cli.arguments import source_notes
from supersampler.io.images import Metadata, TypedValues, read_exr, write_exr
from supersampler.io.shot import Shot, copy_shot, import_channels, import_named_channels, open_source
from supersampler.io.shot.named_channels import _NAMES, recognised_map
from supersampler.io.shot.sources import Layout
from upscale_runs import run

OURS = Conventions()
COLOR, DEPTH, MOTION = ["R", "G", "B"], ["Z"], ["motion.X", "motion.Y"]


def write_one(folder: Path, *channels: str, metadata: Metadata | None = None) -> Path:
    """One frame whose channels hold their place in the list."""
    image: Any = {name: np.full((6, 8), index / 16, np.float32) for index, name in enumerate(channels)}
    write_exr(folder / "f.0001.exr", image, metadata=metadata)
    return folder


def opened(folder: Path, *channels: str) -> Shot:
    return open_source(write_one(folder, *channels), conventions=OURS)


def spellings(ours: str) -> list[list[str]]:
    """Return all names of an array that are recognised, also in capitals, spaced, with a layer, or alone."""
    bases, endings = _NAMES[ours]
    bases = *bases, *map(" ".join, bases)
    groups = [[f"{base}.{letter}".lstrip(".") for letter in ending] for base in bases for ending in endings]
    groups += [[base] for base in bases if ours in ("depth", "roughness", "metallic", "specular")]
    groups += [[name.upper() for name in group] for group in groups]
    return [*groups, *([f"a.b.{name}" for name in group] for group in groups if "." in group[0])]


@pytest.mark.parametrize("ours", [name for name in _NAMES if name != "motion_next"])
def test_a_name_in_wide_use_is_recognised_in_any_order(ours: str) -> None:
    for names in spellings(ours):
        usual = {"color": COLOR, "depth": DEPTH, "motion": MOTION, ours: names}
        channels = [name for group in usual.values() for name in group]
        assert recognised_map(Path("f.exr"), channels) == usual
        assert recognised_map(Path("f.exr"), channels[::-1]) == usual


@pytest.mark.parametrize(
    "name", ["Crypto00.R", "Denoising Depth.Z", "P.Z", "backward.u", "diffuse.R", "N.Z", "specular.R"]
)
def test_unknown_channel_names_have_no_meaning(name: str) -> None:
    usual = {"color": COLOR, "depth": DEPTH, "motion": MOTION}
    channels = [name, *(name for group in usual.values() for name in group)]
    assert recognised_map(Path("f.exr"), channels) == usual


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (["beauty.R", "beauty.G", "beauty.B"], r"several channels for color: R, G, B and beauty\.R"),
        (["r", "g", "b"], r"several channels for color: R, G, B and r, g, b"),
        (["depth.Z"], r"several channels for depth: Z and depth\.Z\. Choose in a channels"),
        (["backward.u", "backward.v"], r"several channels for motion: backward\.u, backward\.v and motion"),
    ],
)
def test_two_candidates_are_an_error_with_both_names(tmp_path: Path, extra: list[str], message: str) -> None:
    with pytest.raises(ShotError, match=message):
        opened(tmp_path, *COLOR, *DEPTH, *MOTION, *extra)


@pytest.mark.parametrize("other", ["r", "g", "b", "motion.y", "MOTION.Y", "Motion.x"])
def test_a_name_that_differs_only_in_its_case_is_another_channel(other: str) -> None:
    usual = {"color": COLOR, "depth": DEPTH, "motion": MOTION}
    channels = [name for group in usual.values() for name in group]
    assert recognised_map(Path("f.exr"), [other, *channels]) == usual
    assert recognised_map(Path("f.exr"), [*channels, other]) == usual


def test_forward_vectors_beside_backward_ones_lead_to_the_next_frame(tmp_path: Path) -> None:
    write_one(tmp_path, "forward.v", "forward.u", "backward.v", "backward.u", *COLOR, *DEPTH)
    raw: Any = open_source(tmp_path, conventions=OURS).read_raw(0)
    np.testing.assert_array_equal(raw.motion_next[0, 0], np.array([1, 0]) / 16)
    np.testing.assert_array_equal(raw.motion[0, 0], np.array([3, 2]) / 16)
    jittered = open_source(tmp_path, conventions=Conventions(motion_jittered=True)).read(0)
    assert jittered.raw.motion_next is None  # the next frame's jitter would be in it


@pytest.mark.parametrize("layout", ["auto", "channels"])
def test_forward_vectors_are_never_motion_to_the_previous_frame(tmp_path: Path, layout: Layout) -> None:
    forward = ["forward.u", "forward.v"]
    write_one(tmp_path / "alone", *forward, *COLOR, *DEPTH)
    message = r"motion to the next frame, forward\.u, forward\.v, and none to the previous .* Write backward"
    with pytest.raises(ShotError, match=message):
        open_source(tmp_path / "alone", layout=layout, conventions=OURS)
    shot = opened(tmp_path / "both", *forward, *MOTION, *COLOR, *DEPTH)
    raw = shot.read_raw(0)  # another program's vectors may be in other units than Nuke's
    assert (raw.motion[0, 0, 0], raw.motion_next, raw.aovs) == (2 / 16, None, None)
    assert set(shot.ignored_channels) == {*forward}


def test_conventions_are_not_guessed(tmp_path: Path) -> None:
    write_one(tmp_path, *COLOR, *DEPTH, *MOTION)
    with pytest.raises(ArgumentError, match=r"conventions is left out; want given.* `supersampler check"):
        open_source(tmp_path)


def test_channels_are_read_to_their_values_with_the_conventions_given(tmp_path: Path) -> None:
    write_one(tmp_path, "N.Z", "motion.Y", "B", "roughness", "Z", "N.X", "R", "motion.X", "G", "N.Y")
    raw: Any = open_source(tmp_path, conventions=Conventions(depth="linear")).read_raw(0)
    np.testing.assert_array_equal(raw.color[0, 0], np.array([6, 8, 2]) / 16)
    np.testing.assert_array_equal(raw.motion[0, 0], np.array([7, 1]) / 16)
    np.testing.assert_array_equal(raw.gbuffer["normal"][0, 0], np.array([5, 9, 0]) / 16)
    assert (raw.depth[0, 0], raw.gbuffer["roughness"][0, 0]) == (4 / 16, 3 / 16)


def test_other_channels_are_aovs_by_their_names_and_data_is_ignored_by_name(tmp_path: Path) -> None:
    color = ["beauty.R", "beauty.G", "beauty.B"]
    blended = ["beauty.A", "diffuse.R", "diffuse.G", "diffuse.B", "fog", "grid", "composition.R"]
    blended += ["ProxyMasked.R", "refraction_index", "AA_inv_density", "GlossyMotif.R"]
    data = [
        "P.X", "P.Y", "P.Z", "motion.Z", "uv.U", "worldPosition.R", "position.R", "objectId", "RenderID.Y",
        "id2", "primid", "object_id", "IndexOB.X", "crypto_object00.R", "VRayCryptomatte00.R", "ProxyMask.R",
        "ProxyMask00.R", "ProxyMask01.A", "prim_index", "shape_index.Y", "rawid", "sampleprimid",
        "__Pworld.x", "ObjectSpacePositions.R", "UV coordinates.R", "volume_Z", "zback",
        "Shading normal.R", "BumpNormals.G", "__Nworld.x", "motionFore.x", "camera_motion.x",
        "dPcameradtime.X",
    ]  # fmt: skip
    places = [*data, *blended, *color, *DEPTH, *MOTION]
    write_one(tmp_path / "in", *places, metadata={"cryptomatte/abc/name": "ProxyMask"})
    shot = open_source(tmp_path / "in", conventions=OURS)
    values = dict(zip(shot.info.aov_names or (), np.asarray(shot.read_raw(0).aovs)[0, 0] * 16, strict=True))
    assert values == {name.removeprefix("beauty."): places.index(name) for name in blended}
    assert set(shot.ignored_channels) == set(data)
    assert copy_shot(shot, tmp_path / "out").info.aov_names == shot.info.aov_names


def test_ids_beside_a_map_are_said_to_be_ignored_and_are_no_aovs(tmp_path: Path) -> None:
    ids = ["Proxy00.R", "id2", "crypto00.r"]
    folder = write_one(
        tmp_path, *COLOR, *DEPTH, *MOTION, "fog", *ids, metadata={"cryptomatte/1/name": "Proxy"}
    )
    described: dict[str, Any] = {"color": COLOR, "depth": DEPTH, "motion": MOTION, "aovs": ["fog"]}
    assert {*import_channels(folder, described, conventions=OURS).ignored_channels} == {*ids}
    for name in ids:
        with pytest.raises(ShotError, match=rf"holds ids in {name}; AOVs are blended\. Leave them out"):
            import_channels(folder, {**described, "aovs": ["fog", name]}, conventions=OURS)


@pytest.mark.parametrize(
    ("color", "alpha"),
    [(["rgba.red", "rgba.green", "rgba.blue"], "rgba.alpha"), (["r", "g", "b"], "a"), (COLOR, "A")],
)
def test_alpha_of_the_colour_has_one_name(tmp_path: Path, color: list[str], alpha: str) -> None:
    shot = opened(tmp_path, alpha, "glow.alpha", *color, *DEPTH, *MOTION)
    np.testing.assert_array_equal(np.asarray(shot.read_raw(0).color)[0, 0], np.array([2, 3, 4]) / 16)
    assert {*(shot.info.aov_names or ())} == {"A", "glow.alpha"}


def test_colour_by_an_unknown_name_is_said_to_be_missing(tmp_path: Path) -> None:
    lit = [f"lit.{part}" for part in ("red", "green", "blue")]
    for folder, names, message in (
        ("lit", [*lit, "fog"], r"no colour by a known name; lit\.red, lit\.green, lit\.blue may be it"),
        (
            "part",
            ["beauty.R", "beauty.G"],
            r"has beauty\.R, beauty\.G of the colour; want red, green and blue",
        ),
    ):
        with pytest.raises(ShotError, match=message):
            opened(tmp_path / folder, *names, *DEPTH, *MOTION)
    shot = opened(tmp_path / "unshaded", "fog", "smoke", *DEPTH, *MOTION, "N.X", "N.Y", "N.Z")
    assert shot.read_raw(0).color is None
    [note] = source_notes(shot)
    assert note.startswith("The frames have no colour: no R, G and B, nor another name that docs/shots.md")


def test_import_prints_what_is_not_read_and_unknown_primaries(tmp_path: Path) -> None:
    primaries = TypedValues("float[8]", (0.5, 0.3, 0.2, 0.7, 0.1, 0.1, 0.3, 0.3))
    names = (*COLOR, *DEPTH, *MOTION, "crypto00.R", "P.X")
    write_one(tmp_path / "in", *names, metadata={"chromaticities": primaries})
    done = run("import", tmp_path / "in", "-o", tmp_path / "out", "--conventions", "supersampler")
    assert "Not read, because they cannot be blended: P.X, crypto00.R" in done.stdout
    assert "The files' headers have unknown primaries. State the colour space: --color-space" in done.stdout
    assert Shot.open(tmp_path / "out").info.color_space == "unknown"


def test_a_pass_that_begins_in_a_later_frame_is_said_not_to_be_read(tmp_path: Path) -> None:
    write_one(tmp_path / "in", *COLOR, *DEPTH, *MOTION)
    first = tmp_path / "in" / "f.0001.exr"
    write_exr(first.with_name("f.0002.exr"), {**read_exr(first), "fog": np.zeros((6, 8), np.float32)})
    done = run("import", tmp_path / "in", "-o", tmp_path / "out", "--conventions", "supersampler")
    assert "Not read, because frame 1 lacks them: fog" in done.stdout
    first.with_name("f.0003.exr").write_bytes(b"v/1\x01")  # is still written
    assert open_source(tmp_path / "in", conventions=OURS).late_channels == ()


def test_references_of_recognised_frames_are_found_by_number(tmp_path: Path) -> None:
    write_one(tmp_path, *COLOR, *DEPTH, *MOTION)
    write_exr(tmp_path / "reference" / "r.0001.exr", np.full((12, 16, 3), 2, np.float32))
    shot = import_named_channels(tmp_path, conventions=OURS, reference="reference/r.####.exr")
    assert shot.display_size == (16, 12)
    reference: Any = shot.read(0).reference
    assert (reference == 2).all()


def test_the_documentation_lists_every_name() -> None:
    page = (Path(__file__).parents[2] / "docs" / "shots.md").read_text("utf-8")
    for ours, (bases, endings) in _NAMES.items():
        row = next(line for line in page.splitlines() if line.startswith(f"| `{ours}` | ") and "`." in line)
        for base in filter(None, bases):
            assert f"`{base}`" in row
        for ending in endings:
            assert " ".join(f".{part}" for part in ending) in row.lower()
