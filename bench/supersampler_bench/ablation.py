"""What each choice of the classifier gives: one changed at a time, trained briefly, all alike, validated."""

import json
import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from supersampler_bench.record import Record, write_json
from supersampler_model.data.dataset import open_dataset
from supersampler_model.methods.classifier import Classifier, ClassifierConfig
from supersampler_model.methods.classifier_inputs import INPUTS
from supersampler_model.methods.classifier_paper import PaperClassifier, PaperConfig
from supersampler_model.methods.classifier_small import SmallClassifier, SmallConfig
from supersampler_model.train.classifier_task import ClassifierTask
from supersampler_model.train.trainer import Plan, Trainer
from supersampler_model.train.validate import validate, validation_entries

BATCH, AVERAGE = 4, 100
CHANCE = "all inputs seen, from another seed"  # what differences mean nothing


@dataclass(frozen=True)
class Row:
    """One variant's scores on the validation sequences."""

    name: str
    psnr: float
    tpsnr: float


ALL_SEEN = ClassifierConfig(inputs=INPUTS)
"""What each variant but those of other widths differs from in one thing; the default does, too."""


def without(*inputs: str) -> ClassifierConfig:
    """Return `ALL_SEEN` with a network that does not see these inputs."""
    return replace(ALL_SEEN, inputs=tuple(name for name in INPUTS if name not in inputs))


def changed(**fields: Any) -> Callable[[], Classifier]:
    """Return what makes `ALL_SEEN` with other values of these fields."""
    return lambda: Classifier(replace(ALL_SEEN, **fields))


VARIANTS: Mapping[str, Callable[[], Classifier]] = {
    "all inputs seen": changed(),
    "half the width (`classifier-small`)": lambda: SmallClassifier(SmallConfig(inputs=INPUTS)),
    "the paper's form (`classifier-paper`)": lambda: PaperClassifier(PaperConfig(inputs=INPUTS)),
    "past not cut to the box": changed(rectified=False),
    "no past by the pixel's own motion": changed(own_motion=False),
    "warped past not filtered": changed(corrected=False),
    "differences of past and present not seen": lambda: Classifier(
        without("past_to_sample", "past_to_frame", "beyond")
    ),
    "means of differences around not seen": changed(around=()),
    "contrasts not seen": lambda: Classifier(without("contrast", "past_contrast")),
    "range of the past not seen": lambda: Classifier(without("least", "most")),
    "range only grows": changed(contraction=0.0),
    "distance of samples not seen": lambda: Classifier(without("confidence")),
    "count not seen": lambda: Classifier(without("count")),
    "difference of depth and cover not seen": lambda: Classifier(without("difference", "surface")),
    "classes of the frame before not seen": changed(recurrent=False),
    "speed and blur not seen (the default)": Classifier,
    "each channel toned alone": changed(tone_space="channels"),
    "toned by logarithms": changed(tone_space="logarithm"),
    "count seen by its logarithm": changed(count_code="logarithm"),
    CHANCE: changed(),
}


@dataclass(frozen=True)
class Ablation:
    """What is run.

    Attributes:
        data: training sets.
        folder: of the runs, numbered as VARIANTS; a run that is there is gone on with.
        steps: updates of each.
        workers: runs at a time, a thread each.
        names: of VARIANTS.
    """

    data: Sequence[Path]
    folder: Path
    steps: int
    workers: int = 1
    names: Sequence[str] = tuple(VARIANTS)


def run_ablation(ablation: Ablation, on_row: Callable[[Row], None]) -> list[Row]:
    """Train and validate all variants, in the order of their names."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(ablation.workers, context) as pool:
        futures = [pool.submit(run_variant, ablation, name) for name in ablation.names]
        for future in as_completed(futures):
            on_row(future.result())
        return [future.result() for future in futures]


def ablation_record(rows: Sequence[Row], ablation: Ablation) -> dict[str, Any]:
    """Return everything, ready for JSON."""
    plan = {"steps": ablation.steps, "batch": BATCH}
    return {"bench": "ablation", **plan, "rows": [vars(row) for row in rows]}


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    rows = [Row(**row) for row in record["rows"]]
    base = rows[0].psnr
    seeds = "All from one seed."
    if rows[-1].name == CHANCE:
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
    """Train and validate one variant, or go on with what its folder has of it.

    Raises:
        ArgumentError: the folder has the run of another variant, from before VARIANTS were changed.
    """
    torch.set_num_threads(1)
    seed = int(name == CHANCE)
    torch.manual_seed(seed)
    folder = ablation.folder / f"{list(VARIANTS).index(name):02d}"
    folder.mkdir(parents=True, exist_ok=True)
    scored = folder / f"scored-{ablation.steps}.json"
    if (known := _known(scored, name)) is not None:
        return known
    datasets = [open_dataset(path) for path in ablation.data]
    method = VARIANTS[name]()
    plan = Plan(steps=ablation.steps, batch=BATCH, average=AVERAGE, seed=seed)
    trainer = Trainer(ClassifierTask(method), datasets, plan, folder)
    while trainer.done < ablation.steps:
        trainer.run(trainer.done + 200)
        trainer.save()
    found = validate(trainer.average.eval(), validation_entries(datasets, method.ratios))
    row = Row(name, found.psnr, found.tpsnr)
    write_json(vars(row), scored)
    return row


def _known(scored: Path, name: str) -> Row | None:
    """Scores in a folder, if they are this variant's: numbers of folders change when VARIANTS do."""
    if not scored.exists():
        return None
    known = json.loads(scored.read_text(encoding="utf-8"))
    return Row(**known) if known.get("name") == name else None
