"""Tests of files as other software writes them: layouts, data windows, types, PNG, TIFF, headers."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OpenImageIO import ImageBuf, ImageBufAlgo, ImageOutput, ImageSpec, MakeTxTexture, TypeDesc

from exr_parts import write_parts
from supersampler import ArgumentError, Conventions, ShotError
from supersampler.conventions.encodings import srgb_decoded
from supersampler.io.images import read_exr, read_header, read_image, write_exr
from supersampler.io.shot import Shot, copy_shot, import_channels, open_source

WIDTH, HEIGHT = 9, 7
NAMES = ("R", "G", "B", "depth.Z", "motion.X", "motion.Y")
VALUES = np.random.default_rng(0).integers(1, 900, (HEIGHT, WIDTH, len(NAMES))).astype(np.float32) / 8
FAR = 50.0
OURS = Conventions(depth="linear", far=FAR)
SRGB = Conventions(srgb=True)
MAP = {"color": ["R", "G", "B"], "depth": "Z", "motion": ["motion/*.tif:R", "motion/*.tif:G"]}


def spec_of(names: tuple[str, ...] = NAMES, kind: str = "float", **attributes: Any) -> ImageSpec:
    spec = ImageSpec(WIDTH, HEIGHT, len(names), kind)
    spec.channelnames = names
    for name, value in attributes.items():
        setattr(spec, name, value)
    return spec


def test_parts_with_different_data_windows_are_one_image(tmp_path: Path) -> None:
    color, data = spec_of(NAMES[:3]), spec_of(NAMES[3:], x=2, width=5)
    data.full_width = WIDTH
    color.attribute("oiio:subimagename", "rgba")
    data.attribute("oiio:subimagename", "data")
    path = write_parts(tmp_path / "parts.exr", (color, VALUES[..., :3]), (data, VALUES[:, 2:7, 3:]))
    image = read_exr(path, outside={"data.depth.Z": FAR})
    want = np.full((HEIGHT, WIDTH), FAR)
    want[:, 2:7] = VALUES[:, 2:7, 3]
    np.testing.assert_array_equal(image["data.depth.Z"], want)
    np.testing.assert_array_equal(image["rgba.G"], VALUES[..., 1])


@pytest.mark.parametrize("stated", ["main", ""])
def test_parts_that_nuke_names_by_layer_and_view_are_recognised(tmp_path: Path, stated: str) -> None:
    layers = {"rgba": ("R", "G", "B"), "depth": ("Z",), "backward": ("u", "v")}
    parts, at = [], 0
    for layer, names in layers.items():
        spec = spec_of(names)
        spec.attribute("oiio:subimagename", f"{layer}.main")
        spec.attribute("view", stated)
        parts.append((spec, VALUES[..., at : at + len(names)]))
        at += len(names)
    write_parts(tmp_path / "f.0001.exr", *parts)
    raw = open_source(tmp_path, conventions=OURS).read_raw(0)
    np.testing.assert_array_equal(raw.color, VALUES[..., :3])
    np.testing.assert_array_equal(raw.depth, VALUES[..., 3])
    np.testing.assert_array_equal(raw.motion, VALUES[..., 4:])


def test_of_a_stereo_render_of_blender_5_the_first_view_is_read(tmp_path: Path) -> None:
    passes = {"Combined": "RGB", "Depth": "Z", "Vector": "XY", "Emission": "RGB"}
    parts = []
    for number, view in enumerate(("left", "right")):
        at = 0
        for name, axes in passes.items():
            spec = spec_of(tuple(f"Main.{name}.{axis}" for axis in axes))
            spec.attribute("oiio:subimagename", f"Main.{name}-{view}")
            spec.attribute("view", view)
            values = np.take(VALUES, range(at, at + len(axes)), axis=-1, mode="wrap")
            parts.append((spec, values * (1 - number)))
            at += len(axes)
    write_parts(tmp_path / "0001.exr", *parts)
    shot = open_source(tmp_path)
    raw = shot.read_raw(0)
    np.testing.assert_array_equal(raw.color, VALUES[..., :3])
    np.testing.assert_array_equal(raw.depth, VALUES[..., 3])
    np.testing.assert_array_equal(raw.motion, VALUES[..., 4:])
    assert shot.info.aov_names == ("Emission.R", "Emission.G", "Emission.B")
    assert len(shot.ignored_channels) == 9, "those of the right view"


def test_a_stereo_render_of_blender_4_is_answered_with_the_setting_to_change(tmp_path: Path) -> None:
    names = [f"Main.{name}.{{}}.{axis}" for name in ("Combined", "Vector") for axis in "XYZ"]
    spec = spec_of(tuple(name.format(view) for view in ("left", "right") for name in names))
    spec.attribute("multiView", TypeDesc("string[2]"), ("left", "right"))
    write_parts(tmp_path / "0001.exr", (spec, np.tile(VALUES, 2)))
    with pytest.raises(ShotError, match="Set Views Format to Individual"):
        open_source(tmp_path)


@pytest.mark.parametrize("origin", [(0, 0), (-7, -5), (100, 60)])
@pytest.mark.parametrize(("x", "y"), [(2, 1), (-3, -2), (4, -5), (20, 20)])
def test_outside_of_a_data_window_is_background(
    tmp_path: Path, x: int, y: int, origin: tuple[int, int]
) -> None:
    size = (12, 9)
    spec = spec_of(
        x=x + origin[0], y=y + origin[1], full_x=origin[0], full_y=origin[1], full_width=size[0],
        full_height=size[1],
    )  # fmt: skip
    write_parts(tmp_path / "in" / "f.0001.exr", (spec, VALUES))
    want = np.zeros((size[1], size[0], len(NAMES)), np.float32)
    want[..., 3] = FAR
    rows, columns = np.mgrid[: size[1], : size[0]]
    inside = (rows >= y) & (rows < y + HEIGHT) & (columns >= x) & (columns < x + WIDTH)
    want[inside] = VALUES[rows[inside] - y, columns[inside] - x]
    shot = open_source(tmp_path / "in", conventions=OURS)
    raw, frame = shot.read_raw(0), shot.read(0).frame
    assert shot.render_size == size
    np.testing.assert_array_equal(raw.color, want[..., :3])
    np.testing.assert_array_equal(raw.depth, want[..., 3])
    np.testing.assert_array_equal(raw.motion, want[..., 4:])
    assert (frame.depth[~inside] == 0).all()


@pytest.mark.parametrize(
    ("conventions", "sky"),
    [
        (Conventions(), 0),
        (Conventions(depth="reversed", far=9.0), 0),
        (Conventions(depth="forward_infinite"), 1),
        (Conventions(depth="linear"), np.inf),
    ],
)
def test_shots_of_any_depth_have_the_sky_outside(
    tmp_path: Path, conventions: Conventions, sky: float
) -> None:
    write_exr(tmp_path / "in" / "1.exr", {name: np.full((4, 12), 0.5, np.float32) for name in NAMES})
    shot = copy_shot(open_source(tmp_path / "in", conventions=conventions), tmp_path / "shot")
    spec = spec_of(full_width=12, full_height=4, height=4)
    write_parts(shot.path / "0000.exr", (spec, VALUES[:4]))
    for opened in (Shot.open(shot.path), open_source(shot.path / "####.exr", conventions=conventions)):
        assert (opened.read_raw(0).depth[:, WIDTH:] == sky).all()
        assert (opened.read(0).frame.depth[:, WIDTH:] == 0).all()


def test_a_display_window_that_would_take_too_much_memory_is_refused(tmp_path: Path) -> None:
    names = tuple(f"c{index:02d}" for index in range(17))
    spec = spec_of(names, width=1, height=1, full_width=1 << 15, full_height=1 << 12)
    path = write_parts(tmp_path / "large.exr", (spec, np.zeros((1, 1, 17), np.float32)))
    with pytest.raises(ShotError, match=r"large\.exr: has 8 GiB of pixels; want at most 8"):
        read_exr(path, outside={})


def test_deep_pixels_are_refused_by_name(tmp_path: Path) -> None:
    import OpenImageIO

    spec = spec_of(deep=True)
    data = OpenImageIO.DeepData()
    data.init(WIDTH * HEIGHT, len(NAMES), spec.channelformats or ("float",) * len(NAMES), NAMES)
    output: Any = ImageOutput.create(str(tmp_path / "deep.exr"))
    assert output.open(str(tmp_path / "deep.exr"), spec)
    output.write_deep_image(data)
    output.close()
    with pytest.raises(ShotError, match=r"deep\.exr: holds deep pixels"):
        read_exr(tmp_path / "deep.exr", outside={})


# PNG and TIFF


def write_frames(folder: Path, kind: str, suffix: str) -> np.ndarray:
    """One frame with colour of a type; returns its values from 0 to 1, or as they are."""
    values: np.ndarray = VALUES[..., :3]
    if kind != "float":
        values = np.random.default_rng(1).integers(0, np.iinfo(kind).max + 1, values.shape).astype(kind)
    write_parts(folder / "color" / f"c.0001.{suffix}", (spec_of(("R", "G", "B"), kind), values))
    write_parts(folder / "motion" / "m.0001.tif", (spec_of(("R", "G", "B")), VALUES[..., 3:]))
    write_exr(folder / "d.0001.exr", {"Z": VALUES[..., 5]})
    return values if kind == "float" else values.astype(np.float32) / np.float32(np.iinfo(kind).max)


def color_map(suffix: str) -> dict[str, list[str]]:
    return {"color": [f"color/*.{suffix}:{axis}" for axis in "RGB"]}


@pytest.mark.parametrize(
    ("kind", "suffix"),
    [("uint8", "png"), ("uint16", "png"), ("uint8", "tif"), ("uint16", "tiff"), ("float", "tif")],
)
def test_png_and_tiff_keep_their_values(tmp_path: Path, kind: str, suffix: str) -> None:
    values = write_frames(tmp_path, kind, suffix)
    conventions = SRGB if kind.startswith("uint") else OURS
    shot = import_channels(tmp_path, {**MAP, **color_map(suffix)}, conventions=conventions)
    raw: Any = shot.read_raw(0)
    np.testing.assert_allclose(raw.color, values, rtol=1e-7)
    np.testing.assert_array_equal(raw.depth, VALUES[..., 5])
    np.testing.assert_array_equal(raw.motion, VALUES[..., 3:5])
    assert (shot.stored_as, shot.info.file_names) == ((suffix[:3], kind), "c.####")


def test_an_image_that_is_stored_bottom_up_is_refused(tmp_path: Path) -> None:
    write_frames(tmp_path, "uint8", "tif")
    spec = spec_of(("R", "G", "B"), "uint8")
    spec.attribute("Orientation", 4)
    write_parts(tmp_path / "color" / "c.0001.tif", (spec, np.zeros((*VALUES.shape[:2], 3), np.uint8)))
    with pytest.raises(
        ShotError, match=r"c\.0001\.tif: states that its rows are turned .* \(orientation 4\)"
    ):
        import_channels(tmp_path, {**MAP, **color_map("tif")}, conventions=SRGB)


def test_integers_without_srgb_are_refused(tmp_path: Path) -> None:
    write_frames(tmp_path, "uint8", "png")
    message = r"conventions is without srgb=True, and c\.0001\.png holds uint8; want srgb=True for integers"
    with pytest.raises(ArgumentError, match=message):
        import_channels(tmp_path, {**MAP, **color_map("png")}, conventions=OURS)


@pytest.mark.parametrize("name", ["depth", "motion", "normal"])
def test_integers_of_data_that_no_packing_describes_are_refused(tmp_path: Path, name: str) -> None:
    write_frames(tmp_path, "uint8", "png")
    count = {"depth": 1, "motion": 2}.get(name, 3)
    wrong = {name: [f"color/*.png:{axis}" for axis in "RGB"[:count]]}
    with pytest.raises(ShotError, match=rf"c\.0001\.png: holds {name} as uint8; want half or float"):
        import_channels(tmp_path, {**MAP, **color_map("png"), **wrong}, conventions=SRGB)


@pytest.mark.parametrize(
    ("kind", "suffix", "stored"),
    [
        ("uint8", "png", "straight"),
        ("uint16", "tif", "straight"),
        ("uint16", "tif", "associated"),
        ("float", "tif", "straight"),
        ("float", "tif", "associated"),
    ],
)
def test_colours_are_multiplied_by_their_alpha_in_linear_light(
    tmp_path: Path, kind: str, suffix: str, stored: str
) -> None:
    write_frames(tmp_path, kind, suffix)  # motion and depth
    most = {"uint8": 255, "uint16": 65535, "float": 1.0}[kind]
    values = np.random.default_rng(1).random((HEIGHT, WIDTH, 4)) * 0.9 + 0.1
    alpha, pixels = values[..., 3:].copy(), values.copy()
    if stored == "associated":  # TIFF multiplies the values that it stores
        pixels[..., :3] *= alpha
    spec = spec_of(("R", "G", "B", "A"), kind)
    spec.attribute("oiio:UnassociatedAlpha", int(stored == "straight"))
    written = (pixels * most).round() if kind != "float" else pixels
    for name in ("color", "reference"):
        write_parts(tmp_path / name / f"c.0001.{suffix}", (spec, written.astype(kind)))
    channel_map = {
        **MAP, **color_map(suffix), "aovs": [f"color/*.{suffix}:A"],
        "reference": [f"reference/*.{suffix}:{axis}" for axis in "RGB"],
    }  # fmt: skip
    conventions = OURS if kind == "float" else SRGB
    shot = import_channels(tmp_path, channel_map, conventions=conventions, aov_names=["A"])
    frame, reference = shot.read(0).frame, shot.read_reference(0)
    linear = values[..., :3] if kind == "float" else srgb_decoded(values[..., :3])
    write_exr(tmp_path / "lit" / "c.0001.exr", dict.fromkeys("RGB", VALUES[..., 0]))
    lit = {**channel_map, "color": [f"lit/*.exr:{axis}" for axis in "RGB"]}
    of_exr = import_channels(tmp_path, lit, conventions=conventions).read_reference(0)
    assert frame.aovs is not None
    for found in (frame.color, reference, of_exr):
        assert found is not None
        np.testing.assert_allclose(found, linear * alpha, rtol=2e-5, atol=3.0 / 255 if most == 255 else 1e-4)
    np.testing.assert_allclose(frame.aovs, alpha, atol=0.5 / 255)


def test_only_the_first_page_of_a_tiff_is_read(tmp_path: Path) -> None:
    page = spec_of(("R", "G", "B"))
    path = write_parts(tmp_path / "pages.tif", (page, VALUES[..., :3]), (page, VALUES[..., 3:]))
    np.testing.assert_array_equal(read_image(path)["G"], VALUES[..., 1])


# Headers


@pytest.mark.parametrize(
    ("name", "value", "want"),
    [
        ("note", "none", "lin_rec709"),
        ("chromaticities", (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329), "lin_rec709"),
        ("chromaticities", (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767), "ACEScg"),
        ("chromaticities", (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329), "lin_rec2020"),
        ("chromaticities", (0.5, 0.3, 0.2, 0.7, 0.1, 0.1, 0.3, 0.3), "unknown"),
        ("colorInteropID", "lin_ap1_scene", "ACEScg"),
        ("colorInteropID", "lin_adobergb_scene", "unknown"),
    ],
)
def test_the_colour_space_is_what_the_header_states(tmp_path: Path, name: str, value: Any, want: str) -> None:
    spec = spec_of()
    if isinstance(value, tuple):
        spec.attribute(name, TypeDesc("float[8]"), value)
    else:
        spec.attribute(name, value)
    path = write_parts(tmp_path / "f.0001.exr", (spec, VALUES))
    assert read_header(path).color_space == want
    assert open_source(tmp_path, conventions=OURS).info.color_space == want
    stated = open_source(tmp_path, conventions=OURS, color_space="ARRI LogC4")
    assert stated.info.color_space == "ARRI LogC4"


# --- EXR files with features of OpenEXR's test images: each is read right, or refused by name ---


def luminance_chroma(path: Path) -> None:
    """Write Y, and RY and BY that state half the size, which OpenImageIO does not write."""
    write_exr(path, dict.fromkeys(["Y", "RY", "BY"], np.ones((4, 8), np.float16)))
    data = bytearray(path.read_bytes())
    for name in (b"RY", b"BY"):
        sampling = data.index(name) + 11  # after the name, the type, and the flag of linearity
        data[sampling : sampling + 8] = struct.pack("<ii", 2, 2)
    path.write_bytes(data)


def test_luminance_chroma_images_are_refused_with_a_converter(tmp_path: Path) -> None:
    luminance_chroma(tmp_path / "s.0001.exr")
    for read in (read_image, read_exr):
        with pytest.raises(
            ShotError, match=r"luminance and chroma \(Y, RY, BY\).* R, G and B; ImageM"
        ) as caught:
            read(tmp_path / "s.0001.exr")
        assert "damaged" not in str(caught.value)
    write_exr(tmp_path / "full" / "s.0001.exr", dict.fromkeys(["Y", "RY", "BY", *NAMES[3:]], VALUES[..., 0]))
    for folder in (tmp_path, tmp_path / "full"):
        with pytest.raises(ShotError, match="luminance and chroma"):
            open_source(folder, conventions=Conventions())


@pytest.mark.parametrize(
    ("content", "damaged"),
    [
        (b"", True),
        (bytes(100), True),
        (b"v/1\x01\x02\0\0\0", True),
        (b"\xff\xd8\xff\xe0 a JPEG file", False),
        (b"v/1\x01\x03\0\0\0" + bytes(90), False),  # a version to come
    ],
)
def test_only_incomplete_files_are_called_damaged(tmp_path: Path, content: bytes, damaged: bool) -> None:
    (tmp_path / "s.0001.exr").write_bytes(content)
    with pytest.raises(ShotError, match=r"\. \w+.*\.$") as caught:
        read_image(tmp_path / "s.0001.exr")
    assert ("damaged or cut off" in str(caught.value)) is damaged


def test_the_largest_level_of_a_mipmapped_file_is_read(tmp_path: Path) -> None:
    image = np.random.default_rng(0).random((32, 64, 3)).astype(np.float16)  # powers of two: not resampled
    write_exr(tmp_path / "plain.exr", image)
    path = tmp_path / "mip.exr"
    assert ImageBufAlgo.make_texture(MakeTxTexture, str(tmp_path / "plain.exr"), str(path))
    assert ImageBuf(str(path)).nmiplevels > 1
    np.testing.assert_array_equal(np.stack([read_exr(path)[name] for name in "RGB"], -1), image)
