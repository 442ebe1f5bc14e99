"""One module owns each way out: to files, to programs, to the terminal.

A call elsewhere would not know whose a file is, would leave a program running, or print control codes.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OWNER = ROOT / "sdk" / "supersampler" / "io" / "files.py"
FOLDERS = ("sdk", "model", "export", "bench")
CHANGES = {
    "chmod", "copy2", "copyfile", "copytree", "hardlink_to", "move", "print_png", "remove", "removedirs",
    "rename", "renames", "replace", "rmdir", "rmtree", "save", "savefig", "savez", "savez_compressed",
    "symlink", "symlink_to", "touch", "truncate", "unlink", "write_bytes", "write_text",
}  # fmt: skip
"""Names of functions and methods that change files."""
IN_BLENDER = {"sdk/supersampler/integrations/blender/render_frames.py"}


def is_of_a_file(call: ast.Call, name: str) -> bool:
    """Whether a call of this name changes files: others have such names, too."""
    counts = len(call.args), len(call.keywords)
    match name:
        case "replace":  # str.replace has two arguments, that of dataclasses mostly keywords
            return counts == (1, 0) and isinstance(call.func, ast.Attribute)
        case "open" | "FileIO":
            modes = [*call.args, *(word.value for word in call.keywords if word.arg == "mode")]
            texts = [
                mode.value for mode in modes if isinstance(mode, ast.Constant) and isinstance(mode.value, str)
            ]
            return any(text and set(text) <= set("rwax+bt") and set(text) & set("wa+") for text in texts)
        case "write_bytes" | "write_text":  # as a function, that of the owner
            return isinstance(call.func, ast.Attribute)
        case "remove":  # of a list
            return isinstance(call.func, ast.Attribute) and ast.unparse(call.func.value) == "os"
        case "save" | "copy" | "move" | "touch" | "truncate":
            return isinstance(call.func, ast.Attribute) and ast.unparse(call.func.value) in {
                "np", "numpy", "torch", "shutil", "os", "onnx", "onnx.save",
            }  # fmt: skip
    return name in CHANGES


def temporary_names(function: ast.AST) -> set[str]:
    """Names of files that `replacing` renames only when they are whole, and of streams in memory."""
    found = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Assign) and ast.unparse(node.value) == "io.BytesIO()":
            found.add(ast.unparse(node.targets[0]))
        for item in node.items if isinstance(node, ast.With) else ():
            if (
                isinstance(item.context_expr, ast.Call)
                and ast.unparse(item.context_expr.func).endswith("replacing")
                and isinstance(item.optional_vars, ast.Name)
            ):
                found.add(item.optional_vars.id)
    return found


def changes(code: str) -> Iterator[tuple[int, str]]:
    """Line and text of each call that changes files, but those on temporary names."""
    tree = ast.parse(code)
    temporary = temporary_names(tree)
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        name = call.func.attr if isinstance(call.func, ast.Attribute) else ast.unparse(call.func)
        values = [call.func.value] if isinstance(call.func, ast.Attribute) else []
        used = {ast.unparse(value) for value in (*values, *call.args)}
        if is_of_a_file(call, name) and not used & {*temporary, *(f"str({one})" for one in temporary)}:
            yield call.lineno, ast.unparse(call)[:90]


PROGRAMS = {
    "sdk/supersampler/io/child_process.py",
    "sdk/supersampler/integrations/blender/extension/run.py",  # runs in Blender, without the package
}
TERMINAL = {
    "sdk/supersampler/cli/terminal.py",
}


def calls(folder: str, *names: str) -> set[str]:
    """Modules of the packages that call one of these functions."""
    return {
        file.relative_to(ROOT).as_posix()
        for file in sorted((ROOT / folder).rglob("*.py"))
        if "studies" not in file.parts
        for call in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(call, ast.Call) and ast.unparse(call.func) in names
    }


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_other_module_starts_programs(folder: str) -> None:
    names = ("Popen", "run", "call", "check_call", "check_output")
    found = calls(folder, *(f"subprocess.{name}" for name in names), "os.system", "os.popen", "os.execv")
    assert found <= PROGRAMS


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_other_module_prints(folder: str) -> None:
    found = calls(
        folder, "print", "typer.echo", "click.echo", "Console", "sys.stdout.write", "sys.stderr.write"
    )
    assert found <= TERMINAL


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_other_module_writes_renames_or_removes_files(folder: str) -> None:
    found = [
        f"{file.relative_to(ROOT)}:{line}: {text}"
        for file in sorted((ROOT / folder).rglob("*.py"))
        if file != OWNER and file.relative_to(ROOT).as_posix() not in IN_BLENDER
        for line, text in changes(file.read_text("utf-8"))
    ]
    assert found == []


def test_calls_that_change_files_are_found() -> None:
    code = """
shutil.rmtree(folder, ignore_errors=True)
path.unlink()
partial.replace(path)
path.open("w")
open(path, mode="ab")
np.savez(path, a=a)
with replacing(path) as own:
    own.write_text("")
    np.save(own, a)
text.replace("a", "b")
path.open("rb")
"""
    assert [line for line, _ in changes(code)] == [2, 3, 4, 5, 6, 7]
