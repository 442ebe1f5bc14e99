"""Where returns of training end: validation scores over the updates of runs.

    python bench/studies/returns.py "classifier-paper=RUN/log.csv" "classifier, further=RUN2/log.csv" \
        --json bench/results/studies/returns.json --update docs/training.md

Each argument is a title and the log of a `supersampler train` run. All runs must have validated on the same
sequences: then the baseline in their logs is the same.
"""

import csv
from pathlib import Path
from typing import Annotated, Any

import typer

from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.record import Record

COLUMNS = ("psnr", "tpsnr")
BASELINE = "taau"


def run_of(title: str, log: Path) -> dict[str, Any]:
    """Return the title of a run, the scores of its validations by updates, and the baseline's PSNR."""
    with log.open() as file:
        rows = [{name: float(text) for name, text in row.items() if text} for row in csv.DictReader(file)]
    validated = [row for row in rows if "psnr" in row]
    if not validated:
        raise ArgumentError("log", got=f"{log} without validation", want="log.csv of a run that validated")
    baseline = validated[-1][f"psnr_{BASELINE}"]
    points = [
        {"updates": round(row["step"]), **{name: row[name] for name in COLUMNS}}
        for row in validated
        if row[f"psnr_{BASELINE}"] == baseline  # sets may have grown since
    ]
    return {"title": title, "points": points, "baseline": baseline}


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    rows = [
        [run["title"], point["updates"], *(figure(point[name], 2) for name in COLUMNS)]
        for run in record["runs"]
        for point in run["points"]
    ]
    heads = ["run", "updates:", "PSNR dB:", "tPSNR dB:"]
    caption = f"On the validation sequences, where {BASELINE} has {record['runs'][0]['baseline']:.2f} dB."
    return table(heads, rows, caption)


def main(
    runs: Annotated[list[str], typer.Argument(metavar="TITLE=LOG...", help="Titles and logs of runs.")],
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Collect the validations of runs."""
    tables = {"study returns": markdown_table}
    check_page(update, tables)
    found = [run_of(title, Path(log)) for title, _, log in (text.rpartition("=") for text in runs)]
    if len({run["baseline"] for run in found}) > 1:
        raise ArgumentError("runs", got="baselines that differ", want="runs validated on the same sequences")
    publish({"bench": "returns", "runs": found}, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
