"""Hooks of mkdocs: pages that are generated from the code, linked files of the repository, and a check.

The API page lists the names in every package's `__all__`; the CLI page has the help text of every command.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from mkdocstrings import Inventory
from typer.core import TyperGroup
from typer.main import get_command

from supersampler.cli import app

ROOT = Path(__file__).parents[1]
SOURCES = (  # `supersampler` must be first
    "sdk/supersampler",
    "model/supersampler_model",
    "export/supersampler_export",
    "bench/supersampler_bench",
)
OUTSIDE = re.compile(r"\]\((?P<up>(?:\.\./)+)(?P<path>[\w./-]+)(?P<anchor>#[\w-]*)?\)")
"""A Markdown link to a path above the page's folder."""
CONTRIBUTING = "contributing.md"
"""Page of CONTRIBUTING.md."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, CONTRIBUTING.md, and the linked files outside docs/."""
    files.append(File.generated(config, "reference/api.md", content=api_page()))
    files.append(File.generated(config, "reference/cli.md", content=cli_page()))
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    contributing = re.sub(r"\]\((?!https?:|#)", "](../", contributing).replace("](../docs/", "](")
    files.append(File.generated(config, CONTRIBUTING, content=contributing))
    linked = {path for page in files.documentation_pages() for path in outside_links(page)}
    for path in sorted(linked - {"CONTRIBUTING.md"}):
        files.append(File.generated(config, f"repository/{path}", abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Change links to files outside docs/ to their copies in the site."""
    depth = page.file.src_uri.count("/")

    def replaced(link: re.Match[str]) -> str:
        if link["up"].count("../") <= depth:
            return link[0]
        target = CONTRIBUTING if link["path"] == "CONTRIBUTING.md" else f"repository/{link['path']}"
        return f"]({'../' * depth}{target}{link['anchor'] or ''})"

    return OUTSIDE.sub(replaced, markdown)


def on_post_build(config: MkDocsConfig) -> None:
    """Raise PluginError if a name in a package's `__all__` is not on the site."""
    with (Path(config.site_dir) / "objects.inv").open("rb") as file:
        documented = Inventory.parse_sphinx(file)
    missing = [
        f"{package}.{name}"
        for package, names in public_packages()
        for name in names
        if f"{package}.{name}" not in documented
    ]
    if missing:
        raise PluginError(f"public names without documentation: {', '.join(missing)}")


def outside_links(page: File) -> Iterator[str]:
    """Yield the paths, relative to the repository, of files outside docs/ that a page links to."""
    depth = page.src_uri.count("/")
    for link in OUTSIDE.finditer(page.content_string):
        if link["up"].count("../") == depth + 1 and (ROOT / link["path"]).is_file():
            yield link["path"]


def public_packages() -> list[tuple[str, list[str]]]:
    """Return every package with `__all__` and its names. Names of `supersampler` are only listed there."""
    found: list[tuple[str, list[str]]] = []
    for source in SOURCES:
        for path in sorted((ROOT / source).rglob("__init__.py")):
            names = names_in_all(ast.parse(path.read_text(encoding="utf-8")))
            if found and source == SOURCES[0]:
                names = [name for name in names if name not in found[0][1]]
            if names:
                package = path.parent.relative_to((ROOT / source).parent)
                found.append((".".join(package.parts), names))
    return found


def names_in_all(module: ast.Module) -> list[str]:
    """Return the names in a module's `__all__`."""
    for statement in module.body:
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "__all__":
            return sorted(ast.literal_eval(statement.value))
    return []


def api_page() -> str:
    """Return a section for each package, with an entry for each public name."""
    lines = ["# API", "", "All public names, by the package to import them from.", ""]
    for package, names in public_packages():
        lines += [f"## {package}", ""]
        for name in names:
            lines += [f"::: {package}.{name}", "    options: {heading_level: 3}", ""]
    return "\n".join(lines)


def cli_page() -> str:
    """Return the help texts of `supersampler` and of all its commands."""
    lines = ["# Command line", "", "The output of `--help` for every command.", ""]
    for title, text in help_texts(get_command(app), "supersampler", None):
        lines += [f"## {title}", "", "```text", text, "```", ""]
    return "\n".join(lines)


def help_texts(command: Any, name: str, parent: Any) -> Iterator[tuple[str, str]]:
    """Yield the full name and the help text of a command and of its subcommands, depth first."""
    command.rich_markup_mode = None  # returns plain text instead of printing
    context = command.context_class(command, info_name=name, parent=parent, max_content_width=100)
    yield context.command_path, command.get_help(context).strip()
    for child in command.list_commands(context) if isinstance(command, TyperGroup) else ():
        resolved = command.resolve_command(context, [child])[1]  # imports train, export, bench, render
        yield from help_texts(resolved, child, context)
