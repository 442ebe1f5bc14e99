# make demo   upscale the shipped shot, with runtime dependencies only; see out/compare.html
# make test   all tests
# make check  style and types
# make docs   the documentation as a site, out/site; a broken link or an undocumented public name fails
# make hashes compare every image of every method with bench/results/studies/hashes.json, bit for bit
# make fuzz   what is tested by chance, at length: SUPERSAMPLER_FUZZ cases of each kind of file and argument
# make mutation   changes of one place that no test notices: MUTATIONS=300 of them, MINUTES=60 at most, SEED=0
# PYTHON=python3.12 chooses the interpreter of new environments. On Windows: the pip lines in README.md.
PYTHON ?= python3

RUNTIME := .venv/installed
DEVELOPMENT := .venv-dev/installed
DOCS := .venv-docs/installed
SOURCES := $(shell find sdk model export bench -name '*.py' -o -name '*.html' -o -name '*.onnx' -o -name '*.json' -o -name '*.glsl')

.PHONY: demo test hashes fuzz mutation check docs clean

demo: $(RUNTIME)
	.venv/bin/supersampler demo -o out

# Two processes: threads of torch, in each, would wait for those of the other. Long files come early, as they lie.
test: $(DEVELOPMENT)
	OMP_NUM_THREADS=1 .venv-dev/bin/pytest -q --numprocesses 2 --dist loadscope --no-loadscope-reorder

hashes: $(DEVELOPMENT)
	.venv-dev/bin/python bench/studies/hashes.py --check bench/results/studies/hashes.json

fuzz: $(DEVELOPMENT)
	SUPERSAMPLER_FUZZ=$${SUPERSAMPLER_FUZZ:-2000} SUPERSAMPLER_INTERRUPTS=1500 SUPERSAMPLER_MODELS=3000 \
	    .venv-dev/bin/pytest -q tests/fuzz tests/process tests/sdk/test_arguments.py

mutation: $(DEVELOPMENT)
	PYTHONPATH=tests .venv-dev/bin/python -m mutation

check: $(DEVELOPMENT)
	.venv-dev/bin/ruff check .
	.venv-dev/bin/ruff format --check .
	.venv-dev/bin/mypy

docs: $(DOCS)
	NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --quiet

clean:
	rm -rf .venv .venv-dev .venv-docs out dist build .mypy_cache .pytest_cache .ruff_cache .hypothesis

# A copy of the package as users get it: made anew when a source changes.
$(RUNTIME): pyproject.toml $(SOURCES)
	test -d .venv || $(PYTHON) -m venv .venv
	.venv/bin/pip install -q --disable-pip-version-check .
	touch $@

# Editable: only new dependencies make it anew.
$(DEVELOPMENT): pyproject.toml
	test -d .venv-dev || $(PYTHON) -m venv .venv-dev
	.venv-dev/bin/pip install -q --disable-pip-version-check -e '.[dev]'
	touch $@

$(DOCS): pyproject.toml
	test -d .venv-docs || $(PYTHON) -m venv .venv-docs
	.venv-docs/bin/pip install -q --disable-pip-version-check -e '.[docs]'
	touch $@
