"""Ablation: train variants of a method that differ in one choice each, briefly, and compare their scores.

The same command continues a stopped run:
    python bench/studies/ablation.py classifier --data data -o ablation --workers 2
    python bench/studies/ablation.py classifier-small --data data -o ablation --workers 2 \
        --steps 1500 --size 96 --seeds 3
"""

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from json import loads
from pathlib import Path
from statistics import fmean
from typing import Annotated

import torch
import typer

from studies.ablation_variants import VARIANTS, Variants
from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import ERRORS, JSON, publish
from supersampler_bench.markdown import table, update_block
from supersampler_bench.record import BenchRecord, write_json
from supersampler_model.data.dataset import open_dataset
from supersampler_model.training.trainer import Plan, Trainer
from supersampler_model.training.validation import validate, validation_entries

BATCH, AVERAGE = 4, 100


@dataclass(frozen=True)
class Scores:
    """Scores of one run: means over the validation sequences, dB."""

    psnr: float
    tpsnr: float


@dataclass(frozen=True)
class Row:
    """Scores of one variant: a run for each seed."""

    name: str
    seeds: Sequence[Scores]

    @property
    def psnr(self) -> float:
        """Mean of the runs."""
        return fmean(run.psnr for run in self.seeds)

    @property
    def spread(self) -> float:
        """Highest PSNR of a run minus the lowest."""
        return max(run.psnr for run in self.seeds) - min(run.psnr for run in self.seeds)


@dataclass(frozen=True)
class Ablation:
    """Plan of an ablation.

    Attributes:
        method: a key of VARIANTS.
        data: training sets.
        folder: folder of the runs, numbered like the method's variants; existing runs are continued.
        steps: updates of each run.
        size: size of the crops, display pixels.
        seeds: runs of each variant. The first variant has at least two, so that chance is known.
        workers: runs at a time, one thread each.
    """

    method: str
    data: Sequence[Path]
    folder: Path
    steps: int
    size: int = 128
    seeds: int = 1
    workers: int = 1

    @property
    def variants(self) -> Variants:
        """Variants of the method."""
        return VARIANTS[self.method]

    @property
    def runs(self) -> list[tuple[str, int]]:
        """Variant and seed of each run, all variants of one seed after another."""
        first = next(iter(self.variants))
        every = [(name, seed) for seed in range(max(self.seeds, 2)) for name in self.variants]
        return [(name, seed) for name, seed in every if seed < self.seeds or name == first]


def run_ablation(ablation: Ablation, on_scores: Callable[[str, Scores], None]) -> list[Row]:
    """Train and validate all variants, in their order."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(ablation.workers, context) as pool:
        futures = {pool.submit(run_variant, ablation, *run): run for run in ablation.runs}
        for future in as_completed(futures):
            on_scores(futures[future][0], future.result())
    found = {run: future.result() for future, run in futures.items()}
    return [
        Row(variant, [scores for (name, _), scores in found.items() if name == variant])
        for variant in ablation.variants
    ]


def run_variant(ablation: Ablation, name: str, seed: int) -> Scores:
    """Train and validate one variant, or continue the run in its folder."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    folder = ablation.folder / f"{list(ablation.variants).index(name):02d}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    scored = folder / f"scored-{ablation.steps}.json"
    if scored.exists():
        known = loads(scored.read_text(encoding="utf-8"))
        if known.pop("name") == name:  # folder numbers change with the list of variants
            return Scores(**known)
    datasets = [open_dataset(path) for path in ablation.data]
    task = ablation.variants[name]()
    plan = Plan(steps=ablation.steps, batch=BATCH, size=ablation.size, average=AVERAGE, seed=seed)
    trainer = Trainer(task, datasets, plan, folder)
    while trainer.done < ablation.steps:
        trainer.run(trainer.done + 200)
        trainer.save()
    found = validate(trainer.average.eval(), validation_entries(trainer.datasets, task.method.ratios))
    scores = Scores(found.psnr, found.tpsnr)
    write_json({"name": name, **asdict(scores)}, scored)
    return scores


@dataclass(frozen=True)
class AblationRecord(BenchRecord):
    """Scores of all variants of a method, and how they were trained."""

    method: str
    steps: int
    batch: int
    size: int
    rows: list[Row]
    BENCH = "ablation"

    def table(self) -> str:
        """Return the table as Markdown, with its caption."""
        caption = (
            f"Each trained for {self.steps} updates of {self.batch} crops of {self.size}x{self.size} pixels, "
            "far from the end: what is compared is how fast it learns. Means over the seeds and over the "
            "validation sequences; ± is half of the range of the seeds. Differences in brackets are chance: "
            f"less than the range of the first, {self.rows[0].spread:.2f} dB, or of their own."
        )
        headings = ["variant", "PSNR dB:", "against the first:", "tPSNR dB:", "seeds:"]
        return table(headings, [_cells(row, self.rows[0]) for row in self.rows], caption)


def _cells(row: Row, first: Row) -> list[object]:
    gain = row.psnr - first.psnr
    difference = f"{round(gain, 2) + 0.0:+.2f}"  # no -0.00
    if row is not first and abs(gain) < max(row.spread, first.spread):
        difference = f"({difference})"
    psnr = f"{row.psnr:.2f}" if len(row.seeds) == 1 else f"{row.psnr:.2f} ± {row.spread / 2:.2f}"
    return [row.name, psnr, difference, f"{fmean(run.tpsnr for run in row.seeds):.2f}", len(row.seeds)]


def main(
    method: Annotated[str, typer.Argument(metavar="METHOD", help=f"One of {', '.join(VARIANTS)}.")],
    data: Annotated[list[Path], typer.Option(help="Training set with validation sequences; any number.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the runs.")],
    steps: Annotated[int, typer.Option(min=1, help="Updates of each run.")] = 800,
    size: Annotated[int, typer.Option(min=32, help="Size of the crops, display pixels.")] = 128,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each variant; the first has at least two.")] = 1,
    workers: Annotated[int, typer.Option(min=1, help="Runs at a time, one thread each.")] = 1,
    json: JSON = None,
    update: Annotated[Path | None, typer.Option(help="Rewrite the table of this Markdown file.")] = None,
) -> None:
    """Train METHOD with one choice changed at a time, briefly, and compare on validation sequences."""
    if method not in VARIANTS:
        raise ArgumentError("METHOD", got=method, want=f"one of {', '.join(VARIANTS)}")
    block = f"study ablation {method}"
    plan = Ablation(method, data, output, steps=steps, size=size, seeds=seeds, workers=workers)
    rows = run_ablation(
        plan, lambda name, s: ERRORS.print(f"{name}: {s.psnr:.2f} dB, tPSNR {s.tpsnr:.2f} dB")
    )
    record = AblationRecord(method, steps, BATCH, size, rows)
    publish(record, block, json)
    if update is not None:
        update_block(update, block, record.table())


if __name__ == "__main__":
    typer.run(main)
