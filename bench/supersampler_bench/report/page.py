"""One HTML page of all records: tables, figures, images. It needs no other file and no network."""

import base64
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from html import escape
from importlib.resources import files
from pathlib import Path

from markdown_it import MarkdownIt

from supersampler.errors import ArgumentError
from supersampler.io.compare import versions
from supersampler.io.files import replacing
from supersampler_bench.record import JsonRecord, machine_name
from supersampler_bench.report.doc_tables import blocks_of
from supersampler_bench.report.figures import draw_record

_CONTENT_GOES_HERE = "<!-- content -->"
_QUICK = '<span class="quick" title="few steps and frames: these numbers are rough">measured quickly</span>'


@dataclass(frozen=True)
class Section:
    """A part of the page: all records of one bench.

    Attributes:
        bench: of its records.
        title: heading of the section.
        about: what was measured, as Markdown.
    """

    bench: str
    title: str
    about: str


SECTIONS = (
    Section("quality", "Quality", "Images after the display transform, against references."),
    Section("pareto", "Time and error", "Settings that no other beats in both, and the presets."),
    Section("extrapolation", "Unshaded frames", "Extrapolated or warped, against references."),
    Section("latency", "Latency", "A step on the CPU, beside variance clipping (`taa`) in the same run."),
    Section("startup", "First-frame time", "From the start of a process, with cold and warm kernel cache."),
    Section("device", "Devices", "A step of ONNX Runtime or torch, with frame and image in device memory."),
    Section("device-gpu", "GPUs", "A step of the shaders and its passes, by timestamps of the device."),
    Section("still", "Still scenes", "Convergence before a fixed camera, and the time of a frame."),
    Section("skip", "At rest", "Time saved where nothing moves, and error."),
    Section("stress", "Stress", "Long runs and hostile input; figures out of bounds are bold."),
    Section("parity", "Parity", "Difference of both backends from torch, over long sequences."),
    Section("traffic", "Traffic", "Bytes, multiply-adds and operators of a step, counted by ONNX Runtime."),
    Section("cost", "Networks", "Multiply-adds and parameters, counted in the graphs."),
)
_OPENED = ("pareto", "latency", "still")
"""Benches whose first figure is shown unfolded."""
_COLUMNS = ("record", "date, UTC", "machine", "versions", "command")


def is_page(path: Path) -> bool:
    """Return whether a file is a page by `write_page`, judged by its first lines."""
    head = files("supersampler_bench.report").joinpath("report.html").read_bytes().partition(b"</title>")[0]
    try:
        with path.open("rb") as file:
            return file.read(len(head)) == head
    except OSError:
        return False


def write_page(path: Path, records: Mapping[str, JsonRecord], comparison: str) -> None:
    """Write the page, whole or not at all.

    Args:
        path: of the page.
        records: by the names of their files.
        comparison: HTML of `split_view`.

    Raises:
        ShotError: the page cannot be written.
    """
    parts = [
        _head(records),
        *_sections(records),
        _comparison(comparison),
        _machines(records),
        _foot(),
    ]
    template = files("supersampler_bench.report").joinpath("report.html").read_text("utf-8")
    with replacing(path) as partial:
        partial.write_text(
            template.replace(_CONTENT_GOES_HERE, "\n".join(parts)), encoding="utf-8", newline="\n"
        )


def _head(records: Mapping[str, JsonRecord]) -> str:
    known = {record["bench"] for record in records.values()}
    parts = [(s.bench, s.title) for s in SECTIONS if s.bench in known]
    links = [*parts, ("images", "Images"), ("machine", "Machine and versions")]
    items = "".join(f'<li><a href="#{anchor}">{escape(title)}</a></li>' for anchor, title in links)
    return "\n".join(
        [
            "<header><h1>supersampler: measured</h1>",
            "<p>Every number here is from a record that <code>supersampler bench</code> wrote. Bold numbers "
            "are the best of their column, or lead in time and error.</p>",
            f"</header><nav><ul>{items}</ul></nav><main>",
        ]
    )


def _machines(records: Mapping[str, JsonRecord]) -> str:
    rows = []
    for name, record in records.items():
        installed = ", ".join(f"{what} {version}" for what, version in record["versions"].items() if version)
        cells = (
            f"<td>{escape(name)}{_badge(record)}</td>",
            f"<td>{escape(record['date'][:16].replace('T', ' '))}</td>",
            f'<td class="wide">{escape(machine_name(record))}<br>{escape(record["machine"]["os"])}</td>',
            f'<td class="wide">{escape(installed)}</td>',
            f'<td class="wide"><code>{escape(" ".join(record["command"]))}</code></td>',
        )
        rows.append(f"<tr>{''.join(cells)}</tr>")
    heading = "".join(f"<th>{text}</th>" for text in _COLUMNS)
    body = f"<thead><tr>{heading}</tr></thead><tbody>{''.join(rows)}</tbody>"
    table = f'<div class="table whole"><table>{body}</table></div>'
    return f'<section id="machine"><h2>Machine and versions</h2>{table}</section>'


def _sections(records: Mapping[str, JsonRecord]) -> Iterator[str]:
    for section in SECTIONS:
        found = {name: record for name, record in records.items() if record["bench"] == section.bench}
        if found:
            yield f'<section id="{section.bench}"><h2>{escape(section.title)}</h2>{_html(section.about)}'
            for name, record in found.items():
                yield from _record_html(name, record)
            yield "</section>"


def _record_html(name: str, record: JsonRecord) -> Iterator[str]:
    yield f"<h3>{escape(name)}{_badge(record)}</h3>"
    yield f'<p class="facts">{escape(machine_name(record))}, {escape(record["date"][:10])}</p>'
    makers = [partial(_table, maker) for maker in blocks_of(name, record).values()]
    for make in (*makers, partial(_figures, record)):
        try:
            yield make()
        except ArgumentError as error:
            yield f'<p class="facts">{escape(str(error))}</p>'


def _table(maker: Callable[[], str]) -> str:
    return _html(maker())


def _figures(record: JsonRecord) -> str:
    with tempfile.TemporaryDirectory() as folder:
        opened = record["bench"] in _OPENED
        return "\n".join(
            _figure(title, path, opened=opened and number == 0)
            for number, (title, path) in enumerate(draw_record(record, Path(folder)))
        )


def _figure(title: str, path: Path, *, opened: bool = False) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    image = f'<img alt="{escape(title)}" src="data:image/png;base64,{data}">'
    return f"<details{' open' * opened}><summary>{escape(title)}</summary><figure>{image}</figure></details>"


def _comparison(view: str) -> str:
    return "\n".join(
        [
            '<section id="images"><h2>Images</h2>',
            "<p>The shipped shot, upscaled when this page was made: any two of its input, the reference and "
            "the methods, left and right of a line that can be dragged; the wheel zooms.</p>",
            f'<iframe title="Images side by side" srcdoc="{escape(view)}"></iframe>',
            "</section>",
        ]
    )


def _foot() -> str:
    return f"<footer>Made with {escape(versions())}.</footer></main>"


def _badge(record: JsonRecord) -> str:
    return _QUICK if record.get("quick") else ""


def _html(markdown: str) -> str:
    return str(_MARKDOWN.render(markdown))


def _markdown() -> MarkdownIt:
    """Return a parser for tables, paragraphs, lists and emphasis. HTML and links stay text."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table").disable(["link", "image", "autolink"])
    reader.add_render_rule("table_open", lambda *_: '<div class="table"><table>\n')
    reader.add_render_rule("table_close", lambda *_: "</table></div>\n")
    return reader


_MARKDOWN = _markdown()
