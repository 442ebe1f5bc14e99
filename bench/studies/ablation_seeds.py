"""What the class loss and the classes of the previous frame give: variants trained from several seeds each.

The same command continues a stopped run:
    python bench/studies/ablation_seeds.py --data data -o seeds --workers 2 \
        --json bench/results/studies/ablation-seeds.json --update docs/results/methods.md
"""

import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from json import loads
from pathlib import Path
from statistics import mean
from typing import Annotated, Any

import torch
import typer

from supersampler.methods.classifier.spec import SmallConfig
from supersampler_bench.cli.options import ERRORS, JSON, UPDATE, check_page, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.record import Record, write_json
from supersampler_model.data.dataset import open_dataset
from supersampler_model.methods.classifier.small import SmallClassifier
from supersampler_model.training.class_loss import ClassifierWeights
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.trainer import Plan, Trainer
from supersampler_model.training.validate import validate, validation_entries

SCORES = ("psnr", "tpsnr")


def _task(weights: ClassifierWeights, *, recurrent: bool = True) -> ClassifierTask:
    return ClassifierTask(SmallClassifier(replace(SmallConfig(), recurrent=recurrent)), weights)


VARIANTS: Mapping[str, Callable[[], ClassifierTask]] = {
    "classifier-small": lambda: _task(ClassifierWeights()),
    "without the class loss": lambda: _task(ClassifierWeights(classes=0.0)),
    "classes of the previous frame are no inputs": lambda: _task(ClassifierWeights(), recurrent=False),
}
"""The first is what the others differ from in one thing."""


@dataclass(frozen=True)
class Training:
    """How each variant is trained.

    Attributes:
        data: training sets, with validation sequences.
        folder: of all runs.
        plan: of each run, but for its seed.
    """

    data: Sequence[Path]
    folder: Path
    plan: Plan


def trained_scores(training: Training, run: tuple[str, int]) -> dict[str, float]:
    """Train a variant from a seed, or continue it, and return its validation scores.

    Args:
        training: how.
        run: name of the variant, and its seed.
    """
    name, seed = run
    folder = training.folder / f"{list(VARIANTS).index(name)}-{seed}"
    scored = folder / "scored.json"
    if scored.exists():
        known: dict[str, float] = loads(scored.read_text(encoding="utf-8"))
        return known
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    datasets = [open_dataset(path) for path in training.data]
    trainer = Trainer(VARIANTS[name](), datasets, replace(training.plan, seed=seed), folder)
    while trainer.done < trainer.plan.steps:
        trainer.run(trainer.done + 200)
        trainer.save()
    entries = validation_entries(trainer.datasets, trainer.task.ratios)
    scores = validate(trainer.average.eval(), entries).scores
    ERRORS.print(f"{name}, seed {seed}: {scores['psnr']:.2f} dB, tPSNR {scores['tpsnr']:.2f} dB")
    write_json(scores, scored)
    return scores


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    first = record["rows"][0]
    rows = []
    for row in record["rows"]:
        cells = [row["name"]]
        for score in SCORES:
            difference = mean(row[score]) - mean(first[score])
            chance = max(_spread(row[score]), _spread(first[score]))
            cells += [figure(mean(row[score]), 2), figure(_spread(row[score]), 2)]
            told = "chance" if abs(difference) <= chance else f"{difference:+.2f}"
            cells.append("–" if row is first else told)
        rows.append(cells)
    headings = [
        "variant",
        *(h for name in ("PSNR", "tPSNR") for h in (f"{name} dB:", "spread:", "difference:")),
    ]
    plan = record["plan"]
    caption = (
        f"Means of {record['seeds']} seeds, each trained from the beginning for {plan['steps']} updates of "
        f"{plan['batch']} crops, on the validation sequences. Spread: of the seeds, largest minus least. A "
        "difference to the first row within the larger of both spreads is called chance."
    )
    return table(headings, rows, caption)


def _spread(values: Sequence[float]) -> float:
    return max(values) - min(values)


def study(training: Training, seeds: int, workers: int) -> dict[str, Any]:
    """Return the record of all runs."""
    runs = list(product(VARIANTS, range(1, seeds + 1)))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        found = dict(zip(runs, pool.map(partial(trained_scores, training), runs), strict=True))
    rows = [
        {"name": name} | {s: [found[name, seed][s] for seed in range(1, seeds + 1)] for s in SCORES}
        for name in VARIANTS
    ]
    plan = {"steps": training.plan.steps, "batch": training.plan.batch, "size": training.plan.size}
    return {"bench": "ablation seeds", "seeds": seeds, "plan": plan, "rows": rows}


def main(
    data: Annotated[list[Path], typer.Option(help="Training set with validation sequences; any number.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the runs.")],
    steps: Annotated[int, typer.Option(min=1, help="Updates of each run.")] = 1200,
    size: Annotated[int, typer.Option(min=16, help="Of the crops, display pixels.")] = 96,
    batch: Annotated[int, typer.Option(min=1, help="Crops.")] = 8,
    seeds: Annotated[int, typer.Option(min=2, help="Runs of each variant.")] = 3,
    workers: Annotated[int, typer.Option(min=1, help="Runs at a time, a thread each.")] = 1,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Train variants of classifier-small from several seeds each, and compare."""
    tables = {"study ablation seeds": markdown_table}
    check_page(update, tables)
    training = Training(data, output, Plan(steps=steps, size=size, batch=batch, average=steps // 6))
    publish(study(training, seeds, workers), tables, json, update)


if __name__ == "__main__":
    typer.run(main)
