"""The package for npm, and the page that upscales in a browser: as a folder, or served on this machine.

All links of the page are relative, so any file host can serve it. The JavaScript is in examples/web; the
wheel has it in web_page/.
"""

import base64
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path, PurePosixPath
from threading import Thread
from typing import Any, TypeAlias
from urllib.parse import unquote, urlsplit

import msgspec
import numpy as np

from supersampler.backends.cpu import library
from supersampler.errors import ArgumentError, ShotError, SupersamplerError
from supersampler.io.files import is_there, os_errors_as_shot_error, write_bytes
from supersampler.io.images import encode_exr
from supersampler.io.json_files import read_typed
from supersampler.io.shot import Shot
from supersampler.methods.executors import with_shaders
from supersampler.methods.registry import methods

__all__ = ["THREE_VERSION", "package_files", "page_files", "serving", "site_files", "write_site"]

SHOT = "plaza"
THREE_VERSION = "0.187.0"
"""Version of npm's package three that the page of three.js is tested with."""
SiteFiles: TypeAlias = Mapping[str, Callable[[], bytes]]
"""Function that returns the content of each file, by the file's path in the page's folder, with "/"."""
_THREE_FILES = (
    *(f"build/three.{part}.js" for part in ("core", "webgpu", "tsl")),
    *(f"examples/jsm/tsl/display/{node}Node.js" for node in ("TAAU", "TRAA")),
    "examples/jsm/tsl/utils/TAAUtils.js",
    "LICENSE",
)
_WASM = Path(library.__file__).with_name("supersampler.wasm")
"""The CPU library for browsers: in wheels; in a checkout `python sdk/native/build.py wasm` builds it."""
HOST = "127.0.0.1"
TYPES: Mapping[str, str] = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".wgsl": "text/plain; charset=utf-8",
    ".wasm": "application/wasm",
}
"""Content types; those of `mimetypes` come from the system, where they may be wrong."""
_TIMEOUT = 30.0  # seconds for a request or an answer


def package_files(
    names: Sequence[str], shader_files: Callable[[str], Mapping[str, bytes]]
) -> dict[str, Callable[[], bytes]]:
    """Return the files of the npm package: its modules, and a module for each method.

    Args:
        names: methods with shaders, without G-buffers.
        shader_files: returns the shaders of a method by name: `supersampler_export.shaders.folder`.
    """
    page = page_files()
    listed = read_typed(page / "package.json", _Package).files
    found = {name: page / name for name in (*listed, "package.json") if (page / name).is_file()}
    files = {name: partial(_content, path) for name, path in (found | _licences()).items()}
    return {**files, **_models(names, shader_files)}


def site_files(
    shader_files: Callable[[str], Mapping[str, bytes]], *, node_modules: Path | None = None
) -> dict[str, Callable[[], bytes]]:
    """Return the files of the page: its own, shaders, the CPU library and the shipped shot.

    Args:
        shader_files: see `supersampler_export.shaders.folder`.
        node_modules: npm's folder with three; without it the page of three.js says what is missing.

    Raises:
        ShotError: three is missing there, damaged, or of another version.
    """
    page = page_files()
    found = {path.relative_to(page).as_posix(): path for path in page.rglob("*") if path.is_file()}
    found |= _licences()
    if node_modules is not None:
        found |= _three_files(node_modules / "three")
    if is_there(_WASM):
        found["cpu/supersampler.wasm"] = _WASM
    shot = Shot.open(SHOT)
    found |= {f"shot/{path.name}": path for path in sorted(shot.source.glob("*.*"))}
    files: dict[str, Callable[[], bytes]] = {name: partial(_content, path) for name, path in found.items()}
    files["index.html"] = partial(_with_methods, found["index.html"])
    for index in shot.reference_indices:
        files[f"shot/reference/{index:04d}.exr"] = cache(partial(_reference, shot, index))
    return {**files, **_models(with_shaders(gbuffers=False), shader_files)}


def write_site(folder: Path, files: SiteFiles) -> None:
    """Write the page as a folder, which must be new or empty.

    Raises:
        ShotError: the folder holds something; or the disk refuses.
    """
    if is_there(folder) and not (folder.is_dir() and next(folder.iterdir(), None) is None):
        raise ShotError(folder, "exists and is not an empty folder", "Choose another, or remove it.")
    for name, content in files.items():
        write_bytes(folder / name, content())


def page_files() -> Path:
    """Return the folder of the page's own files: next to this module, or in a checkout's examples/."""
    shipped = Path(__file__).parent / "web_page"
    return shipped if shipped.is_dir() else Path(__file__).parents[3] / "examples" / "web"


def _licences() -> dict[str, Path]:
    """Return LICENSE and NOTICE, which wheels have beside the page's files, and a checkout in its root."""
    page = page_files()
    folder = page if (page / "LICENSE").is_file() else page.parents[1]
    return {name: folder / name for name in ("LICENSE", "NOTICE")}


class _Package(msgspec.Struct):
    """The fields of npm's package.json that are read here."""

    version: str
    files: tuple[str, ...] = ()


def _models(
    names: Sequence[str], shader_files: Callable[[str], Mapping[str, bytes]]
) -> dict[str, Callable[[], bytes]]:
    """Return modules that hold the shaders of methods, and one that imports them by name.

    A bundler finds modules without being configured, unlike files that are fetched.
    """
    imports = "".join(f'  "{name}": () => import("./{name}.js"),\n' for name in names)
    files = {"models/index.js": partial(str.encode, f"export default {{\n{imports}}};\n")}
    return files | {f"models/{name}.js": cache(partial(_model, shader_files, name)) for name in names}


def _model(shader_files: Callable[[str], Mapping[str, bytes]], method: str) -> bytes:
    lines = [
        "const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));",
        "export default {",
    ]
    for name, data in shader_files(method).items():
        text = name.endswith((".wgsl", ".json"))
        value = json.dumps(data.decode()) if text else f'bytes("{base64.b64encode(data).decode()}")'
        lines.append(f'  "{name}": {value},')
    return "\n".join([*lines, "};", ""]).encode()


def _content(path: Path) -> bytes:
    with os_errors_as_shot_error(path):
        return path.read_bytes()


def _with_methods(page: Path) -> bytes:
    """Return the page with an option for each method that has shaders; methods with a network come first."""
    names = sorted(with_shaders(gbuffers=False), key=lambda name: not methods()[name].task)
    options = "".join(f"<option>{name}</option>" for name in names)
    return _content(page).replace(b"<!-- methods -->", options.encode())


def _reference(shot: Shot, index: int) -> bytes:
    """Return a reference as an EXR of half floats, in a compression that the page can read."""
    return encode_exr(np.asarray(shot.read_reference(index), np.float16))


def _three_files(package: Path) -> dict[str, Path]:
    """Return the files of three.js that its page loads, by their paths in the page's folder."""
    version = read_typed(package / "package.json", _Package).version
    if version != THREE_VERSION:
        hint = f"Install it: npm install three@{THREE_VERSION}"
        raise ShotError(package, f"is version {version}; the page is tested with {THREE_VERSION}", hint)
    return {f"vendor/three/{file}": package / file for file in _THREE_FILES}


@contextmanager
def serving(files: SiteFiles, port: int = 0) -> Iterator[str]:
    """Serve files on 127.0.0.1 during the block, in threads; yield the URL.

    Args:
        files: see `site_files`.
        port: port to listen on; 0 takes a free one.

    Raises:
        ArgumentError: the port is in use, or not allowed.
    """
    try:
        server = _Server(port, files)
    except OSError as error:
        got = f"{port} ({error.strerror})"
        raise ArgumentError("port", got=got, want="a free port", hint="0 takes any.") from error
    thread = Thread(target=server.serve_forever, name="serve-page", daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join(_TIMEOUT)


class _Server(ThreadingHTTPServer):
    """Answers from a mapping: the paths of requests never reach the file system."""

    def __init__(self, port: int, files: SiteFiles) -> None:
        self.files = files
        super().__init__((HOST, port), _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing: a browser has left, or has sent an invalid request."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _TIMEOUT

    def do_GET(self) -> None:
        """Answer a GET or HEAD request with a file."""
        # A page of another site can let its own name resolve to 127.0.0.1. Browsers would let it read the
        # answers, but its requests have that name as the host.
        address = f"{HOST}:{self.server.server_port}"
        if self.headers.get("Host", address) not in (address, f"localhost:{self.server.server_port}"):
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
            return
        try:
            path = unquote(urlsplit(self.path).path)
        except ValueError:  # of a damaged host, as in `GET http://[ HTTP/1.0`
            self.send_error(HTTPStatus.BAD_REQUEST)
            return
        name = f"{path}index.html" if path.endswith("/") else path
        content = self.server.files.get(name.removeprefix("/"))
        if content is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        try:
            data = content()
        except (SupersamplerError, MemoryError):
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR)
            return
        self.send_response(HTTPStatus.OK)
        suffix = PurePosixPath(name).suffix
        self.send_header("Content-Type", TYPES.get(suffix, "application/octet-stream"))
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-cache")  # the next run may serve other files
        self.end_headers()
        if self.command == "GET":
            with suppress(OSError):  # a browser that leaves or reloads a page stops reading
                self.wfile.write(data)

    do_HEAD = do_GET  # noqa: N815  # the base class's name

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  # the base class's name
        """Print nothing."""
