"""The `supersampler` command: one function per command, which imports its dependencies when it runs.

Exit code 1: an error of this package or the file system, printed as one line on stderr. Exit code 2: wrong
arguments, a value included. Exit code 130: Ctrl-C. Other errors are bugs and keep their traceback.
"""

from supersampler.cli.app import TOOLS, app, main
from supersampler.cli.blender import blender
from supersampler.cli.demo import demo
from supersampler.cli.denoise import denoise
from supersampler.cli.replay import replay
from supersampler.cli.shots import check, import_shot, info
from supersampler.cli.upscale import upscale

for command in (demo, upscale, denoise, blender, info, check, replay):
    app.command()(command)
app.command("import")(import_shot)
for name, (_, text) in TOOLS.items():
    app.command(name, help=text)(lambda: None)

__all__ = ["app", "main"]
