"""The host in C of examples/c_webgpu, compiled against the headers and the library of Python's wgpu.

On the stub of fuzz/c_host instead of the library it runs without a GPU, and computes nothing.
"""

import shutil
import subprocess
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[1] / "examples" / "c_webgpu"
STUB = Path(__file__).parent / "fuzz" / "c_host"
CJSON = [Path(folder) / "cjson" / "cJSON.h" for folder in ("/usr/include", "/usr/local/include")]
SANITIZERS = "address,undefined,float-cast-overflow"


def built_or_skip(out: Path) -> Path:
    """Return the program, compiled into a folder; skip the test where a compiler or cJSON is missing."""
    _skip_without("cc", "make")
    library = _wgpu()
    variables = [f"OUT={out}", f"WGPU={library.parent}", f"LIBRARY={library.name}", "CFLAGS=-Werror -O1"]
    _run("make", "-C", EXAMPLE, *variables)
    return out / "upscale"


def stubbed_or_skip(out: Path) -> Path:
    """Return the program on the stub, with sanitizers; skip the test where a compiler or cJSON is missing."""
    _skip_without("cc")
    return _compiled("cc", SANITIZERS, [*EXAMPLE.glob("*.c"), STUB / "wgpu_stub.c"], out / "upscale")


def fuzzer_or_skip(out: Path) -> Path:
    """Return the fuzz target; skip the test where clang, its libFuzzer or cJSON is missing."""
    _skip_without("clang")
    host = [file for file in EXAMPLE.glob("*.c") if file.name != "main.c"]
    sanitizers = f"fuzzer,{SANITIZERS}"
    hooks = ["-include", str(STUB / "hooks.h")]
    return _compiled("clang", sanitizers, [*host, *STUB.glob("*.c")], out / "fuzz", hooks)


def _skip_without(*programs: str) -> None:
    missing = [name for name in programs if shutil.which(name) is None]
    missing += [] if any(header.is_file() for header in CJSON) else ["cJSON (Debian: libcjson-dev)"]
    if missing:
        pytest.skip(f"not here: {', '.join(missing)}")


def _wgpu() -> Path:
    folder = files("wgpu") / "resources"
    return Path(str(next(file for file in folder.iterdir() if "release" in file.name)))


def _compiled(
    compiler: str,
    sanitizers: str,
    sources: Sequence[Path],
    out: Path,
    more: Sequence[str] = (),
) -> Path:
    instrumented = ["-g", "-O1", f"-fsanitize={sanitizers}", "-fno-sanitize-recover=all"]
    probe = out.with_suffix(".c")
    name = "LLVMFuzzerTestOneInput(const char *d, unsigned long s) { (void)d, (void)s;"
    probe.write_text(f"int {name if 'fuzzer' in sanitizers else 'main(void) {'} return 0; }}\n")
    found = subprocess.run(
        [compiler, *instrumented, probe, "-o", out], check=False, capture_output=True, text=True
    )
    if found.returncode != 0:
        pytest.skip(f"{compiler} has no -fsanitize={sanitizers}: {found.stderr.strip()[-200:]}")
    warnings = ["-std=gnu99", "-Wall", "-Wextra", "-Werror"]
    include = [f"-I{EXAMPLE}", "-isystem", str(_wgpu().parent)]
    _run(compiler, *warnings, *instrumented, *more, *include, *sources, "-lcjson", "-lm", "-o", out)
    return out


def _run(*command: str | Path) -> None:
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
