"""Hooks of mkdocs: pages made from the code, files of the repository that pages link to, and one check.

The API page lists every package that has `__all__`; the CLI page is the help text of every command.
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
SOURCES = (  # `supersampler` first
    "sdk/supersampler",
    "model/supersampler_model",
    "export/supersampler_export",
    "bench/supersampler_bench",
)
OUTSIDE = re.compile(r"\]\((?P<up>(?:\.\./)+)(?P<path>[\w./-]+)(?P<anchor>#[\w-]*)?\)")
"""A Markdown link that leaves the folder of its page upwards."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, CONTRIBUTING.md, and the linked files outside docs/."""
    files.append(File.generated(config, "reference/api.md", content=api_page()))
    files.append(File.generated(config, "reference/cli.md", content=cli_page()))
    files.append(File.generated(config, "reference/c-header.md", content=header_page()))
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    contributing = re.sub(r"\]\((?!https?:|#)", "](../", contributing).replace("](../docs/", "](")
    files.append(File.generated(config, "contributing.md", content=contributing))
    for path in sorted({path for page in files.documentation_pages() for path in outside_links(page)}):
        files.append(File.generated(config, f"repository/{path}", abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Point links to files outside docs/ at their copies in the site."""
    depth = page.file.src_uri.count("/")

    def replaced(link: re.Match[str]) -> str:
        if link["up"].count("../") <= depth:
            return link[0]
        return f"]({'../' * depth}repository/{link['path']}{link['anchor'] or ''})"

    return OUTSIDE.sub(replaced, markdown)


def on_post_build(config: MkDocsConfig) -> None:
    """Fail where a name of a package's `__all__` is not on the site.

    Raises:
        PluginError: names are missing; the message lists them.
    """
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
    """Paths, relative to the repository, of files outside docs/ that a page links to."""
    depth = page.src_uri.count("/")
    for link in OUTSIDE.finditer(page.content_string):
        if link["up"].count("../") == depth + 1 and (ROOT / link["path"]).is_file():
            yield link["path"]


def public_packages() -> list[tuple[str, list[str]]]:
    """Every package that has `__all__`, with its names. What `supersampler` offers is listed there alone."""
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
    """The names of a module's `__all__`; none where it has no such list."""
    for statement in module.body:
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "__all__":
            return sorted(ast.literal_eval(statement.value))
    return []


def api_page() -> str:
    """One section for each package, one entry for each public name."""
    lines = ["# API", "", "Every public name, by the package that it is imported from.", ""]
    for package, names in public_packages():
        lines += [f"## {package}", ""]
        for name in names:
            lines += [f"::: {package}.{name}", "    options: {heading_level: 3}", ""]
    return "\n".join(lines)


def header_page() -> str:
    """The header of the CPU library."""
    header = (ROOT / "sdk/native/include/supersampler.h").read_text(encoding="utf-8")
    return f"# supersampler.h\n\nThe header of the CPU library, in C99.\n\n```c\n{header}```\n"


def cli_page() -> str:
    """The help text of `supersampler` and of all its commands."""
    lines = ["# Command line", "", "What `--help` prints, for every command.", ""]
    for title, text in help_texts(get_command(app), "supersampler", None):
        lines += [f"## {title}", "", "```text", text, "```", ""]
    return "\n".join(lines)


def help_texts(command: Any, name: str, parent: Any) -> Iterator[tuple[str, str]]:
    """Full name and help text of a command and of its subcommands, depth first."""
    command.rich_markup_mode = None  # plain text, returned and not printed
    context = command.context_class(command, info_name=name, parent=parent, max_content_width=100)
    yield context.command_path, command.get_help(context).strip()
    for child in command.list_commands(context) if isinstance(command, TyperGroup) else ():
        resolved = command.resolve_command(context, [child])[1]  # imports train, export, bench, render
        yield from help_texts(resolved, child, context)
