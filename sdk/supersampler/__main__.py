"""`python -m supersampler` is the `supersampler` command."""

from supersampler.cli import main

main()
