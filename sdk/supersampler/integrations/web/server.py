"""Serve a folder on this machine alone."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from supersampler.errors import ArgumentError

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


class _Handler(SimpleHTTPRequestHandler):
    extensions_map = {**SimpleHTTPRequestHandler.extensions_map, **TYPES}  # noqa: RUF012  # the base class's name

    def end_headers(self) -> None:
        """Let browsers ask again for each file: the next run writes others."""
        self.send_header("Cache-Control", "no-cache")
        super().end_headers()

    def copyfile(self, source: Any, outputfile: Any) -> None:
        """Send a file; a browser that leaves or reloads a page stops reading."""
        with suppress(ConnectionError):
            super().copyfile(source, outputfile)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  # the base class's name
        """Print nothing."""


@contextmanager
def serving(folder: Path, port: int = 0) -> Iterator[str]:
    """Serve the files of a folder on 127.0.0.1 during the block, by threads; yields the URL.

    Args:
        folder: the root.
        port: to listen on; 0 takes a free one.

    Raises:
        ArgumentError: the port is in use, or not allowed.
    """
    try:
        server = ThreadingHTTPServer((HOST, port), partial(_Handler, directory=str(folder)))
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
        thread.join()
