"""The host in C of examples/c_webgpu, compiled against the headers and the library of Python's wgpu."""

import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[1] / "examples" / "c_webgpu"
CJSON = [Path(folder) / "cjson" / "cJSON.h" for folder in ("/usr/include", "/usr/local/include")]


def built_or_skip(out: Path) -> Path:
    """Return the program, compiled into a folder; skip the test where a compiler or cJSON is missing."""
    missing = [name for name in ("cc", "make") if shutil.which(name) is None]
    missing += [] if any(header.is_file() for header in CJSON) else ["cJSON (Debian: libcjson-dev)"]
    if missing:
        pytest.skip(f"not here: {', '.join(missing)}")
    library = next(file for file in (files("wgpu") / "resources").iterdir() if "release" in file.name)
    folder = Path(str(library)).parent
    variables = [f"OUT={out}", f"WGPU={folder}", f"LIBRARY={library.name}", "CFLAGS=-Werror -O1"]
    command = ["make", "-C", str(EXAMPLE), *variables]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out / "upscale"
