"""Fuzz test of the host in C: libFuzzer changes upscaler.json and frames.json; the host loads and steps."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from c_host import fuzzer_or_skip
from fuzzing import examples
from supersampler_export.shaders.folder import write_shader_folder

METHODS = ["taa", "taau", "classifier-small"]
FRAMES = [
    {
        "jitter": [0.125, -0.25],
        "exposure": exposure,
        "pre_exposure": 1.0,
        "reset": exposure is None,
        "size": size,
        **{name: f"0.{name}" for name in ("color", "depth", "motion")},
    }
    for exposure, size in ((None, [4, 3]), (1.5, [5, 4]), (None, [5, 4]))
]
LONGEST = 1 << 16
"""Bytes of an input."""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fuzzer_or_skip(tmp_path_factory.mktemp("fuzzer"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files of some methods, a dictionary, and seeds, most of one pass."""
    root = tmp_path_factory.mktemp("folder")
    (root / "seeds").mkdir()
    words: set[str] = set()
    frames = json.dumps({"display": [8, 6], "frames": FRAMES})
    for method in METHODS:
        write_shader_folder(method, root / method)
        about = json.loads((root / method / "upscaler.json").read_text())
        seeds = {method: about, **{f"{method}-{one['name']}": _only(about, one) for one in about["passes"]}}
        for name, content in seeds.items():
            (root / "seeds" / name).write_text(f"{json.dumps(content)}\0{frames}")
        words |= {word for word in _texts(about) if word.isascii() and len(word) < 32}
        shutil.copytree(root / method, root, dirs_exist_ok=True)
    quoted = (word.replace("\\", "\\\\").replace('"', '\\"') for word in sorted(words))
    (root / "words").write_text("".join(f'"\\"{word}\\""\n' for word in quoted))
    return root


def _only(about: dict[str, Any], one: dict[str, Any]) -> dict[str, Any]:
    """Return what the host reads for one pass: a change of it meets a check more often."""
    used = {"params", *(binding["resource"] for binding in one["bindings"])}
    resources = [resource for resource in about["resources"] if resource["name"] in used]
    kept = {name: about[name] for name in ("format", "version", "target", "images")}
    pairs = [pair for pair in about["history"]["pairs"] if used & set(pair)]
    return {
        **kept,
        "params": {"resource": "params"},
        "history": {"pairs": pairs},
        "resources": resources,
        "passes": [one],
    }


def _texts(value: Any) -> Iterator[str]:
    """Yield all keys and texts of a JSON value."""
    if isinstance(value, str):
        yield value
    for inner in value if isinstance(value, dict | list) else ():
        yield from _texts(inner)
        if isinstance(value, dict):
            yield from _texts(value[inner])


def fuzz(program: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    limits = [f"-max_len={LONGEST}", "-rss_limit_mb=1024", "-timeout=10"]
    small = ["/bin/sh", "-c", '"$@"; exit $?', "sh"]  # a child's peak is at least what its parent took
    return subprocess.run(
        [*small, program, *limits, *arguments],
        check=False,
        capture_output=True,
        text=True,
        errors="replace",
        cwd=folder,
        env={**os.environ, "ASAN_OPTIONS": "detect_leaks=0"},
    )


def test_the_fuzz_target_steps_every_seed(program: Path, folder: Path) -> None:
    seeds = [str(seed) for seed in (folder / "seeds").iterdir()]
    assert len(seeds) > len(METHODS)
    done = fuzz(program, folder, "-runs=1", *seeds)
    assert done.returncode == 0, done.stderr
    assert "error:" not in done.stderr


def test_no_folder_harms_the_host_in_c(program: Path, folder: Path, tmp_path: Path) -> None:
    runs = ["-seed=1", f"-runs={400 * examples()}", "-close_fd_mask=2", "-mutate_depth=2"]
    places = ["-dict=words", f"-artifact_prefix={tmp_path}/", tmp_path, "seeds"]
    done = fuzz(program, folder, *runs, *map(str, places))
    assert done.returncode == 0, done.stderr[-8000:]
