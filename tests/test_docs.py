"""Pages of the documentation run; their links, and the commands that they name, are there."""

import ast
import re
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.core import TyperGroup
from typer.main import get_command

import supersampler.methods
import supersampler_model.methods
from supersampler.cli import app
from supersampler.methods import registry
from supersampler.methods.model_file import find_model
from upscale_runs import run, succeeded

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md")])
GENERATED = {DOCS / f"{name}.md" for name in ("reference/api", "reference/cli", "contributing")}


@pytest.mark.long  # traces a graph
def test_the_page_on_adding_a_method_adds_a_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (DOCS / "how-to/add-a-method.md").read_text(encoding="utf-8")
    page = page.partition("## A step of your own")[
        2
    ]  # tests/process/test_add_a_method.py runs the first part
    files = re.findall(r"```python\n# (\S+)\n(.*?)```", page, re.DOTALL)
    assert [path for path, _ in files] == [
        "sdk/supersampler/methods/average/spec.py",
        "model/supersampler_model/methods/average.py",
        "tests/model/test_average.py",
    ]
    for path, text in files:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    (tmp_path / files[0][0]).with_name("__init__.py").write_text("")
    monkeypatch.chdir(tmp_path)
    registry.methods()
    monkeypatch.setattr(registry, "_registered", {**registry._registered})
    sdk, model = supersampler.methods, supersampler_model.methods
    monkeypatch.setattr(sdk, "__path__", [*sdk.__path__, "sdk/supersampler/methods"])
    monkeypatch.setattr(model, "__path__", [*model.__path__, "model/supersampler_model/methods"])
    try:
        aovs = find_model("bilinear") / "aovs.onnx"  # as in all folders
        monkeypatch.setattr("supersampler_export.folder.aovs_graph", aovs.read_bytes)
        succeeded(run("export", "average", "-o", "average"))
        promised: dict[str, object] = {}
        exec(files[2][1], promised)  # noqa: S102
        promised["test_each_frame_of_a_scene_at_rest_adds_one_sample"]()  # type: ignore[operator]
    finally:
        for name in [name for name in sys.modules if ".methods.average" in name]:
            del sys.modules[name]


def test_the_tutorial_of_an_engine_loop_runs() -> None:
    page = (DOCS / "tutorials/engine-loop.md").read_text(encoding="utf-8")
    size = (1080 * 2 // 3, 1920 * 2 // 3)  # what the tutorial's ratio of 1.5 gives
    found: dict[str, Any] = {
        "index": 0,
        "projection": np.eye(4),
        "color": np.full((*size, 3), 0.5, np.float32),
        "depth": np.full(size, 0.1, np.float32),
        "motion": np.zeros((*size, 2), np.float32),
        "camera_was_cut": True,
        "exposure": 1.0,
    }
    for snippet in re.findall("```python\n(.*?)```", page, re.DOTALL):
        exec(snippet, found)  # noqa: S102
    assert found["image"].shape == (1080, 1920, 3)


class EmptyScene:
    """An engine for README's loop, that draws a grey wall."""

    texture_mip_bias = 0.0

    def draw(self, _: Any, size: tuple[int, int]) -> tuple[Any, Any]:
        return np.full((size[1], size[0], 3), 0.5, np.float32), np.full((size[1], size[0]), 0.1, np.float32)

    def add_motion_of_objects(self, motion: Any) -> Any:
        np.testing.assert_allclose(motion[5:-5, 5:-5, 1], 0.0, atol=1e-3)
        return motion


def test_the_engine_loop_of_the_readme_runs() -> None:
    projection = np.array([[1.0, 0, 0, 0], [0, 16 / 9, 0, 0], [0, 0, 0, 0.1], [0, 0, -1.0, 0]])
    moved = np.eye(4)
    moved[0, 3] = 0.01
    cameras = [
        SimpleNamespace(projection=projection, view=view, is_cut=False, near=0.1)
        for view in (np.eye(4), moved)
    ]
    scene = EmptyScene()
    found: dict[str, Any] = {"scene": scene, "cameras": cameras}
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    snippet = next(s for s in re.findall("```python\n(.*?)```", page, re.DOTALL) if "upscaler.step" in s)
    exec(snippet, found)  # noqa: S102
    assert scene.texture_mip_bias == -1.0
    assert found["image"].shape == (1080, 1920, 3)
    np.testing.assert_allclose(found["image"][100:-100, 100:-100], 0.5, atol=1e-3)


def prose(page: Path) -> str:
    """Return the text of a page without its blocks of code."""
    return re.sub("```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)


def test_commands_and_options_of_records_are_there() -> None:
    for line in tomllib.loads((ROOT / "bench/records.toml").read_text(encoding="utf-8"))["commands"].values():
        assert_options_are_there(line)


def commands_of(page: Path) -> list[str]:
    """Return the commands of a page, of its blocks of shell lines and in its sentences."""
    text = page.read_text(encoding="utf-8")
    blocks = "\n".join(re.findall("```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ")
    lines = [line.split("#")[0].strip() for line in blocks.splitlines()]
    spans = [" ".join(span.split()) for span in re.findall("`([^`]+)`", prose(page))]
    return [one for one in (*lines, *spans) if re.match("supersampler [a-z]", one)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_and_options_that_a_page_names_are_there(page: Path) -> None:
    if page.name == "CHANGELOG.md":  # names of before, too
        return
    for line in commands_of(page):
        assert_options_are_there(line)


def assert_options_are_there(line: str) -> None:
    command: Any = get_command(app)
    words = line.split("|")[0].split()[1:]
    while isinstance(command, TyperGroup) and words and re.fullmatch("[a-z-]+", words[0]):
        context = command.context_class(command)
        assert words[0] in command.list_commands(context), line
        command = command.resolve_command(context, words[:1])[1]  # imports train, export, bench, render
        words.pop(0)
    options = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    for word in words:
        if re.match("--?[a-z]", word):
            assert word.split("=")[0].rstrip(",.") in options | {"--help"}, line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings_that_are_there(page: Path) -> None:
    for target, anchor in re.findall(r"\]\((?!https?://)([^)#\s]*)#?([^)\s]*)\)", prose(page)):
        file = (page.parent / target).resolve() if target else page
        assert file.exists(), f"{page.name}: {target}"
        if anchor and file.suffix == ".md":
            assert anchor in headings(file), f"{page.name}: {target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_source_files_that_a_page_names_are_there(page: Path) -> None:
    for name in re.findall(r"`(?:\.\.\./)?([\w/]+/\w+\.(?:py|js|mjs|c|wgsl|yaml))`", prose(page)):
        assert any(ROOT.glob(f"[!.]*/**/{name}")) or (ROOT / name).exists(), f"{page.name}: {name}"


def headings(page: Path) -> set[str]:
    titles = [line.lstrip("#").strip().lower() for line in prose(page).splitlines() if line.startswith("#")]
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title)) for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_in_pages_is_python(page: Path) -> None:
    for snippet in re.findall("```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        ast.parse(snippet)


def test_every_page_is_in_the_navigation() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    listed = {DOCS / path for path in re.findall(r": (\S+\.md)", navigation)}
    assert listed == {page for page in PAGES if page.is_relative_to(DOCS)} | GENERATED
