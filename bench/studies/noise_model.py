"""Compares the path-tracing noise of training crops with that of Mitsuba 3, in four scenes.

    python bench/studies/noise_model.py --json FILE --update docs/training.md

Needs `pip install ".[train]" mitsuba`.
"""

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
import torch
import typer
from numpy.typing import NDArray

from supersampler.io.display import BT709
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.record import Record, machine_name
from supersampler_model.training.path_noise import PathNoise

SEEDS = 3
SAMPLES = 1, 4, 16
QUANTILES = 0.1, 0.5, 0.9, 0.99, 0.999
DARK = 0.01  # of the median luma: darker pixels do not count
FITTED = {  # certain, missed, spread
    "Cornell box": (0.0, 0.17, 1.0),
    "room with a small lamp": (0.6, 0.02, 1.25),
    "room with a large lamp": (0.7, 0.0, 1.2),
    "outdoors, sun and sky": (0.8, 0.0, 0.7),
}
"""Parameters of `PathNoise` for each scene, fitted by hand."""


def rows(reference_samples: int) -> Iterator[dict[str, Any]]:
    """Yield the quantiles of both, for each scene and number of samples."""
    import mitsuba as mi

    from studies.noise_scenes import scenes

    for (name, noise_of_scene), described in zip(FITTED.items(), scenes(), strict=True):
        scene = mi.load_dict(described)
        reference = np.array(mi.render(scene, spp=reference_samples, seed=SEEDS))
        light = torch.from_numpy(reference).permute(2, 0, 1)[None]
        for samples in SAMPLES:
            rendered = [np.array(mi.render(scene, spp=samples, seed=seed)) for seed in range(SEEDS)]
            noise = PathNoise(samples, *noise_of_scene)
            modelled = [
                noise.on(light, np.random.default_rng(seed))[0].permute(1, 2, 0).numpy()
                for seed in range(SEEDS)
            ]
            found = {"Mitsuba": _quantiles(rendered, reference), "model": _quantiles(modelled, reference)}
            yield {"scene": name, "samples": samples, "quantiles": found}


def _quantiles(images: list[NDArray[np.float32]], reference: NDArray[np.float32]) -> list[float]:
    """Return QUANTILES of the luma of noisy images over the reference; images are (h, w, 3) linear RGB."""
    luma = reference @ BT709
    counted = luma > DARK * np.median(luma)
    ratios = (np.stack(images) @ BT709)[:, counted] / luma[counted]
    return [float(q) for q in np.quantile(ratios, QUANTILES)]


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    cells = [
        [row["scene"], row["samples"], of, *(figure(value, 2) for value in values)]
        for row in record["rows"]
        for of, values in row["quantiles"].items()
    ]
    caption = (
        "Quantiles of the luma of noisy pixels, relative to references of "
        f"{record['reference_samples']} samples. Mitsuba {record['mitsuba']}; {machine_name(record)}."
    )
    heads = ["scene", "samples:", "", *(f"{100.0 * q:g} %:" for q in QUANTILES)]
    return table(heads, cells, caption)


def main(
    reference_samples: Annotated[int, typer.Option(help="Of a pixel of the reference.")] = 1024,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Compare the noise of training crops with a path tracer's."""
    import mitsuba as mi  # here alone: those who read records do not have it

    tables = {"study noise model": markdown_table}
    check_page(update, tables)
    mi.set_variant("scalar_rgb")
    record = {
        "bench": "noise_model",
        "mitsuba": mi.__version__,
        "reference_samples": reference_samples,
        "rows": list(rows(reference_samples)),
    }
    publish(record, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
