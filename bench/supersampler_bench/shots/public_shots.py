"""Settings and folders of the public test shots, and hashes that identify their pixels."""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from supersampler import Shot, ShotError
from supersampler.frame import Size
from supersampler.io.files import replacing
from supersampler.io.json_files import read_json
from supersampler_model.data.shots import variant_name

NAME = "test-shots"
CACHE_VARIABLE = "SUPERSAMPLER_CACHE"
FROZEN = Path(__file__).parent / "frozen.json"
"""Hashes of the pixels that every published number was measured on."""
PROVENANCE = "provenance.json"
"""File in a shot's folder with the driver and the settings that rendered it."""
_HOW = "`supersampler bench shots` renders it."


@dataclass(frozen=True, kw_only=True)
class TestShots:
    """Settings of test shots. Seeds were chosen by eye; no family here is trained on."""

    __test__ = False  # pytest would collect a class of this name

    seeds: Mapping[str, int] = field(  # by family
        default_factory=lambda: {
            "machine_hall": 4,  # thin grilles, sparks and steam; a cut, and an exposure that adapts
            "market": 4,  # a fast walk among people and awnings; dust and smoke
            "night_garden": 4,  # leaves, grass and fireflies under coloured lights that pulse
            "gallery": 5,  # metal that turns, a polished floor, a moving spot; an exposure that adapts
            "court": 3,  # nets, a fence, bouncing balls, dust; its exposure is measured
        }
    )
    frames: int = 40
    display_size: Size = (640, 360)  # of references and display-size G-buffers
    ratios: tuple[float, ...] = (1.5, 2.0, 3.0, 4.0)
    samples: int = 64  # per pixel of the reference
    thin: bool = False  # whether thin objects are a class
    truth: bool = False  # whether frames have the planes of truth and AOVs that corners.py reads

    def facts(self, family: str) -> dict[str, Any]:
        """Return the settings of one shot for JSON."""
        return {
            "family": family,
            "seed": self.seeds[family],
            "frames": self.frames,
            "display_size": list(self.display_size),
            "samples": self.samples,
        }


TEST_SHOTS = TestShots(ratios=(1.5, 2.0, 3.0, 4.0, 1.0))
"""The five shots of published means. Ratio 1 is last because it was added to existing shots."""
RIGGING_SHOT = TestShots(seeds={"rigging": 113}, thin=True)
"""Ropes, chains, chain-link and power lines."""
CORNER_SHOTS = TestShots(
    seeds={
        "thin_movers": 5,  # wires that swing, fans of rods, fences that pass; a cut
        "moving_shadows": 2,  # of blades, wagons, balls and rods, and those of a lamp that swings; a cut
    },
    frames=24,
    truth=True,
)
"""Shots where history helps least: see docs/quality.md."""
APART_SHOTS = (RIGGING_SHOT, CORNER_SHOTS)
"""Shots that are reported separately and in no mean."""


@dataclass(frozen=True)
class PublicShot:
    """A test shot at one ratio, complete on disk."""

    shot: Shot
    ratio: float
    driver: str  # OpenGL device and version
    digest: str  # SHA-256 of the pixels
    frozen: str | None  # the frozen hash, if there is one
    frozen_driver: str | None  # that rendered the frozen pixels

    @property
    def as_frozen(self) -> bool:
        """Whether the pixels are those of the published numbers."""
        return self.digest == self.frozen

    def warning(self) -> str | None:
        """Return why scores may differ from published ones; None if the pixels are the frozen ones."""
        name = f"{self.shot.name} at {variant_name(self.ratio)}"
        if self.as_frozen:
            return None
        if self.frozen is None:
            return f"{name}: no hash is frozen for it; its pixels have {self.digest[:12]}"
        if self.driver != self.frozen_driver:
            return (
                f"{name}: rendered by {self.driver}, the frozen pixels by {self.frozen_driver}. "
                "Figures differ slightly from the published ones"
            )
        return (
            f"{name}: its pixels are not the frozen ones, although the same driver rendered them: the "
            "processor, the renderer or a scene differs, or files are damaged. Before you compare its "
            "figures with published ones, measure a published method on it"
        )

    def origin(self) -> dict[str, Any]:
        """Return the facts of the pixels for a record."""
        return {
            "ratio": self.ratio,
            "driver": self.driver,
            "pixels_sha256": self.digest,
            "as_frozen": self.as_frozen,
        }


def default_cache() -> Path:
    """Return the package's folder in the platform's cache folder."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local") / "supersampler"
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches/supersampler"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "supersampler"


def shot_folder(cache: Path, family: str) -> Path:
    """Return the folder of a test shot in a cache."""
    return cache / NAME / family


def shots_named(name: str) -> TestShots | None:
    """Return the five test shots, or one of APART_SHOTS by its name; None if there is no such shot."""
    if name == NAME:
        return TEST_SHOTS
    return next((replace(s, seeds={name: s.seeds[name]}) for s in APART_SHOTS if name in s.seeds), None)


def open_test_shots(cache: Path, ratios: Sequence[float], shots: TestShots, frozen: Path) -> list[PublicShot]:
    """Open the test shots in a cache folder, ratio by ratio, and hash their pixels.

    `frozen` is the file of the frozen hashes.

    Raises:
        ShotError: a shot is missing, incomplete or of other settings; with the command that renders it.
    """
    return [_opened(cache, family, ratio, shots, frozen) for ratio in ratios for family in shots.seeds]


def _opened(cache: Path, family: str, ratio: float, shots: TestShots, frozen: Path) -> PublicShot:
    folder = shot_folder(cache, family)
    path = folder / f"{variant_name(ratio)}.json"
    if ratio not in shots.ratios:
        made = ", ".join(f"{r:g}" for r in sorted(shots.ratios))
        raise ShotError(path, f"no test shot has the ratio {ratio:g}", f"They are made at {made}.")
    if not path.exists():
        raise ShotError(path, f"the test shot {family} at ratio {ratio:g} is not there", _HOW)
    provenance, shot = read_provenance(folder), Shot.open(path)
    if {name: provenance.get(name) for name in shots.facts(family)} != shots.facts(family):
        raise ShotError(path, "is of another version of the test shots", f"Delete {folder}: {_HOW}")
    if len(shot) < shots.frames:
        raise ShotError(path, f"has {len(shot)} of {shots.frames} frames", _HOW)
    content = _json(frozen)
    return PublicShot(
        shot=shot,
        ratio=ratio,
        driver=provenance["driver"],
        digest=pixel_hash(shot),
        frozen=content.get("pixels_sha256", {}).get(family, {}).get(variant_name(ratio)),
        frozen_driver=content.get("driver"),
    )


def read_provenance(folder: Path) -> dict[str, Any]:
    """Return the driver and the settings that rendered the shot in a folder; {} if there is none.

    Raises:
        ShotError: the shot is of an earlier version, without provenance.json.
    """
    path = folder / PROVENANCE
    if not path.exists() and any(folder.glob("*.json")):
        raise ShotError(path, "is missing: the shot is of an earlier version", f"Delete {folder}: {_HOW}")
    return _json(path)


def pixel_hash(shot: Shot) -> str:
    """Return the SHA-256 of all frames' content, which does not depend on the compression of files."""
    digest = sha256()
    for index in range(len(shot)):
        raw, classes = shot.read_raw(index), shot.read_classes(index)
        arrays: dict[str, Any] = {name: getattr(raw, name) for name in ("color", "depth", "motion", "aovs")}
        for group in ("gbuffer", "gbuffer_display"):
            arrays |= {f"{group}.{name}": array for name, array in (getattr(raw, group) or {}).items()}
        arrays["reference"] = shot.read_reference(index)
        if classes is not None:
            arrays |= classes.known()
        arrays |= {f"truth.{name}": plane for name, plane in shot.read_truth(index).items()}
        digest.update(repr((index, raw.jitter, raw.reset, raw.exposure)).encode())
        for name in sorted(arrays):
            array = arrays[name]
            if array is not None:
                digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
                digest.update(array.tobytes())
    return digest.hexdigest()


def freeze(shots: Sequence[PublicShot], path: Path) -> list[PublicShot]:
    """Write the hashes of some shots as the frozen ones; return the shots with these.

    Raises:
        ShotError: they were rendered by several drivers, or the file cannot be written.
    """
    drivers = sorted({shot.driver for shot in shots})
    if len(drivers) != 1:
        problem = f"the shots were rendered by {' and '.join(drivers)}"
        raise ShotError(path, problem, "One must render them all.")
    hashes: dict[str, dict[str, str]] = {}
    for shot in shots:
        hashes.setdefault(shot.shot.name, {})[variant_name(shot.ratio)] = shot.digest
    with replacing(path) as partial:
        text = json.dumps({"driver": drivers[0], "pixels_sha256": hashes}, indent=1) + "\n"
        partial.write_text(text, encoding="utf-8", newline="\n")
    return [replace(shot, frozen=shot.digest, frozen_driver=shot.driver) for shot in shots]


def _json(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    content = read_json(path)
    if not isinstance(content, dict):
        raise ShotError(path, "is not a description: want an object {...}", _HOW)
    return content
