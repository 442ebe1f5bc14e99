"""The page on adding a method adds one with trained weights and all backends, in a copy of the repository."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = (
    "sdk/supersampler",
    "model/supersampler_model",
    "export/supersampler_export",
    "bench/supersampler_bench",
)
MAX_FILES = 8
STEPS = """
import torch
from supersampler_export.graph import example_arguments, traced_sizes
from supersampler_model.methods import load_method
method = load_method("classifier-tiny")
image = method(*example_arguments(method, *traced_sizes(method), traced_sizes(method)[1]))[0]
assert image.shape == (1, 3, 37, 52) and torch.isfinite(image).all()
"""


EXPORTS = "SUPERSAMPLER_TRACES" in os.environ
"""Whether the method is exported, in minutes, and its backends run: `make traces`."""


@pytest.mark.timeout(1500)
def test_a_method_from_existing_parts_touches_few_files_and_runs_everywhere(tmp_path: Path) -> None:
    page = (ROOT / "docs/how-to/add-a-method.md").read_text(encoding="utf-8")
    page = page.partition("## A step of your own")[0]
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    before = {path for path in tmp_path.rglob("*") if path.is_file()}
    for path, text in re.findall(r"```python\n# (\S+)\n(.*?)```", page, re.DOTALL):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    folders = os.pathsep.join(str(tmp_path / package.partition("/")[0]) for package in PACKAGES)
    environment = {**os.environ, "PYTHONPATH": folders, "PYTHONDONTWRITEBYTECODE": "1"}
    command = f"{sys.executable} -m supersampler"
    lines = "\n".join(re.findall("```sh\n(.*?)```", page, re.DOTALL))
    if not EXPORTS:
        lines = lines.replace("supersampler export", ": ")
    short = "--shot plaza --steps 2 --size 32 --batch 1 --frames 2"
    lines = lines.replace("--data data", short).replace("supersampler train", f"{command} train")
    lines = lines.replace("supersampler export", f"{command} export")
    subprocess.run(["/bin/sh", "-e", "-c", lines], cwd=tmp_path, env=environment, check=True)
    shutil.rmtree(tmp_path / "run")
    after = {path for path in tmp_path.rglob("*") if path.is_file()}
    made = {path for path in after - before if "__pycache__" not in path.parts}
    models = tmp_path / "sdk/supersampler/models"
    touched = {path.parent if path.is_relative_to(models) else path for path in made}  # a model is one folder
    assert 5 + EXPORTS <= len(touched) <= MAX_FILES - (not EXPORTS), sorted(touched)
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"] if EXPORTS else ["-c", STEPS]
    subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment, check=True)
