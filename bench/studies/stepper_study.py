"""What studies share that measure ways of stepping on shots with references."""

from collections.abc import Callable, Sequence
from pathlib import Path

from supersampler.io.shot import Shot
from supersampler_bench.cli.options import check_page, counted, opened_shots, publish
from supersampler_bench.quality.measure import Stepper, measure_steppers
from supersampler_bench.quality.score_record import quality_record, scores_row, shot_record
from supersampler_bench.quality.score_table import markdown_table as score_table
from supersampler_bench.quality.score_table import tables_of
from supersampler_bench.record import Record


def markdown_table(record: Record) -> str:
    """Return the tables of a record as Markdown: of the mean at each ratio, or of the only shot."""
    return "\n\n".join(score_table(title, rows) for title, rows in tables_of(record))


def run_study(
    study: str,
    steppers: Callable[[Shot], Sequence[Stepper]],
    shot: str,
    ratio: str,
    cache: Path | None,
    json: Path | None,
    update: Path | None,
    table: Callable[[Record], str] = markdown_table,
) -> None:
    """Measure steppers, publish their record and its tables.

    Args:
        study: its name, in the record and in the block of the page.
        steppers: returns them for a shot, with empty histories.
        shot: with the following ones, options of `bench quality`.
        ratio: of the shots.
        cache: folder of the test shots.
        json: file of the record.
        update: page with the table.
        table: renders the record as Markdown.
    """
    name, opened = opened_shots(shot, cache, ratio)
    tables = {f"study {study} {name}": table}
    check_page(update, tables)
    measured = []
    with counted("frames", sum(len(one) for one, _ in opened)) as advance:
        for one, origin in opened:
            scores = measure_steppers(one, steppers(one), on_frame=advance)
            rows = [scores_row(each) for each in scores]  # without frames, which are megabytes
            measured.append({**shot_record(one), **(origin or {}), "methods": rows})
    publish({**quality_record(measured), "bench": study}, tables, json, update)
