"""Tests of shots that share their display-size files, and of class maps beside a reference."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler import ArgumentError, Frame, ShotError
from supersampler.io.images import read_exr
from supersampler.io.shot import ClassMaps, Shot, ShotWriter, copy_shot, open_source
from supersampler_model.data.scenes.analytic import Plane, checker

DISPLAY_SIZE = (32, 18)
SIZES = {"2x": (16, 9), "4x": (8, 5)}
SCENE = Plane(checker, (2.0, -1.0))
RANDOM = np.random.default_rng(0)
CLASSES = ClassMaps(*(RANDOM.integers(0, 3, (18, 32)).astype(np.uint8) for _ in range(2)))


def frame(index: int, size: tuple[int, int]) -> Frame:
    plain = SCENE.frame(index, size, (0.1 * index, 0.0))
    depth = SCENE.frame(index, DISPLAY_SIZE, (0.0, 0.0)).depth
    return Frame(
        color=plain.color,
        depth=plain.depth,
        motion=plain.motion,
        jitter=plain.jitter,
        gbuffer_display={"depth": depth * (1 + index)},
    )


def writer(folder: Path, variant: str, *, resume: bool = False) -> ShotWriter:
    return ShotWriter(
        folder, name="test", display_size=DISPLAY_SIZE, frame_rate=30, variant=variant, resume=resume
    )


def write_all(folder: Path, count: int = 2) -> None:
    writers = {variant: writer(folder, variant) for variant in SIZES}
    for index in range(count):
        for variant, size in SIZES.items():
            writers[variant].write(
                frame(index, size),
                reference=SCENE.truth(index, DISPLAY_SIZE, 1),
                classes=CLASSES,
                shared=variant != "2x",
            )


def test_variants_are_shots_of_their_own_over_one_set_of_references(tmp_path: Path) -> None:
    write_all(tmp_path)
    files = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*"))
    below = [f"{part}/000{i}.exr" for part in ("2x", "4x", "display", "reference") for i in (0, 1)]
    assert files == sorted([*below, "2x.json", "4x.json"])
    for variant, size in SIZES.items():
        for shot in (Shot.open(tmp_path / f"{variant}.json"), open_source(tmp_path / f"{variant}.json")):
            assert (len(shot), shot.render_size, shot.reference_indices) == (2, size, [0, 1])
            for item in shot:
                assert item.frame.gbuffer_display is not None
                wanted = frame(item.index, size)
                np.testing.assert_array_equal(item.frame.depth, wanted.depth)
                np.testing.assert_array_equal(item.reference, SCENE.truth(item.index, DISPLAY_SIZE, 1))


def test_a_variant_is_resumed_without_the_others(tmp_path: Path) -> None:
    write_all(tmp_path, count=1)
    with writer(tmp_path, "4x", resume=True) as again:
        assert len(again) == 1
        again.write(frame(1, SIZES["4x"]), reference=SCENE.truth(1, DISPLAY_SIZE, 1))
    assert len(Shot.open(tmp_path / "4x.json")) == 2
    assert len(Shot.open(tmp_path / "2x.json")) == 1
    with writer(tmp_path, "2x", resume=True) as first:  # the reference that is there is the other variant's
        first.write(frame(1, SIZES["2x"]), reference=SCENE.truth(1, DISPLAY_SIZE, 1))
    assert len(Shot.open(tmp_path / "2x.json")) == 2
    with pytest.raises(ShotError, match=r"4x\.json: a shot of 2 frames is there already"):
        writer(tmp_path, "4x")


def test_a_missing_shared_file_is_named_with_the_description_that_lists_it(tmp_path: Path) -> None:
    write_all(tmp_path)
    (tmp_path / "display" / "0001.exr").unlink()
    with pytest.raises(
        ShotError, match=r"display.0001\.exr: the file of frame 1 is missing\. 4x\.json lists it"
    ):
        Shot.open(tmp_path / "4x.json")


@pytest.mark.parametrize("compression", ["zip", "dwab:45"])
@pytest.mark.parametrize("thin", [None, CLASSES.ghost % 2])
def test_classes_are_read_as_they_were_written(
    tmp_path: Path, compression: str, thin: NDArray[np.uint8] | None
) -> None:
    classes = replace(CLASSES, thin=thin)
    with ShotWriter(
        tmp_path / "a",
        name="test",
        display_size=DISPLAY_SIZE,
        frame_rate=30,
        reference_compression=compression,
    ) as out:
        out.write(frame(0, (16, 9)), reference=SCENE.truth(0, DISPLAY_SIZE, 1), classes=classes)
        out.write(frame(1, (16, 9)), reference=SCENE.truth(1, DISPLAY_SIZE, 1))
        out.write(frame(2, (16, 9)))
    shot = Shot.open(tmp_path / "a")
    copy = copy_shot(shot, tmp_path / "b")
    for read in (shot.read_classes(0), copy.read_classes(0)):
        assert read is not None
        assert list(read.known()) == list(classes.known())
        for array, wanted in zip(read.known().values(), classes.known().values(), strict=True):
            assert array.dtype == np.uint8
            np.testing.assert_array_equal(array, wanted)
    assert shot.read_classes(1) is None
    assert shot.read_classes(2) is None
    assert set(read_exr(tmp_path / "a" / "reference" / "0001.exr")) == {"R", "G", "B"}


def test_classes_of_another_size_or_without_a_reference_are_refused(tmp_path: Path) -> None:
    out, small = writer(tmp_path, "2x"), ClassMaps(CLASSES.ghost[:-1], CLASSES.alias[:-1])
    with pytest.raises(ArgumentError, match=r"classes\.ghost is 32x17; want the shot's display size"):
        out.write(frame(0, (16, 9)), reference=SCENE.truth(0, DISPLAY_SIZE, 1), classes=small)
    with pytest.raises(ArgumentError, match=r"classes\.thin is 32x17"):
        out.write(
            frame(0, (16, 9)),
            reference=SCENE.truth(0, DISPLAY_SIZE, 1),
            classes=replace(CLASSES, thin=small.alias),
        )
    with pytest.raises(ArgumentError, match="classes is without a reference"):
        out.write(frame(0, (16, 9)), classes=CLASSES)
    assert len(out) == 0
