"""Record and tables of `bench denoise`: error and cost of ways to denoise a path tracer's frames."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from supersampler.cli.arguments import size_text
from supersampler.frame import Size
from supersampler_bench.quality.scores import BORDER
from supersampler_bench.record import DENOISER, BenchRecord, figure, table

FRAME, MEDIAN, ONE_PASS = "frame", "median", f"{DENOISER}:1-pass"
METHODS = {
    FRAME: "per-frame denoiser alone",
    MEDIAN: "median of three",
    ONE_PASS: "temporal denoiser, 1 pass",
    DENOISER: "temporal denoiser, 2 passes",
}
"""Names of the compared ways, and their titles in tables."""


def mean_of(values: Sequence[float | None]) -> float | None:
    """Return the mean of the known values; None if none is known."""
    known = [value for value in values if value is not None and not np.isnan(value)]
    return float(np.mean(known)) if known else None


@dataclass(frozen=True)
class DenoiseScores:
    """Scores of one way to denoise."""

    method: str  # one of METHODS
    frames_psnr: list[float]  # of each frame with a reference, dB, of sRGB values
    tpsnr: float | None  # dB, mean; None without references of consecutive frames
    frames_flip: list[float]  # of each frame with a reference; empty without flip-evaluator

    @property
    def psnr(self) -> float | None:
        """Mean PSNR of the frames, dB."""
        return mean_of(self.frames_psnr)

    @property
    def flip(self) -> float | None:
        """Mean FLIP of the frames; None without flip-evaluator."""
        return mean_of(self.frames_flip)


@dataclass(frozen=True)
class RenderRow:
    """Scores and costs of one render; costs are CPU seconds per frame."""

    scene: str
    samples: int  # per pixel
    size: Size
    frames: list[int]  # numbers of the denoised frames
    reference_frames: list[int]  # numbers of the scored frames
    reference_files: int  # of the reference that averages the fewest files
    reference_is_denoised: bool  # whether the references were denoised, each by itself
    scored: float  # fraction of the pixels that was scored
    per_frame: str  # "oidn"; "none" if the frames came denoised
    render_cpu: float | None  # of the renderer; None if unknown
    frame_cpu: float  # of the per-frame denoiser; 0 if the frames came denoised
    mean_cpu: float  # of the denoiser of noisy means; 0 if the frames came denoised
    filter_cpu: float  # of the temporal filter, at frames that have all neighbours
    one_pass_cpu: float  # of the temporal filter with one pass
    methods: list[DenoiseScores]

    def scores(self, method: str) -> DenoiseScores:
        """Return the scores of one of METHODS."""
        return next(scores for scores in self.methods if scores.method == method)

    def own_cpu(self, method: str) -> float | None:
        """Return the CPU seconds per frame of the temporal filter; None if they were not measured."""
        return {FRAME: 0.0, ONE_PASS: self.one_pass_cpu, DENOISER: self.filter_cpu}.get(method)

    def whole_cpu(self, method: str) -> float | None:
        """Return all CPU seconds per frame, with those of the renderer; None if they were not measured."""
        own = self.own_cpu(method)
        if own is None or self.render_cpu is None:
            return None
        return self.render_cpu + self.frame_cpu + own + (self.mean_cpu if method == DENOISER else 0.0)


@dataclass(frozen=True)
class DenoiseRecord(BenchRecord):
    """Scores of renders. `model_digests` has the digest of the temporal denoiser's constants."""

    renders: list[RenderRow]
    border: int = BORDER
    BENCH = "denoise"
    TABLES = ("", "scenes", "flip")

    def table(self) -> str:
        """Return the table of means over scenes, at each number of samples."""
        headings = [
            "samples:", "method", "PSNR dB ↑:", "tPSNR dB ↑:", "FLIP ↓:", "CPU s per frame:",
            "dB at equal time:", "filter alone:", "filter, CPU s per megapixel:",
        ]  # fmt: skip
        counts = sorted({row.samples for row in self.renders})
        rows = [row for samples in counts for row in self._mean_rows(samples)]
        scenes = sorted({row.scene for row in self.renders})
        caption = (
            f"Means over those of the scenes {', '.join(scenes)} that have the number of samples. CPU s per "
            "frame: renderer, denoiser and temporal filter together, one thread each. dB at equal time: PSNR "
            "above that of the per-frame denoiser alone with as many samples as take as long. The filter's "
            f"time is of frames with all neighbours, without AOVs. {self._conditions()}"
        )
        return table(headings, rows, caption)

    def scenes_table(self) -> str:
        """Return the table of PSNR, tPSNR and costs of each render."""
        headings = ["scene", "samples:", *(f"{title}:" for title in METHODS.values())]
        costs = [
            "renderer, CPU s:",
            "per-frame denoiser, CPU s:",
            "denoiser of means, CPU s:",
            "filter, CPU s:",
        ]
        rows = [
            [
                row.scene, row.samples,
                *(f"{figure(s.psnr, 2)} / {figure(s.tpsnr, 2)}" for s in map(row.scores, METHODS)),
                figure(row.render_cpu, 1), figure(row.frame_cpu, 1), figure(row.mean_cpu, 1),
                figure(row.filter_cpu, 2),
            ]
            for row in self._ordered()
        ]  # fmt: skip
        caption = (
            f"PSNR / tPSNR, dB, and CPU seconds per frame. {self._gains('frames_psnr', 2, ' dB of PSNR')}"
        )
        return table([*headings, *costs], rows, caption)

    def flip_table(self) -> str:
        """Return the table of the FLIP of each render."""
        headings = ["scene", "samples:", *(f"{title}:" for title in METHODS.values())]
        rows = [
            [row.scene, row.samples, *(figure(row.scores(method).flip, 4) for method in METHODS)]
            for row in self._ordered()
        ]
        caption = f"FLIP, lower is better. {self._gains('frames_flip', 4, '')}".rstrip()
        return table(headings, rows, caption)

    def _gains(self, name: str, digits: int, unit: str) -> str:
        """Return a sentence on the gains in single frames, from a field of DenoiseScores."""
        pairs = [
            (getattr(row.scores(DENOISER), name), getattr(row.scores(FRAME), name)) for row in self.renders
        ]
        gains = np.concatenate([np.subtract(*pair) for pair in pairs])
        if not gains.size:
            return ""
        return (
            f"Two passes minus per-frame denoiser, in the {gains.size} scored frames: "
            f"{gains.min():+.{digits}f} to {gains.max():+.{digits}f}{unit}."
        )

    def _ordered(self) -> list[RenderRow]:
        return sorted(self.renders, key=lambda row: (row.samples, row.scene))

    def _mean_rows(self, samples: int) -> list[list[object]]:
        """Return the rows of the mean table at one number of samples."""
        renders = [row for row in self.renders if row.samples == samples]
        found: list[list[object]] = []
        for method, title in METHODS.items():
            scores = [row.scores(method) for row in renders]
            own, whole = zip(*((row.own_cpu(method), row.whole_cpu(method)) for row in renders), strict=True)
            a_megapixel = [
                None if cpu is None or method == FRAME else 1e6 * cpu / (row.size[0] * row.size[1])
                for row, cpu in zip(renders, own, strict=True)
            ]
            psnr, tpsnr, flip = (
                mean_of([getattr(each, name) for each in scores]) for name in ("psnr", "tpsnr", "flip")
            )
            of_filter = None if method == FRAME else mean_of(own)
            gain = None if method == FRAME else self._gain_at_equal_time(psnr, mean_of(whole))
            costs = (figure(cost, 2) for cost in (mean_of(whole), gain, of_filter, mean_of(a_megapixel)))
            found.append([samples, title, figure(psnr, 2), figure(tpsnr, 2), figure(flip, 4), *costs])
        return found

    def _gain_at_equal_time(self, psnr: float | None, seconds: float | None) -> float | None:
        """Return the dB above the mean PSNR of the per-frame denoiser alone at the same CPU time.

        Time is linear in the samples per pixel, and PSNR in their logarithm. None where a figure is missing,
        or no render takes as long.
        """
        counts = sorted({row.samples for row in self.renders})
        alone = [[row for row in self.renders if row.samples == samples] for samples in counts]
        times = [mean_of([row.whole_cpu(FRAME) for row in rows]) for rows in alone]
        values = [mean_of([row.scores(FRAME).psnr for row in rows]) for rows in alone]
        if psnr is None or seconds is None or None in times or None in values:
            return None
        samples = np.interp(seconds, times, counts, left=np.nan, right=np.nan)  # type: ignore[arg-type]
        return psnr - float(np.interp(np.log(samples), np.log(counts), values))  # type: ignore[arg-type]

    def _conditions(self) -> str:
        """Return sentences that say what was measured, and how."""
        sizes = sorted({size_text(row.size) for row in self.renders})
        first = {"oidn": "OIDN with filtered guides denoises each frame", "none": "The frames came denoised"}
        kinds = " or ".join(sorted({first[row.per_frame] for row in self.renders}))
        counts = sorted({len(row.reference_frames) for row in self.renders})
        denoised = " and denoised by OIDN" if any(row.reference_is_denoised for row in self.renders) else ""
        return (
            f"{kinds}; {', '.join(sizes)}. Scored: {' or '.join(map(str, counts))} frames of each render, "
            f"{100.0 * np.mean([row.scored for row in self.renders]):.0f} % of the pixels, as sRGB without a "
            f"tone curve; the references are rendered with more samples{denoised}. {self.machine_name}."
        )
