"""`python -m supersampler` runs the `supersampler` command."""

from supersampler.cli import main

main()
