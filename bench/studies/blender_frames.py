"""Render frames for blender_renders.py inside Blender, as `supersampler blender` does; write their cost.

$SUPERSAMPLER_STUDY is JSON:
    "script": render_frames.py;
    "costs": file that gets a line of JSON per frame, with its number and the CPU seconds of its render;
    "filter": kind and width in pixels, null for the command's own;
    "prefilter": of OIDN's guides, null for the command's own;
    "jitter": whether there is any;
    "seed": added to the scene's;
    "region": part of the frame to render, [left, right, bottom, top] from 0 to 1, or null;
    "noisy": whether the image before OIDN is kept, too.
"""

import importlib.util
import json
import os
import time
from pathlib import Path
from typing import Any


def main(study: dict[str, Any]) -> None:
    """Render the frames of the command's settings, changed as `study` says."""
    spec = importlib.util.spec_from_file_location("render_frames", study["script"])
    assert spec is not None and spec.loader is not None  # noqa: S101, PT018  # for mypy
    script: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    set_output, render = script.set_output, script.render
    script.EXACT_FILTER = study["filter"] or script.EXACT_FILTER

    def set_more(scene: Any) -> None:
        set_output(scene)
        scene.cycles.denoising_prefilter = study["prefilter"] or scene.cycles.denoising_prefilter
        scene.cycles.seed += study["seed"]
        for layer in scene.view_layers:
            layer.cycles.denoising_store_passes = study["noisy"]
        if study["region"]:
            area = scene.render
            area.use_border, area.use_crop_to_border = True, False
            area.border_min_x, area.border_max_x, area.border_min_y, area.border_max_y = study["region"]

    def timed_render(scene: Any, path: Path) -> None:
        before = time.process_time()  # of all threads
        render(scene, path)
        cost = {"frame": scene.frame_current, "seconds": time.process_time() - before}
        with Path(study["costs"]).open("a", encoding="utf-8") as file:
            file.write(f"{json.dumps(cost)}\n")

    script.set_output, script.render = set_more, timed_render
    settings = script.SETTINGS
    script.main(settings if study["jitter"] else {**settings, "jitter": [[0.0, 0.0]]})


if __name__ == "__main__":
    main(json.loads(os.environ["SUPERSAMPLER_STUDY"]))
