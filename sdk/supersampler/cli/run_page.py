"""compare.html of a run: its captions, and the images of each frame."""

from collections.abc import Iterator
from contextlib import contextmanager

from supersampler.aux_outputs import LEGENDS, aux_output_layers
from supersampler.cli.arguments import size_text
from supersampler.cli.job import UpscaleJob
from supersampler.cli.results import Results
from supersampler.cli.segment_steps import SteppedFrame
from supersampler.history import StepResult
from supersampler.io.compare import ERROR_LEGEND, About, ComparePage, compare_layers, compare_page, versions
from supersampler.upscaler import Upscaler

_NOTES = (
    "JPEG of quality 92, small ones PNG. The input is as rendered, with its jitter.",
    "error: mean over r, g, b of |output − reference| of these images. PSNR: of the same images before "
    "rounding to 8 bits, whole frame.",
)


class RunPage:
    """The page of a run; made by `run_page`."""

    def __init__(self, job: UpscaleJob, page: ComparePage, bicubic: Upscaler) -> None:
        self._job, self._page, self._bicubic = job, page, bicubic

    def add(self, item: SteppedFrame, result: StepResult, exposure: float) -> None:
        """Add the images of a frame."""
        shot, frame = self._job.shot, item.frame
        layers, numbers = compare_layers(
            frame,
            result.image,
            item.reference,
            exposure,
            bicubic=None if frame.color is None else self._bicubic.step(frame),
            transform=self._job.images.transform,
        )
        self._page.add(shot.first_number + item.index, {**layers, **aux_output_layers(result)}, numbers)


@contextmanager
def run_page(job: UpscaleJob, upscaler: Upscaler, results: Results) -> Iterator[RunPage]:
    """Write the page of a run; it appears when the block ends without an error."""
    shot, model, info = job.shot, upscaler.model, upscaler.model.info
    display_size = upscaler.display_size or shot.render_size
    provider = model.providers[0].removesuffix("ExecutionProvider")
    sources = ". ".join(line.rstrip(".") for line in (*shot.attribution, shot.license) if line)
    about = About(
        title=shot.name,
        method=info.method,
        display_size=display_size,
        frame_rate=shot.frame_rate or 30.0,
        facts={
            "method": info.method,
            "size": f"{size_text(shot.render_size)} to {size_text(display_size)}".replace("x", " × "),
            "runs on": f"{provider} ({model.executor}, {model.precision})",
            "frames": str(len(job.numbers or shot)),
        },
        legends={"error": ERROR_LEGEND, **LEGENDS},
        notes=[
            f"Images show {job.images.transform.description}.",
            *_NOTES,
            *([f"Shot: {sources}."] if sources else []),
            versions(),
        ],
    )
    bicubic = Upscaler("bicubic", display_size=display_size, threads=job.threads, validate="off")
    with compare_page(results.begin_file(results.page), about) as page, bicubic:
        yield RunPage(job, page, bicubic)
