"""Render what blender_budget.py compares: three scenes, full-size frames and small ones, into a folder.

A budget is a number of samples of a full-size pixel; a small pixel gets SCALE squared times as many, so that
both trace as many rays. A run that was stopped continues: each frame that is complete is kept.
    nohup nice -n 19 python bench/studies/blender_renders.py out/budget --blender PATH > budget.log &
"""

import json
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from supersampler.frame import Size
from supersampler.integrations.blender import process
from supersampler.integrations.blender.render import RenderRequest, rendering

DISPLAY: Size = (640, 360)
SCALE = 2.0
FRAMES = (1, 24)
COMPARED = (24, 16)
"""Numbers of the frames that have references."""
BUDGETS = (1, 2, 4, 8)
REFERENCE = 1024
"""Samples of a pixel of the references."""
REGIONS = {
    "courtyard": (0.4, 0.86, 0.12, 0.56),
    "room": (0.4, 0.86, 0.14, 0.58),
    "shelf": (0.3, 0.76, 0.2, 0.64),
}
"""Scenes, and the part of the frame that is compared: left, right, bottom, top, from 0 to 1."""
_HERE = Path(__file__).resolve().parent


@dataclass(frozen=True, kw_only=True)
class FrameSet:
    """Frames of one scene that are rendered alike; OIDN gets guides (albedo, normal) as Cycles filters them.

    With `exact_guides` it gets them as they are, as in the frames of `supersampler blender`.
    """

    scene: str
    frames: tuple[int, int]
    samples: int
    denoise: bool = False
    small: bool = False
    exact_guides: bool = False
    reference: bool = False

    @property
    def name(self) -> str:
        """Of the folder; the frames are in its folder `frames`."""
        kind = "reference" if self.reference else "small" if self.small else "full"
        suffix = f"-{self.frames[0]}" if self.frames[0] == self.frames[1] else ""
        oidn = "-oidn-exact" if self.exact_guides else "-oidn" if self.denoise else ""
        return f"{self.scene}-{kind}-{self.samples}{oidn}{suffix}"

    def study_settings(self, folder: Path) -> dict[str, Any]:
        """Return the content of $SUPERSAMPLER_STUDY for blender_frames.py."""
        return {
            "script": str(Path(process.__file__).with_name("render_frames.py")),
            "costs": str((folder / "costs.jsonl").resolve()),
            "filter": None if self.small else ("BOX", 1.0),
            "prefilter": None if self.exact_guides else "ACCURATE",
            "jitter": self.small,
            "seed": 1000 if self.reference else 0,
            "region": REGIONS[self.scene] if self.reference else None,
            "noisy": self.denoise,
        }


def frame_sets() -> Iterator[FrameSet]:
    """Yield all sets, those first without which there is nothing to compare.

    The image before OIDN is a pass of the render with OIDN; renders without OIDN are for their cost alone.
    """
    yield from _references(COMPARED[0])
    for budget in (4, 1, 2, 8):
        for scene in sorted(REGIONS, key="courtyard shelf room".index):  # the dearest one comes last
            small = round(budget * SCALE**2)
            yield FrameSet(scene=scene, frames=FRAMES, samples=small, denoise=True, small=True)
            yield FrameSet(
                scene=scene, frames=FRAMES, samples=small, denoise=True, small=True, exact_guides=True
            )
            yield FrameSet(scene=scene, frames=(1, 2), samples=small, small=True)
            for number in COMPARED:
                yield FrameSet(scene=scene, frames=(number, number), samples=budget, denoise=True)
            yield FrameSet(scene=scene, frames=(1, 2), samples=budget)
    for number in COMPARED[1:]:
        yield from _references(number)


def _references(number: int) -> Iterator[FrameSet]:
    for scene in REGIONS:
        yield FrameSet(scene=scene, frames=(number, number), samples=REFERENCE, reference=True)


def main(
    work: Annotated[Path, typer.Argument(help="Folder of the renders.")],
    blender: Annotated[str, typer.Option(help="A Python that has bpy.")],
) -> None:
    """Render all that is not there yet."""
    process._SCRIPT = _HERE / "blender_frames.py"  # instead of the command's own script, which it calls
    work.mkdir(parents=True, exist_ok=True)
    for scene in REGIONS:
        if not (work / f"{scene}.blend").exists():
            words = [blender, str(_HERE / "blender_scenes.py"), scene, str(work / f"{scene}.blend")]
            size = "x".join(map(str, DISPLAY))
            subprocess.run([*words, size], check=True, capture_output=True)  # noqa: S603  # the user names it
    for frame_set in frame_sets():
        folder = work / frame_set.name
        folder.mkdir(exist_ok=True)
        os.environ["SUPERSAMPLER_STUDY"] = json.dumps(frame_set.study_settings(folder))
        request = RenderRequest(
            blend=work / f"{frame_set.scene}.blend",
            frames=frame_set.frames,
            display_size=DISPLAY,
            scale=SCALE if frame_set.small else 1.0,
            samples=frame_set.samples,
            denoise=frame_set.denoise,
            program=blender,
        )
        with rendering(request, folder / "frames", note=print) as render:
            render.shot.read(len(render.shot) - 1)  # waits for the last frame
        print(frame_set.name, flush=True)


if __name__ == "__main__":
    typer.run(main)
