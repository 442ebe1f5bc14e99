"""Serve files to browsers on this machine alone."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import PurePosixPath
from threading import Thread
from typing import Any
from urllib.parse import unquote, urlsplit

from supersampler.errors import ArgumentError, ShotError
from supersampler.integrations.web.site import SiteFiles

HOST = "127.0.0.1"
TYPES: Mapping[str, str] = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".wgsl": "text/plain; charset=utf-8",
    ".wasm": "application/wasm",
}
"""Types of files, which Python would take from the system, where they may be wrong."""
_SECONDS = 30.0  # that a browser may let a request or an answer wait


class _Server(ThreadingHTTPServer):
    """Answers from a mapping: no path of a request ever reaches the file system."""

    def __init__(self, port: int, files: SiteFiles) -> None:
        self.files = files
        super().__init__((HOST, port), _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing: a browser left, or sent what is no request."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _SECONDS

    def do_GET(self) -> None:  # the base class's name
        """Answer with a file."""
        self._answer(with_content=True)

    def do_HEAD(self) -> None:  # the base class's name
        """Answer with the header of a file's answer."""
        self._answer(with_content=False)

    def _answer(self, *, with_content: bool) -> None:
        if not self._is_for_us():
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
            return
        path = unquote(urlsplit(self.path).path)
        name = f"{path}index.html" if path.endswith("/") else path
        content = self.server.files.get(name.removeprefix("/"))
        if content is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        try:
            data = content()
        except ShotError:
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR)
            return
        self.send_response(HTTPStatus.OK)
        suffix = PurePosixPath(name).suffix
        self.send_header("Content-Type", TYPES.get(suffix, "application/octet-stream"))
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-cache")  # the next run may serve others
        self.end_headers()
        if with_content:
            with suppress(OSError):  # a browser that leaves or reloads a page stops reading
                self.wfile.write(data)

    def _is_for_us(self) -> bool:
        """Return whether the request names this server.

        A page of another site can make its own name lead to 127.0.0.1. Its requests have that name here, and
        browsers would let it read the answers.
        """
        port = self.server.server_port
        return self.headers.get("Host", f"{HOST}:{port}") in {f"{HOST}:{port}", f"localhost:{port}"}

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  # the base class's name
        """Print nothing."""


@contextmanager
def serving(files: SiteFiles, port: int = 0) -> Iterator[str]:
    """Serve files on 127.0.0.1 during the block, by threads; yields the URL.

    Args:
        files: as `site_files` returns them.
        port: to listen on; 0 takes a free one.

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
        thread.join(_SECONDS)
