"""Run scenarios one after another; kept outcomes let a stopped run continue."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import supersampler
import supersampler_bench.stress
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.files import replacing
from supersampler_bench.stress import hostile, light, recovery, sampling, sessions, steady, travel, two_passes
from supersampler_bench.stress.scenario import Figure, Scenario, Subject

FAMILIES: Mapping[str, Sequence[Scenario]] = {
    "steady": steady.SCENARIOS,
    "hostile": hostile.SCENARIOS,
    "recovery": recovery.SCENARIOS,
    "light": light.SCENARIOS,
    "travel": travel.SCENARIOS,
    "sampling": sampling.SCENARIOS,
    "sessions": sessions.SCENARIOS,
    "two-passes": two_passes.SCENARIOS,
}
"""All scenarios, by kind."""
BAD_VALUES = "bad values"


@dataclass(frozen=True)
class Outcome:
    """What one run of a scenario gave.

    Attributes:
        scenario, method, executor, precision: what was run.
        display: (width, height) of the images.
        frames: how many, about.
        figures: what was measured; that no image had a bad value is among them. None of a run that broke.
        curve: what to look at.
        error: why it broke.
    """

    scenario: str
    method: str
    executor: str
    precision: str
    display: Size
    frames: int
    figures: tuple[Figure, ...]
    curve: list[float]
    error: str = ""

    @property
    def passed(self) -> bool:
        """Whether it ran, and all figures are within their bounds."""
        return not self.error and all(figure.passed for figure in self.figures)


def chosen(names: Sequence[str], *, quick: bool = False) -> list[Scenario]:
    """Return the scenarios of these names, or of these families; all where there are none.

    Raises:
        ArgumentError: there is none of that name.
    """
    known = {scenario.name for family in FAMILIES.values() for scenario in family}
    for name in names:
        if name not in known and name not in FAMILIES:
            want = f"a family ({', '.join(FAMILIES)}) or one of: {', '.join(sorted(known))}"
            raise ArgumentError("--only", got=repr(name), want=want)
    return [
        scenario
        for family, scenarios in FAMILIES.items()
        for scenario in scenarios
        if (not names or scenario.name in names or family in names) and (scenario.quick or not quick)
    ]


def runs(scenarios: Sequence[Scenario], subjects: Sequence[Subject]) -> list[tuple[Scenario, Subject]]:
    """Return what `measure` will run, in its order."""
    return [(scenario, subject) for scenario in scenarios for subject in subjects if scenario.suits(subject)]


def left_out(scenarios: Sequence[Scenario], subjects: Sequence[Subject]) -> list[str]:
    """Return a warning for each subject that does not support the ratios of some scenarios."""
    texts = []
    for subject in subjects:
        names = [scenario.name for scenario in scenarios if not scenario.supports(subject)]
        low, high = subject.ratios
        ratios = f"{low:g} alone" if low == high else f"{low:g} to {high:g}"
        if names:
            texts.append(
                f"{subject.method} {subject.executor}, whose ratios are {ratios}, is left out of "
                f"{', '.join(names)}"
            )
    return texts


def measure(
    scenarios: Sequence[Scenario],
    subjects: Sequence[Subject],
    *,
    quick: bool = False,
    keep: Path | None = None,
) -> Iterator[Outcome]:
    """Run all that make sense; yields each when it is done.

    Args:
        scenarios: of FAMILIES, or others.
        subjects: methods in executors.
        quick: few and small frames.
        keep: folder where outcomes are kept, and taken from where nothing has changed since.
    """
    state = source_state() if keep is not None else ""
    for scenario, subject in runs(scenarios, subjects):
        path = None if keep is None else keep / f"{_file_name(scenario, subject, quick=quick)}.json"
        outcome = None if path is None else _kept(path, state)
        if outcome is None:
            outcome = run(scenario, subject, quick=quick)
            if path is not None:
                _keep(outcome, path, state)
        yield outcome


def run(scenario: Scenario, subject: Subject, *, quick: bool = False) -> Outcome:
    """Run one scenario; what breaks in it is part of the outcome."""
    trial = scenario.trial(subject, quick=quick)
    figures: tuple[Figure, ...] = ()
    curve: list[float] = []
    error = ""
    try:
        measured = scenario.run(trial)
    except Exception as broke:  # whatever a method raises is what is looked for
        error = f"{type(broke).__name__}: {broke}"
    else:
        bad = float(measured.bad_values + sum(session.bad_values for session in trial.opened))
        figures, curve = (*measured.figures, Figure(BAD_VALUES, bad, 0.0)), measured.curve
    return Outcome(
        scenario=scenario.name,
        method=subject.method,
        executor=subject.executor,
        precision=subject.precision,
        display=trial.display,
        frames=trial.frames,
        figures=figures,
        curve=curve,
        error=error,
    )


def source_state() -> str:
    """Digest of all that outcomes depend on: the runtime with its models, the scenarios."""
    digest = hashlib.sha256()
    for module in (supersampler, supersampler_bench.stress):
        root = Path(str(module.__file__)).parent
        for path in sorted(root.rglob("*")):
            if path.suffix in (".py", ".json", ".onnx", ".npz"):
                digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def _file_name(scenario: Scenario, subject: Subject, *, quick: bool) -> str:
    parts = (scenario.name.replace(" ", "_"), Path(subject.method).name, subject.executor)
    return "-".join((*parts, "quick") if quick else parts)


def _keep(outcome: Outcome, path: Path, state: str) -> None:
    with replacing(path) as partial:
        partial.write_text(json.dumps({"of": state, **asdict(outcome)}), encoding="utf-8")


def _kept(path: Path, state: str) -> Outcome | None:
    if not path.is_file():
        return None
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    if data.pop("of") != state:
        return None
    data["figures"] = tuple(Figure(**figure) for figure in data["figures"])
    return Outcome(**{**data, "display": tuple(data["display"])})
