"""render.json: what `supersampler blender` renders into a folder, and the camera of each complete frame."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ShotError
from supersampler.frame import Size
from supersampler.io.files import write_text
from supersampler.io.json_fields import Field, read_json
from supersampler.io.limits import SHOT_FRAMES
from supersampler.io.shot.format import LARGEST_NUMBER

RENDER_FILE = "render.json"
_VERSION = 1


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """The camera of one frame, as Blender evaluates it.

    Attributes:
        matrix: (4, 4) float64, projection @ view with lens shift and jitter, row-major, acting on column
            vectors; clip space from -1 to 1, y up.
        shift: (x right, y up) of the lens, in render pixels, without jitter.
    """

    matrix: NDArray[np.float64]
    shift: tuple[float, float]

    @classmethod
    def of(cls, frame: Field) -> "Camera":
        """Read a camera from {"camera": 4 rows of 4, "shift": [x, y]}; ShotError where it is not that."""
        rows = [[float(item.number()) for item in row.items(4)] for row in frame["camera"].items(4)]
        if [len(row) for row in rows] != [4, 4, 4, 4] or not np.linalg.det(rows):
            frame["camera"].refuse("4 rows of 4 numbers, an invertible matrix")
        return cls(np.array(rows), frame["shift"].pair())

    def to_json(self) -> dict[str, object]:
        """Return what `of` reads."""
        return {"camera": self.matrix.tolist(), "shift": self.shift}


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedScene:
    """What Blender says of the scene that it renders.

    Attributes:
        name: of the scene.
        blender: Blender's version.
        engine: Blender's name of the render engine.
        layer: name of the view layer.
        numbers: of its own first and last frame.
        frame_rate: frames a second.
        render_size: (width, height) of the frames.
        display_size: (width, height) of the images to make of them.
        view: display, view, look, exposure (stops) and gamma of Blender's colour management.
        ocio: file of Blender's OpenColorIO configuration.
    """

    name: str
    blender: str
    engine: str
    layer: str
    numbers: tuple[int, int]
    frame_rate: float
    render_size: Size
    display_size: Size
    view: Mapping[str, Any]
    ocio: str

    @classmethod
    def of(cls, scene: Field) -> "RenderedScene":
        """Read a scene; ShotError for a missing or wrong entry."""
        numbers = [number.whole(0, LARGEST_NUMBER) for number in scene["numbers"].items(2)]
        if len(numbers) != 2:
            scene["numbers"].refuse("[first, last]")
        view = scene["view"]
        return cls(
            name=scene["name"].text(),
            blender=scene["blender"].text(),
            engine=scene["engine"].text(),
            layer=scene["layer"].text(),
            numbers=(numbers[0], numbers[1]),
            frame_rate=scene["frame_rate"].rate(),
            render_size=scene["render_size"].size(),
            display_size=scene["display_size"].size(),
            view={
                **{name: view[name].text() for name in ("display", "view", "look")},
                **{name: float(view[name].number(-32.0, 32.0)) for name in ("exposure", "gamma")},
            },
            ocio=scene["ocio"].text(),
        )

    def to_json(self) -> dict[str, object]:
        """Return what `of` reads."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderRecord:
    """Content of render.json.

    Attributes:
        settings: all that the frames depend on; JSON values.
        first: number of the first frame.
        jitter: (x right, y down) of the first frames, in render pixels; then they repeat.
        scene: None until Blender has opened the file.
        cameras: of the frames that are listed, from the first on.
    """

    settings: Mapping[str, Any]
    first: int
    jitter: tuple[tuple[float, float], ...]
    scene: RenderedScene | None = None
    cameras: tuple[Camera, ...] = ()

    def write(self, folder: Path) -> None:
        """Write render.json into the folder; ShotError where the disk refuses."""
        content = {
            "version": _VERSION,
            "settings": self.settings,
            "first": self.first,
            "jitter": self.jitter,
            "scene": None if self.scene is None else self.scene.to_json(),
        }
        head = "".join(f'  "{key}": {json.dumps(value)},\n' for key, value in content.items())
        frames = ",\n".join("    " + json.dumps(camera.to_json()) for camera in self.cameras)
        write_text(folder / RENDER_FILE, f'{{\n{head}  "frames": [\n{frames}\n  ]\n}}\n')


def read_render_record(folder: Path) -> RenderRecord:
    """Read render.json of a folder; ShotError where it is missing, damaged or of another version."""
    path = folder / RENDER_FILE
    header = Field(path, "the file", read_json(path))
    version = header["version"].of(int)
    if version != _VERSION:
        hint = "Render it again, or update supersampler."
        raise ShotError(path, f"is of version {version}; this package reads {_VERSION}", hint)
    jitter = tuple(pair.pair() for pair in header["jitter"].items(SHOT_FRAMES))
    if not jitter:
        header["jitter"].refuse("[x, y] of one frame or more")
    return RenderRecord(
        settings=header["settings"].of(dict),
        first=header["first"].whole(0, LARGEST_NUMBER),
        jitter=jitter,
        scene=header.read("scene", RenderedScene.of, None),
        cameras=tuple(Camera.of(frame) for frame in header["frames"].items(SHOT_FRAMES)),
    )
