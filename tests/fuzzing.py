"""Fuzz tests: cases by number, each in a child process under limits, where only our own errors may come out.

    def prepare() -> Callable[[int], object]:  # loads what all cases need, and returns what runs one
        return lambda case: open_recording(damaged_file(np.random.default_rng(case)))

    def test_no_recording_harms_its_reader() -> None:
        assert run_apart(prepare, examples()) == []

A case seeds all that it does by its number, so a finding is repeated by `prepare()(number)`. The working
directory of the child is an empty folder of its own. SUPERSAMPLER_FUZZ=2000 runs that many cases a test.
"""

import faulthandler
import importlib.util
import inspect
import json
import os
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Prepare = Callable[[], Callable[[int], object]]
FINDINGS = 20  # after so many a test has failed clearly enough
HOSTILE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 255, 2**31 - 1, -(2**31), 2**40, 2**63, 10**400, 0.5, -0.0, 1e-45, 1e308,
    float("nan"), float("inf"), "", "x", "a" * 5000, "../x", "/etc/passwd", "\0", "\ud800", "2",
    [], [0] * 300, [[]], {}, {"": None},
)  # fmt: skip
"""JSON values that few readers expect; json.loads gives all of them."""
NUMBERS = (0, 1, -1, 7, 255, 65536, 10**5, 10**9, 2**31 - 1, -(2**31))
EXTREMES = (np.nan, np.inf, -np.inf, -1, 0, 1, 255, 2**31 - 1, -(2**31), 2**62, 1e30, -1e30, 1e-45, 3e38)


def examples(few: int = 25) -> int:
    """Return the number of cases of a fuzz test: SUPERSAMPLER_FUZZ, else `few`."""
    return int(os.environ.get("SUPERSAMPLER_FUZZ", few))


def run_apart(prepare: Prepare, count: int, *, memory: int = 1 << 30, seconds: float = 10.0) -> list[str]:
    """Run cases 0 to `count` in child processes.

    Args:
        prepare: a function of a module's top level; it runs once in each child, without limits.
        count: number of cases.
        memory: bytes of address space that cases may take beyond what `prepare` took (Linux).
        seconds: seconds that a case may take.

    Returns:
        A line for each case that went wrong: by a signal, a hang, or an exception other than
        SupersamplerError. A child that died is followed by another for the cases that are left.
    """
    findings: list[str] = []
    first = 0
    with tempfile.TemporaryDirectory() as folder:
        while first < count and len(findings) < FINDINGS:
            report = Path(folder) / "report"
            work = Path(folder) / f"from{first}"
            work.mkdir()
            ended = _child(prepare, report, work, first, count, memory, seconds)
            lines = [json.loads(line) for line in report.read_text().splitlines()]
            findings += [f"case {line['case']}: {line['raised']}" for line in lines if "raised" in line]
            begun = [line["case"] for line in lines if "raised" not in line]
            if ended.returncode == 0:
                break
            if not begun:
                raise RuntimeError(f"prepare failed: {ended.stderr[-2000:]}")
            findings.append(f"case {begun[-1]}: {_end_of(ended)}")
            first = begun[-1] + 1
    return findings


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a file's bytes with a few changes: flipped, cut, zeroed, doubled, set to extreme numbers."""
    content = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(0, max(len(content), 1)))
        size = int(rng.integers(1, 17))
        match int(rng.integers(0, 7)):
            case 0 if content:
                content[at] ^= int(rng.integers(1, 256))
            case 1:
                del content[at:]
            case 2:
                content[at : at + size] = bytes(size)
            case 3:
                content[at:at] = content[at : at + 8 * size]
            case 4:
                del content[at : at + size]
            case 5:
                number = int(rng.choice([0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 0, 1, 0x40000000]))
                content[at : at + 4] = number.to_bytes(4, "little")
            case _:
                content[at:at] = rng.bytes(size)
    return bytes(content)


def replaced(value: Any, rng: np.random.Generator) -> Any:
    """Return a copy of a JSON value in which one value, at any depth, is another, gone, doubled or nested."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = list(value)[int(rng.integers(len(value)))]
        if rng.random() < 0.1:
            return {name: inner for name, inner in value.items() if name != key}
        return {**value, key: replaced(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.8:
        at = int(rng.integers(len(value)))
        match int(rng.integers(0, 6)):
            case 0:
                return value[:at] + value[at + 1 :]
            case 1:
                return [*value, value[at]]
            case _:
                return [*value[:at], replaced(value[at], rng), *value[at + 1 :]]
    if rng.random() < 0.05:
        for _ in range(int(rng.choice([2, 50, 500]))):
            value = [value] if rng.random() < 0.5 else {"a": value}
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool) and rng.random() < 0.3:
        return value + (1 if rng.random() < 0.5 else -1)
    return HOSTILE[int(rng.integers(len(HOSTILE)))]


def dumped(value: Any) -> bytes:
    """Return JSON; "[[[..." for a value that is too deep, or has a number of too many digits."""
    try:
        return json.dumps(value).encode()
    except (ValueError, RecursionError):
        return b"[" * 200_000


def with_other_numbers(data: bytes, rng: np.random.Generator, end: int) -> bytes:
    """Set one to three numbers before byte `end` to hostile ones: sizes, windows, counts, lengths."""
    content = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(8, min(len(content), end) - 8))
        number = NUMBERS[int(rng.integers(len(NUMBERS)))]
        content[at : at + 4] = number.to_bytes(4, "little", signed=True)
    return bytes(content)


def hostile_array(array: Any, rng: np.random.Generator) -> Any:
    """Return a similar array with other values, shape or type, or an unrelated value."""
    if array.dtype.kind not in "biuf" or array.size > 1 << 20:  # it has been changed before
        return array
    match int(rng.integers(0, 12)):
        case 0:
            return HOSTILE[int(rng.integers(len(HOSTILE)))]
        case 1:
            return array[tuple(slice(None, None, int(rng.choice([1, 1, 2, -1]))) for _ in array.shape)]
        case 2:
            return array[tuple(slice(int(rng.integers(0, 2)), None) for _ in array.shape)]
        case 3:
            return np.zeros([int(rng.choice([0, 1, 2, 3, 40, 80])) for _ in array.shape], array.dtype)
        case 4:
            with np.errstate(all="ignore"):
                return array.astype(rng.choice(["f2", "f8", "i1", "i8", "u8", ">f4", "O", "?", "c16"]))
        case 5:
            side = int(rng.choice([1, 1 << 12, 1 << 16, 1 << 20]))
            return np.broadcast_to(array[(0,) * array.ndim], tuple(side if n > 4 else n for n in array.shape))
        case 6:
            return np.ma.MaskedArray(array)
        case 7:
            return array.T
        case 8:
            return np.frombuffer(rng.bytes(array.nbytes), array.dtype).reshape(array.shape)
        case _:
            return with_extremes(array, rng)


def with_extremes(array: Any, rng: np.random.Generator) -> Any:
    """Return an array with one extreme value in some or all of its elements."""
    changed = array.copy()
    with np.errstate(all="ignore"):
        extreme = np.float64(EXTREMES[int(rng.integers(len(EXTREMES)))]).astype(array.dtype)
    changed[rng.random(array.shape) < rng.choice([0.01, 0.5, 1.0])] = extreme
    return changed


def _child(
    prepare: Prepare, report: Path, work: Path, first: int, count: int, memory: int, seconds: float
) -> subprocess.CompletedProcess[str]:
    given = [inspect.getfile(prepare), prepare.__name__, report, first, count, memory, seconds]
    report.write_text("")
    return subprocess.run(
        [sys.executable, __file__, *map(str, given)],
        check=False,
        capture_output=True,
        text=True,
        errors="replace",
        cwd=work,
        env={**os.environ, "TMPDIR": str(work)},
    )


def _end_of(ended: subprocess.CompletedProcess[str]) -> str:
    if ended.returncode < 0:
        return f"killed by {signal.Signals(-ended.returncode).name}: {ended.stderr[-300:]}"
    _, hung, stack = ended.stderr.partition("Timeout (")  # by faulthandler, the most recent call first
    return f"hung: {stack[:600]}" if hung else f"exit {ended.returncode}: {ended.stderr[-600:]}"


def _run(file: str, name: str, report: str, first: int, count: int, memory: int, seconds: float) -> None:
    """Run cases in this process, and report which began and which raised other errors than ours."""
    from supersampler.errors import SupersamplerError

    spec = importlib.util.spec_from_file_location(Path(file).stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    run = getattr(module, name)()
    _limit(memory)
    with Path(report).open("a", buffering=1) as log:
        for case in range(first, count):
            print(json.dumps({"case": case}), file=log)
            faulthandler.dump_traceback_later(seconds, exit=True)
            try:
                run(case)
            except SupersamplerError:
                pass
            except Exception as error:  # what is looked for
                last = traceback.extract_tb(error.__traceback__)[-1]
                text = (
                    f"{type(error).__name__}: {error}"[:300] + f" ({Path(last.filename).name}:{last.lineno})"
                )
                print(json.dumps({"case": case, "raised": text}), file=log)
            faulthandler.cancel_dump_traceback_later()


def _limit(memory: int) -> None:
    """Let the process take this many more bytes of address space."""
    if sys.platform == "linux":
        import resource

        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + memory, taken + memory))


if __name__ == "__main__":
    _, of, named, to, begin, end, room, limit = sys.argv
    _run(of, named, to, int(begin), int(end), int(room), float(limit))
