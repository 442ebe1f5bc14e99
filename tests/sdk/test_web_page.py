"""The page that upscales in a browser, as a folder; test_web_page_in_chromium.py opens it in a browser."""

import base64
import json
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest

from supersampler.errors import ArgumentError, ModelError, ShotError
from supersampler.integrations.web import THREE_VERSION, page_files, serving, site_files, write_site
from supersampler.methods.executors import with_shaders
from supersampler_export.shaders.folder import shader_files
from upscale_runs import run, succeeded
from web_page import FolderFiles

BUDGET = 3_000_000
"""Bytes of all that the page loads, with all methods, without the shot and the fallback without WebGPU."""
APART = ("shot", "vendor", "cpu")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("web") / "site"
    succeeded(run("demo", "--web", "--write", folder))
    return folder


@pytest.fixture(scope="module")
def url(site: Path) -> Iterator[str]:
    with serving(FolderFiles(site)) as root:
        yield root


FEW: dict[str, Callable[[], bytes]] = {"index.html": lambda: b"<p>", "main.js": lambda: b"1"}


def no_shaders(_: str) -> dict[str, bytes]:
    return {}


def own_files(site: Path) -> list[Path]:
    return [
        path for path in site.rglob("*") if path.is_file() and path.relative_to(site).parts[0] not in APART
    ]


def test_the_page_loads_less_than_three_megabytes(site: Path) -> None:
    assert {path.stem for path in (site / "models").glob("*.js")} >= {*with_shaders(gbuffers=False)}
    assert sum(path.stat().st_size for path in own_files(site)) < BUDGET


def test_the_page_offers_every_method_with_shaders(site: Path) -> None:
    page = (site / "index.html").read_text("utf-8")
    select = page.partition('<select name="method">')[2].partition("</select>")[0]
    assert sorted(re.findall("<option>([^<]+)</option>", select)) == sorted(with_shaders(gbuffers=False))
    assert select.startswith("<option>classifier</option>")


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
            if target.startswith(("three/", "supersampler/", "data:")):
                continue
            assert not target.startswith("/"), f"{source.name} names {target}: no sub-path would have it"
            path = (source.parent / target.partition("?")[0]).resolve()
            assert path.is_relative_to(site.resolve()), f"{source.name} names {target}"
            optional = "vendor" in path.parts or path.suffix == ".wasm"  # what `pip install .` does not build
            assert path.exists() or optional, f"{source.name} names {target}, which is missing"
            count += 1
    assert count > 30


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("index.html", "text/html; charset=utf-8"), ("main.js", "text/javascript; charset=utf-8"),
        ("style.css", "text/css; charset=utf-8"), ("scene/scene.wgsl", "text/plain; charset=utf-8"),
        ("models/classifier.js", "text/javascript; charset=utf-8"), ("shot/shot.json", "application/json"),
    ],
)  # fmt: skip
def test_files_are_served_with_the_types_that_browsers_demand(url: str, name: str, kind: str) -> None:
    with urlopen(url + name) as answer:  # noqa: S310  # of this test's own server
        assert answer.headers["Content-Type"] == kind


def test_a_browser_that_stops_reading_leaves_no_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    with serving({"large.exr": lambda: bytes(32 << 20)}) as root:  # more than sockets hold
        with socket.create_connection(("127.0.0.1", urlsplit(root).port or 0)) as browser:
            browser.sendall(b"GET /large.exr HTTP/1.0\r\n\r\n")
            browser.recv(1)
        with urlopen(f"{root}large.exr") as answer:  # noqa: S310
            assert len(answer.read()) == 32 << 20
    assert capfd.readouterr().err == ""


def answer_to(url: str, request: bytes) -> bytes:
    """The first line of the answer to a request."""
    with socket.create_connection(("127.0.0.1", urlsplit(url).port or 0), timeout=20) as browser:
        browser.sendall(request)
        return browser.makefile("rb").readline()


@pytest.mark.parametrize(
    "path",
    ["/%2e%2e/secret", "/../secret", "//etc/passwd", "/a%00", "/%ff", "/\xff", "http://x/y", "/models", "*"],
)
def test_other_paths_are_answered_with_404(url: str, path: str) -> None:
    assert b" 404 " in answer_to(url, f"GET {path} HTTP/1.0\r\n\r\n".encode("latin-1"))


@pytest.mark.parametrize(
    "error", [ShotError("a.exr", "is damaged"), ModelError("model.json is damaged"), MemoryError()]
)
def test_a_file_that_cannot_be_made_is_answered_with_500(error: Exception) -> None:
    def refuse() -> bytes:
        raise error

    with serving({"a": refuse}) as root:
        assert b" 500 " in answer_to(root, b"GET /a HTTP/1.0\r\n\r\n")


def test_a_damaged_url_is_answered_with_400(url: str) -> None:
    assert b" 400 " in answer_to(url, b"GET http://[ HTTP/1.0\r\n\r\n")


@pytest.mark.parametrize("request_", [b"\r\n\r\n", b"\0\r\n\r\n", b"GET\r\n\r\n", b"PUT / HTTP/1.1\r\n\r\n"])
def test_malformed_requests_are_harmless(
    url: str, request_: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    assert b" 200 " not in answer_to(url, request_)
    assert b" 200 " in answer_to(url, b"GET / HTTP/1.0\r\n\r\n")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("host", "code"),
    [("127.0.0.1:{}", 200), ("localhost:{}", 200), ("evil.example", 421), ("evil.example:{}", 421)],
)
def test_a_request_under_a_foreign_host_name_is_refused(url: str, host: str, code: int) -> None:
    host = host.format(urlsplit(url).port)
    request = f"GET /index.html HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
    assert f" {code} ".encode() in answer_to(url, request.encode())


def test_a_port_in_use_is_one_line(url: str) -> None:
    port = int(url.rstrip("/").rpartition(":")[2])
    with pytest.raises(ArgumentError, match=f"^port is {port} .*; want a free port"), serving(FEW, port):
        pass


def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path) -> None:
    write_site(tmp_path, FEW)
    (tmp_path / "index.html").write_text("my home page")
    for folder in (tmp_path, tmp_path / "index.html"):
        with pytest.raises(ShotError, match="exists and is not an empty folder"):
            write_site(folder, {**FEW, "new.js": bytes})
    assert (tmp_path / "index.html").read_text() == "my home page"
    assert not (tmp_path / "new.js").exists()


def test_packages_of_npm_are_copied_if_they_are_of_the_tested_version(tmp_path: Path) -> None:
    three = tmp_path / "three"
    (three / "build").mkdir(parents=True)
    (three / "build/three.webgpu.js").write_text("")
    (three / "package.json").write_text(json.dumps({"version": THREE_VERSION}))
    files = site_files(no_shaders, node_modules=tmp_path)
    assert files["vendor/three/build/three.webgpu.js"]() == b""

    (three / "package.json").write_text(json.dumps({"version": "0.1.0"}))
    with pytest.raises(ShotError, match=r"package\.json: "):
        site_files(no_shaders, node_modules=three)
    with pytest.raises(ShotError, match=rf"is version 0\.1\.0; .* npm install three@{THREE_VERSION}"):
        site_files(no_shaders, node_modules=tmp_path)


def test_the_npm_package_has_its_listed_files_and_a_module_for_each_method(tmp_path: Path) -> None:
    folder = tmp_path / "package"
    succeeded(run("export", "all", "--target", "npm", "-o", folder))
    package = json.loads((folder / "package.json").read_text("utf-8"))
    for name in (*package["files"], "LICENSE", "NOTICE"):
        assert (folder / name).exists(), name
    assert "NOTICE" in package["files"], "npm packs LICENSE unasked, but not NOTICE"
    index = (folder / "models/index.js").read_text("utf-8")
    assert re.findall(r'import\("\./([^"]+)\.js"\)', index) == list(with_shaders(gbuffers=False))
    model = (folder / "models/taau.js").read_text("utf-8")
    for name, data in shader_files("taau").items():
        is_text = name.endswith((".wgsl", ".json"))
        assert (json.dumps(data.decode()) if is_text else base64.b64encode(data).decode()) in model, name


def test_another_version_of_three_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "node_modules/three").mkdir(parents=True)
    (tmp_path / "node_modules/three/package.json").write_text('{"version": "0.1.0"}')
    monkeypatch.chdir(tmp_path)
    assert run("demo", "--web", "--write", "site", "--node-modules", "node_modules").exit_code == 1
    done = succeeded(run("demo", "--web", "--write", "site"))
    assert f"npm install three@{THREE_VERSION}" in done.stderr
    assert not Path("site/vendor").exists()


def test_the_wheel_has_the_files_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = (Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8")
    assert '"examples/web" = "supersampler/integrations/web_page"' in project
    module = tmp_path / "supersampler/integrations/web.py"
    shutil.copytree(page_files(), module.parent / "web_page")
    for name in ("LICENSE", "NOTICE"):
        assert f'"{name}" = "supersampler/integrations/web_page/{name}"' in project
        shutil.copy(Path(__file__).parents[2] / name, module.parent / "web_page")
    monkeypatch.setattr("supersampler.integrations.web.__file__", str(module))
    assert page_files() == module.parent / "web_page"
    assert site_files(no_shaders)["NOTICE"]().startswith(b"supersampler\n")


def test_options_of_the_page_without_web_are_refused(tmp_path: Path) -> None:
    done = run("demo", "--write", tmp_path / "x")
    assert done.exit_code == 2
    assert "--port, --write and --node-modules need --web" in done.stderr
    assert not list(tmp_path.iterdir())
