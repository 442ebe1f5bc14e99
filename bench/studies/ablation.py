"""Ablation: train variants of a method that differ in one choice each, briefly, and compare their scores.

The same command continues a stopped run:
    python bench/studies/ablation.py classifier --data data -o ablation --workers 2
"""

import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from json import loads
from pathlib import Path
from typing import Annotated, Any

import torch
import typer

from studies import ablation_classifier, ablation_gbuffer
from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import ERRORS, JSON, UPDATE, check_page, publish
from supersampler_bench.record import Record, write_json
from supersampler_model.data.dataset import open_dataset
from supersampler_model.training.task import Task
from supersampler_model.training.trainer import Plan, Trainer
from supersampler_model.training.validate import validate, validation_entries

BATCH, AVERAGE = 4, 100
CHANCE = "from another seed"  # suffix of the variant that shows how much of a difference is chance


@dataclass(frozen=True)
class Row:
    """One variant's scores on the validation sequences."""

    name: str
    psnr: float
    tpsnr: float


SUBJECTS: Mapping[str, Mapping[str, Callable[[], Task[Any]]]] = {
    "classifier": ablation_classifier.VARIANTS,
    "gbuffer-small-4x": ablation_gbuffer.VARIANTS,
}
"""Variants by the method that they are of; the first is what the others differ from in one thing."""


@dataclass(frozen=True)
class Ablation:
    """What is run.

    Attributes:
        method: of SUBJECTS.
        data: training sets.
        folder: of the runs, numbered as the method's variants; existing runs are continued.
        steps: updates of each.
        workers: runs at a time, a thread each.
    """

    method: str
    data: Sequence[Path]
    folder: Path
    steps: int
    workers: int = 1

    @property
    def variants(self) -> Mapping[str, Callable[[], Task[Any]]]:
        """Of the method."""
        return SUBJECTS[self.method]


def run_ablation(ablation: Ablation, on_row: Callable[[Row], None]) -> list[Row]:
    """Train and validate all variants, in their order."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(ablation.workers, context) as pool:
        futures = [pool.submit(run_variant, ablation, name) for name in ablation.variants]
        for future in as_completed(futures):
            on_row(future.result())
        return [future.result() for future in futures]


def ablation_record(rows: Sequence[Row], ablation: Ablation) -> dict[str, Any]:
    """Return everything, ready for JSON."""
    plan = {"method": ablation.method, "steps": ablation.steps, "batch": BATCH}
    return {"bench": "ablation", **plan, "rows": [vars(row) for row in rows]}


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    rows = [Row(**row) for row in record["rows"]]
    base = rows[0].psnr
    seeds = "All from one seed."
    if rows[-1].name.endswith(CHANCE):
        seeds = "All but the last from one seed; the last says how much is chance."
    lines = [
        "| variant | PSNR dB | against the first | tPSNR dB |",
        "| --- | ---: | ---: | ---: |",
        *(f"| {r.name} | {r.psnr:.2f} | {r.psnr - base:+.2f} | {r.tpsnr:.2f} |" for r in rows),
        "",
        f"Each trained for {record['steps']} updates of {record['batch']} crops, far from the end: what is "
        f"compared is how fast it learns. {seeds} Mean over the validation sequences.",
    ]
    return "\n".join(lines)


def run_variant(ablation: Ablation, name: str) -> Row:
    """Train and validate one variant, or continue the run in its folder.

    Raises:
        ArgumentError: the folder has the run of another variant, from before their list was changed.
    """
    torch.set_num_threads(1)
    seed = int(name.endswith(CHANCE))
    torch.manual_seed(seed)
    folder = ablation.folder / f"{list(ablation.variants).index(name):02d}"
    folder.mkdir(parents=True, exist_ok=True)
    scored = folder / f"scored-{ablation.steps}.json"
    if (known := _known(scored, name)) is not None:
        return known
    datasets = [open_dataset(path) for path in ablation.data]
    task = ablation.variants[name]()
    plan = Plan(steps=ablation.steps, batch=BATCH, average=AVERAGE, seed=seed)
    trainer = Trainer(task, datasets, plan, folder)
    while trainer.done < ablation.steps:
        trainer.run(trainer.done + 200)
        trainer.save()
    found = validate(trainer.average.eval(), validation_entries(trainer.datasets, task.method.ratios))
    row = Row(name, found.psnr, found.tpsnr)
    write_json(vars(row), scored)
    return row


def _known(scored: Path, name: str) -> Row | None:
    """Return the scores in a folder if they are of this variant: folder numbers change with the list."""
    if not scored.exists():
        return None
    known = loads(scored.read_text(encoding="utf-8"))
    return Row(**known) if known.get("name") == name else None


def main(
    method: Annotated[str, typer.Argument(metavar="METHOD", help="classifier or gbuffer-small-4x.")],
    data: Annotated[list[Path], typer.Option(help="Training set with validation sequences; any number.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the runs.")],
    steps: Annotated[int, typer.Option(min=1, help="Updates of each run.")] = 800,
    workers: Annotated[int, typer.Option(min=1, help="Runs at a time, a thread each.")] = 1,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Train METHOD with one choice changed at a time, briefly, and compare on validation sequences."""
    if method not in SUBJECTS:
        raise ArgumentError("METHOD", got=method, want=f"one of {', '.join(SUBJECTS)}")
    tables = {f"study ablation {method}": markdown_table}
    check_page(update, tables)
    plan = Ablation(method, data=data, folder=output, steps=steps, workers=workers)
    rows = run_ablation(plan, lambda r: ERRORS.print(f"{r.name}: {r.psnr:.2f} dB, tPSNR {r.tpsnr:.2f} dB"))
    publish(ablation_record(rows, plan), tables, json, update)


if __name__ == "__main__":
    typer.run(main)
