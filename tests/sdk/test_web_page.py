"""The page that upscales in a browser, as a folder; tests/integrations/test_web.py runs it in one."""

import json
import re
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import urlopen

import numpy as np
import pytest
from typer.testing import CliRunner

from supersampler import Shot
from supersampler.cli import app
from supersampler.errors import ArgumentError, ShotError
from supersampler.integrations.web import PACKAGES, serving, write_site
from supersampler.integrations.web.site import METHODS, page_files
from supersampler.io.image_reading import read_exr

BUDGET = 3_000_000
"""Bytes of all that the page loads, with all methods, without the shot and the fallback without WebGPU."""
APART = ("shot", "vendor", "onnx")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("web") / "site"
    done = CliRunner().invoke(app, ["demo", "--web", "--write", str(folder)])
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope="module")
def url(site: Path) -> Iterator[str]:
    with serving(site) as root:
        yield root


def no_shaders(_: str, folder: Path) -> None:
    folder.mkdir(parents=True)


def own_files(site: Path) -> list[Path]:
    return [
        path for path in site.rglob("*") if path.is_file() and path.relative_to(site).parts[0] not in APART
    ]


def test_all_that_the_page_loads_is_less_than_three_megabytes(site: Path) -> None:
    files = own_files(site)
    assert {f"models/{method}/upscaler.json" for method in METHODS} <= {
        path.relative_to(site).as_posix() for path in files
    }
    assert sum(path.stat().st_size for path in files) < BUDGET


def test_every_file_that_a_module_or_page_names_is_there_and_below_the_root(site: Path) -> None:
    sources = [path for path in own_files(site) if path.suffix in {".js", ".html"}]
    named = re.compile(
        r"""(?:from |import\(|import |src=|href=)["']([^"'$]+)["']|new URL\("([^"$]+)", import\.meta"""
    )
    count = 0
    for source in sources:
        text = source.read_text("utf-8")
        assert not re.search(r"""["'(]https?://""", text), f"{source.name} loads from another host"
        for target in map("".join, named.findall(text)):
            if target.startswith(("three/", "data:")):
                continue
            assert not target.startswith("/"), f"{source.name} names {target}: no sub-path would have it"
            path = (source.parent / target.partition("?")[0]).resolve()
            assert path.is_relative_to(site.resolve()), f"{source.name} names {target}"
            assert path.exists() or "vendor" in path.parts, f"{source.name} names {target}, which is missing"
            count += 1
    assert count > 30


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("index.html", "text/html; charset=utf-8"),
        ("main.js", "text/javascript; charset=utf-8"),
        ("style.css", "text/css; charset=utf-8"),
        ("scene/scene.wgsl", "text/plain; charset=utf-8"),
        ("models/classifier/upscaler.json", "application/json"),
        ("models/classifier/network.bin", "application/octet-stream"),
    ],
)
def test_files_are_served_with_the_types_that_browsers_demand(url: str, name: str, kind: str) -> None:
    with urlopen(url + name) as answer:  # noqa: S310  # of this test's own server
        assert answer.headers["Content-Type"] == kind


def test_wasm_has_the_type_that_streaming_compilation_demands(tmp_path: Path) -> None:
    (tmp_path / "a.wasm").write_bytes(b"")
    with serving(tmp_path) as root, urlopen(f"{root}a.wasm") as answer:  # noqa: S310
        assert answer.headers["Content-Type"] == "application/wasm"


def test_a_browser_that_stops_reading_leaves_no_traceback(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "large.exr").write_bytes(bytes(32 << 20))  # more than sockets hold
    with serving(tmp_path) as root:
        with socket.create_connection(("127.0.0.1", urlsplit(root).port or 0)) as browser:
            browser.sendall(b"GET /large.exr HTTP/1.0\r\n\r\n")
            browser.recv(1)
        with urlopen(f"{root}large.exr") as answer:  # noqa: S310
            assert len(answer.read()) == 32 << 20
    assert capfd.readouterr().err == ""


def test_nothing_outside_of_the_folder_is_served(site: Path, url: str) -> None:
    (site.parent / "secret").write_text("x")
    with pytest.raises(HTTPError) as refused:
        urlopen(f"{url}%2e%2e/secret")  # noqa: S310
    assert refused.value.code == 404
    refused.value.close()


def test_a_port_in_use_is_one_line(url: str, tmp_path: Path) -> None:
    port = int(url.rstrip("/").rpartition(":")[2])
    with pytest.raises(ArgumentError, match=f"^port is {port} .*; want a free port"), serving(tmp_path, port):
        pass


def test_the_shot_of_the_page_is_the_shipped_one(site: Path) -> None:
    shot = Shot.open(site / "shot")
    shipped = Shot.open("plaza")
    assert len(shot) == len(shipped)
    here, there = shot.read(20), shipped.read(20)
    for name in ("color", "depth", "motion"):
        np.testing.assert_array_equal(getattr(here.frame, name), getattr(there.frame, name))
    assert here.frame.jitter == there.frame.jitter
    assert here.reference is not None
    assert there.reference is not None
    np.testing.assert_allclose(here.reference, there.reference, rtol=1e-3, atol=1e-6)
    assert list(read_exr(site / "shot/reference/0020.exr")) == ["R", "G", "B"]


def test_all_files_of_the_shot_are_packed_in_a_way_that_the_page_reads(site: Path) -> None:
    known = {0, 2, 3}  # none, ZIPS, ZIP, as page/exr.js has them
    for path in (site / "shot").rglob("*.exr"):
        header = path.read_bytes()[:2048]
        start = header.index(b"compression\0compression\0") + 24 + 4
        assert header[start] in known, path


def test_a_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(ShotError, match="holds files that are not of this page"):
        write_site(tmp_path, no_shaders)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_page_is_written_over_an_earlier_one(tmp_path: Path) -> None:
    write_site(tmp_path / "site", no_shaders)
    (tmp_path / "site" / "models" / "old.wgsl").write_text("")
    write_site(tmp_path / "site", no_shaders)
    assert not (tmp_path / "site" / "models" / "old.wgsl").exists()


def test_packages_of_npm_are_copied_if_they_are_of_the_tested_version(tmp_path: Path) -> None:
    three = tmp_path / "node_modules" / "three"
    (three / "build").mkdir(parents=True)
    for name in ("build/three.core.js", "build/three.webgpu.js", "build/three.tsl.js", "LICENSE"):
        (three / name).write_text("")
    (three / "package.json").write_text(json.dumps({"version": PACKAGES["three"]}))
    write_site(tmp_path / "site", no_shaders, node_modules=tmp_path / "node_modules")
    assert (tmp_path / "site/vendor/three/three.webgpu.js").is_file()
    assert not (tmp_path / "site/vendor/onnxruntime-web").exists()

    (three / "package.json").write_text(json.dumps({"version": "0.1.0"}))
    with pytest.raises(ShotError, match=rf"is version 0\.1\.0; .* npm install three@{PACKAGES['three']}"):
        write_site(tmp_path / "other", no_shaders, node_modules=tmp_path / "node_modules")
    assert not (tmp_path / "other").exists()


def test_the_wheel_has_the_files_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = (Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8")
    assert '"examples/web" = "supersampler/integrations/web/page"' in project
    module = tmp_path / "supersampler/integrations/web/site.py"
    shutil.copytree(page_files(), module.parent / "page")
    monkeypatch.setattr("supersampler.integrations.web.site.__file__", str(module))
    assert page_files() == module.parent / "page"


def test_options_of_the_page_without_web_are_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["demo", "--write", str(tmp_path / "x")])
    assert done.exit_code == 2
    assert "--port, --write and --node-modules need --web" in done.stderr
    assert not list(tmp_path.iterdir())
