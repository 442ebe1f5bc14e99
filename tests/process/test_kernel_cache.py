"""A damaged cache of kernels costs a compilation, and nothing else."""

import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from apart import STEP, run_apart
from supersampler.backends.cpu.kernel_cache import (
    Kernel,
    cache_folder,
    make_writable,
    read_kernel,
    write_kernel,
)
from supersampler.backends.cpu.kernel_loader import load_kernels

KERNEL_NAME = "backends.cpu.kernels.frame.measure"
KERNEL = Kernel(KERNEL_NAME, "symbol", 3, b"\x7fELF machine code\n" * 9)


@pytest.fixture
def entry(tmp_path: Path) -> Path:
    write_kernel(tmp_path, KERNEL)
    (path,) = tmp_path.rglob("*.kernel")
    assert read_kernel(tmp_path, KERNEL.name) == KERNEL
    return path


def test_an_entry_cut_anywhere_counts_as_missing(entry: Path) -> None:
    content = entry.read_bytes()
    for length in range(len(content)):
        entry.write_bytes(content[:length])
        assert read_kernel(entry.parent, KERNEL.name) is None


def test_an_entry_with_any_bit_flipped_counts_as_missing(entry: Path) -> None:
    content = entry.read_bytes()
    for place in range(len(content)):
        entry.write_bytes(content[:place] + bytes([content[place] ^ 1 << place % 8]) + content[place + 1 :])
        assert read_kernel(entry.parent, KERNEL.name) is None


def test_zeros_a_folder_and_another_kernels_entry_count_as_missing(entry: Path) -> None:
    other = entry.with_name("backends.cpu.kernels.frame.prepare.kernel")
    shutil.copyfile(entry, other)
    assert read_kernel(entry.parent, "backends.cpu.kernels.frame.prepare") is None
    entry.write_bytes(bytes(entry.stat().st_size))
    assert read_kernel(entry.parent, KERNEL.name) is None
    entry.unlink()
    entry.mkdir()
    assert read_kernel(entry.parent, KERNEL.name) is None


@pytest.mark.parametrize("variable", ["HOME", "XDG_CACHE_HOME"])
def test_an_unreadable_home_folder_does_not_stop_a_run(
    monkeypatch: pytest.MonkeyPatch, variable: str, tmp_path: Path
) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv(variable, str(tmp_path))
    look = os.stat

    def refused(path: Any, *given: Any, **options: Any) -> Any:  # root may read everything
        if str(path).startswith(str(tmp_path)):
            raise PermissionError(13, "Permission denied")
        return look(path, *given, **options)

    for name in ("stat", "mkdir", "open", "access"):
        monkeypatch.setattr(os, name, refused)
    folder = cache_folder()
    assert folder.is_relative_to(tmp_path)
    assert not make_writable(folder)
    assert read_kernel(folder, KERNEL.name) is None


@pytest.mark.parametrize(("home", "cache"), [("~", ""), ("", "relative"), ("", "../x"), ("relative", "")])
def test_without_a_home_nothing_is_written_into_the_working_directory(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, home: str, cache: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", home)
    monkeypatch.setenv("XDG_CACHE_HOME", cache)
    assert not make_writable(cache_folder()) or not cache_folder().is_relative_to(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_kernels_are_compiled_anew_where_the_cache_is_damaged_and_draw_the_same(tmp_path: Path) -> None:
    code = f"""{STEP}
import hashlib
print(hashlib.sha256(upscaler("taa").step(noise(0)).tobytes()).hexdigest())
"""
    image = run_apart(code, XDG_CACHE_HOME=str(tmp_path)).stdout
    written = {path: path.read_bytes() for path in sorted(tmp_path.rglob("*.kernel"))}
    paths = list(written)
    assert len(paths) >= 6
    paths[0].write_bytes(b"")
    paths[1].write_bytes(written[paths[1]][:-100])
    paths[2].write_bytes(bytes(len(written[paths[2]])))
    paths[3].write_bytes(written[paths[4]])
    paths[5].write_bytes(written[paths[5]][:500] + b"\xff" + written[paths[5]][501:])
    paths[5].with_name(f".{paths[5].stem}.0123abcd.partial.kernel").touch()  # its writer was killed
    assert run_apart(code, XDG_CACHE_HOME=str(tmp_path)).stdout == image
    assert set(tmp_path.rglob("*.kernel")) == set(paths)
    for path, before in written.items():  # code may differ in what it is called by, headers may not
        header = len(b"supersampler kernel 2\n") + 32
        assert path.read_bytes()[header:].split(b" ")[0] == before[header:].split(b" ")[0]


def test_a_kernel_is_linked_once_in_a_process() -> None:
    first, second = load_kernels(KERNEL_NAME), load_kernels(KERNEL_NAME)
    assert first[KERNEL_NAME] is second[KERNEL_NAME]
