"""Program for maintainers, in no wheel: hashes of all images, `python bench/studies/hashes.py --help`."""
