"""Upscale a shot in seventy lines without supersampler, as an engine integration would.

    python examples/bare_onnxruntime.py [MODEL_FOLDER SHOT_FOLDER OUT_FOLDER]

The images equal those of `Upscaler`. Inputs are NCHW float32. The `next.*` outputs of a step are the
`history.*` inputs of the next step; zeros mean no history. See docs/contract.md.
"""

import json
import sys
from pathlib import Path

import numpy as np
import onnxruntime as ort
from OpenImageIO import ImageBuf

shipped = Path(__file__).resolve().parents[1] / "sdk" / "supersampler"
given = [Path(argument) for argument in sys.argv[1:]]
if len(given) not in (0, 3):
    sys.exit(__doc__)
model, shot, out = given or [shipped / "models" / "classifier", shipped / "shots" / "plaza", Path("out")]
for file in (model / "model.json", shot / "shot.json"):
    if not file.is_file():
        sys.exit(f"{file} is missing")
contract = json.loads((model / "model.json").read_text())
if contract["contract"] != 4:
    sys.exit(f"{model} has contract {contract['contract']}; want 4. Export the method again.")
description = json.loads((shot / "shot.json").read_text())
if description["conventions"]:
    sys.exit(f"{shot} has other conventions; convert it: supersampler import {shot} -o CONVERTED")
session = ort.InferenceSession(str(model / "step.onnx"), providers=["CPUExecutionProvider"])
(w, h), (display_w, display_h) = description["render_size"], description["display_size"]
large_w, large_h = (7 * display_w + 4) // 5, (7 * display_h + 4) // 5
sizes = {
    "display_height": display_h, "display_width": display_w, "previous_height": h, "previous_width": w,
    "half_height": (display_h + 1) // 2, "half_width": (display_w + 1) // 2,
    "large_height": large_h, "large_width": large_w,
    "large_half_height": (large_h + 1) // 2, "large_half_width": (large_w + 1) // 2,
    "previous_blocks_down": (h + 3) // 4, "previous_blocks_across": (w + 3) // 4,
    "previous_phases": 9 * display_w * display_h // (w * h) + 2,
}  # fmt: skip
unknown = {n for t in contract["history"] for n in t["shape"] if isinstance(n, str)} - set(sizes)
if unknown:
    sys.exit(f"{model} has sizes that this example does not know: {', '.join(sorted(unknown))}")
out.mkdir(parents=True, exist_ok=True)

history: dict[str, np.ndarray] = {}
for entry in description["frames"]:
    image = ImageBuf(str(shot / entry["file"]))
    pixels = np.asarray(image.get_pixels("float"))  # (h, w, channels)
    planes = dict(zip(image.spec().channelnames, pixels.transpose(2, 0, 1), strict=True))
    frame = {
        "color": np.stack([planes[c] for c in "RGB"])[None],  # (1, 3, h, w)
        "depth": planes["depth.Z"][None, None],  # (1, 1, h, w)
        "motion": np.stack([planes["motion.X"], planes["motion.Y"]])[None],  # (1, 2, h, w)
        "jitter": np.array([entry["jitter"]], np.float32),
        "exposure": np.array([entry.get("exposure") or 0.0], np.float32),  # 0: the graph measures it
        "reactive": planes.get("reactive.Y", np.zeros_like(planes["depth.Z"]))[None, None],  # (1, 1, h, w)
        "pre_exposure": np.array([entry.get("pre_exposure", 1.0)], np.float32),
        "adds_samples": np.ones(1, np.float32),  # 0 on unshaded frames, 2 with a path tracer
        "display_size": np.array([display_w, display_h]),
    }
    if entry.get("reset") or not history:
        history = {
            t["name"]: np.zeros([sizes.get(n, n) for n in t["shape"]], np.float32)
            for t in contract["history"]
        }
    wanted = {t["name"]: frame.get(t["name"]) for t in contract["inputs"]}
    if lacking := [name for name, array in wanted.items() if array is None]:
        sys.exit(f"{model} reads {', '.join(lacking)}, which this example does not pass")
    results = dict(
        zip([o.name for o in session.get_outputs()], session.run(None, {**wanted, **history}), strict=True)
    )
    history = {t["name"]: results[t["output"]] for t in contract["history"]}
    np.save(out / f"{Path(entry['file']).stem}.npy", results["image"][0].transpose(1, 2, 0))
print(f"{len(description['frames'])} images, (height, width, 3) float32, linear RGB: {out}")
