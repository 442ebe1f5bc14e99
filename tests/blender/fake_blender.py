"""Acts as Blender for tests: it "renders" recorded frames, as the scene's file says.

    SUPERSAMPLER_RENDER='{...}' fake_blender.py --background --python-exit-code 1 --python SCRIPT

plan.json beside the scene's file says what goes wrong: "error" or "crash" before the first frame; "error at",
"crash at" or "hang at" a frame's number; "wait at" a number "for" a file. "prints" is text before the first
frame, "ours" lines that begin with the token, "note" a note; "stubborn" ignores SIGTERM; "daughter" is how
long a program that it starts holds its output open. "scene" changes its description. It prints "Fra:7" for
each frame, as Blender does. Told to composite, it copies; "composite error at" stops it at a frame.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

SETTINGS = json.loads(os.environ["SUPERSAMPLER_RENDER"])
RECORDED = Path(__file__).with_name("recorded")


def report(**content: object) -> None:
    print(f"\n{SETTINGS['token']}{json.dumps(content)}", flush=True)


def stop(error: str) -> None:
    report(error=error)
    time.sleep(600)  # as bpy hangs at its end, where the scene has Python drivers


def main() -> None:
    settings = SETTINGS
    if "results" in settings:
        composite(settings)
        return
    record = json.loads((RECORDED / "render.json").read_text())
    plan = json.loads(Path(settings["blend"]).with_name("plan.json").read_text())
    print("Blender 4.5.15 LTS", flush=True)
    Path(settings["blend"]).with_name("pid").write_text(str(os.getpid()))
    if "stubborn" in plan:
        for name in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(name, signal.SIG_IGN)
    if "daughter" in plan:
        subprocess.Popen(["/bin/sh", "-c", f"trap '' TERM; exec sleep {plan['daughter']}"])
    sys.stdout.write(plan.get("prints", ""))
    sys.stdout.flush()
    for line in plan.get("ours", []):
        print(f"\n{SETTINGS['token']}{line}", flush=True)
    if "error" in plan:
        stop(plan["error"])
    if "crash" in plan:
        print("Writing: /tmp/scene.crash.txt", flush=True)
        os.abort()
    report(note=plan.get("note", "motion blur is off: blurred frames cannot be reprojected"))
    report(scene=record["scene"] | plan.get("scene", {}))
    first, last = settings["frames"] or record["scene"]["numbers"]
    for number in range(first + settings["complete"], last + 1):
        if number == plan.get("error at"):
            stop("Error: out of memory")
        if number == plan.get("crash at"):
            os.abort()
        if number == plan.get("hang at"):
            time.sleep(600)
        if number == plan.get("wait at"):
            wait_for(Path(plan["for"]))
        print(f"Fra:{number} Mem:15.68M", flush=True)
        part = Path(settings["folder"]) / f".{number:04d}.{settings['run']}.partial.exr"
        shutil.copyfile(RECORDED / f"{number:04d}.exr", part)
        report(frame=number, **record["frames"][number - record["first"]])


def composite(settings: dict[str, Any]) -> None:
    """Copy the results, as if no node changed them."""
    plan = json.loads(Path(settings["blend"]).with_name("plan.json").read_text())
    report(note="the output is FFMPEG: PNG images are written instead")
    for number in range(settings["first"], settings["last"] + 1):
        if number == plan.get("composite error at"):
            stop("node 'Render Layers' reads view layer 'B', but 'A' was rendered")
        part = Path(settings["folder"]) / f".{number:04d}.{settings['run']}.partial.png"
        shutil.copyfile(Path(settings["results"]) / f"{number:04d}.exr", part)
        report(frame=number, extension=".png")


def wait_for(path: Path) -> None:
    until = time.monotonic() + 200
    while not path.exists():
        if time.monotonic() > until:
            stop(f"{path.name} never came")
        time.sleep(0.01)


main()
