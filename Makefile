# make demo   upscale the shipped shot, with runtime dependencies only; see out/compare.html
# make test   most tests, in minutes
# make test-all   all tests, as on merge: also random inputs, processes, examples, the GPU backend on software Vulkan
# make check  style and types
# make records  measures all published records whose models have changed since, and rewrites the tables: hours
# make docs   the documentation as a site, out/site; a broken link or an undocumented public name fails
# make hashes compare every image of every method with bench/hashes.json, bit for bit
# make fuzz   long tests on random files and arguments: SUPERSAMPLER_FUZZ cases of each kind
# make wheels wheels for Linux, macOS and Windows from this machine, checked: dist
# make kit     dist/measuring-kit: measures the GPU of a machine that has Python KIT_PYTHON=3.12 on Linux and no network
# make emulators  the CPU library compiled for arm64 and Windows, its tests run by QEMU and Wine
# make sanitize  the tests of the CPU library in C, under the sanitizers of clang: memory, undefined behaviour, threads
# make fuzz-native  frames, models and images of any bytes for the CPU library, by clang's libFuzzer: SECONDS=60 for each
# make traces  the graph of every shipped method is what the exporter writes today, and docs/how-to/add-a-method.md adds one
# make mutation   changes of one place that no test notices: MUTATIONS=300 of them, MINUTES=60 at most, SEED=0
# make test-integrations   tests with other programs, each where it can be installed: blender to webgpu below
# make extension   the extension for Blender 4.2 and later: dist/supersampler_blender.zip
# make blender   tests with Blender: bpy from PyPI, for Python 3.11, or SUPERSAMPLER_BLENDER=/path/of/blender
# make pyvista   tests with PyVista from PyPI; software OpenGL is enough
# make mitsuba   the examples with Mitsuba from PyPI; one of them needs the system's LLVM
# make oidn    tests with Open Image Denoise: pyoidn from PyPI
# make pygfx   examples/pygfx_live.py with pygfx from PyPI; software Vulkan is enough
# make mujoco  examples/mujoco_cameras.py with MuJoCo from PyPI: software OpenGL is enough, by EGL or OSMesa
# make vtk-cpp  examples/vtk_cpp with Debian's libvtk9-dev, xvfb and xauth
# make webgpu  exported shaders in Node with Dawn, from npm
# make web     the page of `demo --web` in Chromium (Debian's chromium, or SUPERSAMPLER_CHROMIUM), with three.js from npm; then:
# make three   the node for three.js beside three.js' own ones: a record, and table and figure in docs/tutorials/web.md
# make cpp   examples/cpp_onnxruntime, compiled and run on the whole shipped shot; fetches headers from Debian
# PYTHON=python3.12 chooses the interpreter of new environments. On Windows: the pip lines in README.md.
PYTHON ?= python3

RUNTIME := .venv/installed
DEVELOPMENT := .venv-dev/installed
DOCS := .venv-docs/installed
SOURCES := $(shell find sdk model export bench examples/web -name '*.py' -o -name '*.html' -o -name '*.onnx' -o -name '*.json' -o -name '*.glsl' -o -name '*.wgsl' -o -name '*.js' -o -name '*.cpp' -o -name '*.h' -o -name '*.model' -o -name CMakeLists.txt)

C_SOURCES = $(wildcard $(foreach folder,sdk/native/* sdk/native/*/* examples/* tests/fuzz/c_host,$(addprefix $(folder)/,*.c *.cpp *.h)))

EXTENSION := sdk/supersampler/integrations/blender/extension

.PHONY: demo extension test test-all hashes fuzz wheels kit emulators sanitize hostile fuzz-native traces mutation check records docs clean test-integrations blender pyvista mitsuba oidn pygfx mujoco vtk-cpp webgpu web web-tests three cpp

demo: $(RUNTIME)
	.venv/bin/supersampler demo -o out

# Else every process compiles all modules of the tests again.
unexport PYTHONDONTWRITEBYTECODE

# Two processes: threads of torch, in each, would wait for those of the other. Long files come early, as they lie.
PYTEST := OMP_NUM_THREADS=1 .venv-dev/bin/pytest -q --numprocesses 2 --dist loadscope --no-loadscope-reorder

test: $(DEVELOPMENT)
	$(PYTEST) -m 'not long'

test-all: $(DEVELOPMENT)
	$(PYTEST)

extension:
	mkdir -p dist
	cd $(EXTENSION) && $(PYTHON) -m zipfile -c $(CURDIR)/dist/supersampler_blender.zip __init__.py run.py blender_manifest.toml

test-integrations: blender pyvista mitsuba oidn pygfx mujoco vtk-cpp webgpu

# Blender's own Python, with its numpy: apart from ours. Where bpy cannot be installed, the tests say that they are skipped.
blender: $(DEVELOPMENT) extension
	test -n "$$SUPERSAMPLER_BLENDER" -o -x .venv-blender/bin/python || $(PYTHON) -m venv .venv-blender
	test -n "$$SUPERSAMPLER_BLENDER" || .venv-blender/bin/python -c 'import bpy' 2>/dev/null \
	    || .venv-blender/bin/pip install -q --disable-pip-version-check 'bpy==4.5.*' \
	    || rm -rf .venv-blender
	test -n "$$SUPERSAMPLER_BLENDER" || ! test -d .venv-blender \
	    || export SUPERSAMPLER_BLENDER=$(CURDIR)/.venv-blender/bin/python; \
	    .venv-dev/bin/pytest -q -rs --timeout=1800 tests/integrations/test_blender.py

pyvista: $(DEVELOPMENT)
	test -d .venv-pyvista || $(PYTHON) -m venv .venv-pyvista
	.venv-pyvista/bin/python -c 'import pyvista, sympy, trame_pyvista, supersampler, pytest_timeout' 2>/dev/null \
	    || .venv-pyvista/bin/pip install -q --disable-pip-version-check -e . pytest pytest-timeout hypothesis sympy 'pyvista>=0.45' trame-pyvista trame-vuetify
	.venv-pyvista/bin/pytest -q -rs --timeout=1800 tests/integrations/test_pyvista.py

mitsuba: $(DEVELOPMENT)
	test -d .venv-mitsuba || $(PYTHON) -m venv .venv-mitsuba
	.venv-mitsuba/bin/python -c 'import mitsuba, pyoidn, supersampler, pytest_timeout' 2>/dev/null \
	    || .venv-mitsuba/bin/pip install -q --disable-pip-version-check -e '.[denoise]' pytest pytest-timeout hypothesis mitsuba
	.venv-mitsuba/bin/pytest -q -rs --timeout=1800 tests/integrations/test_mitsuba.py

oidn: $(DEVELOPMENT)
	test -d .venv-oidn || $(PYTHON) -m venv .venv-oidn
	.venv-oidn/bin/python -c 'import pyoidn, supersampler, pytest_timeout' 2>/dev/null \
	    || .venv-oidn/bin/pip install -q --disable-pip-version-check -e '.[denoise]' pytest pytest-timeout hypothesis
	.venv-oidn/bin/pytest -q -rs --timeout=1800 tests/integrations/test_oidn.py

pygfx: $(DEVELOPMENT)
	test -d .venv-pygfx || $(PYTHON) -m venv .venv-pygfx
	.venv-pygfx/bin/python -c 'import pygfx, supersampler, pytest_timeout' 2>/dev/null \
	    || .venv-pygfx/bin/pip install -q --disable-pip-version-check -e '.[gpu]' pytest pytest-timeout hypothesis pygfx
	.venv-pygfx/bin/pytest -q -rs --timeout=1800 tests/integrations/test_pygfx.py

mujoco: $(DEVELOPMENT)
	test -d .venv-mujoco || $(PYTHON) -m venv .venv-mujoco
	.venv-mujoco/bin/python -c 'import mujoco, supersampler, pytest_timeout' 2>/dev/null \
	    || .venv-mujoco/bin/pip install -q --disable-pip-version-check -e . pytest pytest-timeout hypothesis 'mujoco>=3.3'
	.venv-mujoco/bin/pytest -q -rs --timeout=1800 tests/integrations/test_mujoco.py

vtk-cpp: $(DEVELOPMENT)
	.venv-dev/bin/pytest -q -rsP --timeout=1800 tests/integrations/test_vtk_cpp.py

# Dawn refuses Mesa's software adapter before 23; Chromium's SwiftShader, if it is there, is taken for it.
DAWN_ICD ?= $(firstword $(wildcard /usr/lib/chromium/vk_swiftshader_icd.json))

webgpu: $(DEVELOPMENT)
	npm ci --prefix examples/node_dawn --ignore-scripts --no-audit --no-fund
	SUPERSAMPLER_DAWN_ICD=$(DAWN_ICD) .venv-dev/bin/pytest -q -rs --timeout=1800 tests/integrations/test_webgpu.py

# Without npm the tests of three.js are skipped, with the reason.
NODE := .node/node_modules

web: web-tests three

web-tests:
	test -d .venv-web || $(PYTHON) -m venv .venv-web
	.venv-web/bin/python -c 'import playwright, wgpu, supersampler, pytest_timeout, ziglang' 2>/dev/null \
	    || .venv-web/bin/pip install -q --disable-pip-version-check -e '.[gpu]' pytest pytest-timeout hypothesis playwright \
	        'ziglang>=0.16,<0.18'
	.venv-web/bin/python sdk/native/build.py wasm
	mkdir -p .node
	test -d $(NODE)/three || npm install --silent --no-save --prefix .node three@$$(.venv-web/bin/python -c \
	    'from supersampler.integrations.web import THREE_VERSION; print(THREE_VERSION)') || true
	test ! -d $(NODE)/three || export SUPERSAMPLER_NODE_MODULES=$(CURDIR)/$(NODE); \
	    .venv-web/bin/pytest -q -rsP --timeout=1800 tests/integrations/test_web_page_in_chromium.py \
	    tests/integrations/test_npm_package.py tests/integrations/test_docs_site.py

# Rewrites bench/results/three.json, its table and its picture in docs/tutorials/web.md.
three: web-tests $(DEVELOPMENT)
	test ! -d $(NODE)/three || PYTHONPATH=tests .venv-web/bin/python docs/images/three_js.py $(NODE)
	.venv-dev/bin/supersampler bench tables

# Needs CMake and a C++ compiler. Afterwards `make test` runs these tests, too, on fewer frames.
cpp: $(DEVELOPMENT)
	test -e .onnxruntime/lib/libonnxruntime.so || sh examples/cpp_onnxruntime/get_onnxruntime.sh .onnxruntime .venv-dev/bin/python
	SUPERSAMPLER_CPP_FRAMES=32 .venv-dev/bin/pytest -q -rs --timeout=1800 tests/integrations/test_cpp_onnxruntime.py

hashes: $(DEVELOPMENT)
	.venv-dev/bin/supersampler bench hashes --check bench/hashes.json

fuzz: $(DEVELOPMENT)
	SUPERSAMPLER_FUZZ=$${SUPERSAMPLER_FUZZ:-2000} SUPERSAMPLER_INTERRUPTS=1500 SUPERSAMPLER_KILLS=200 SUPERSAMPLER_MODELS=3000 \
	    .venv-dev/bin/pytest -q --timeout=14400 tests/fuzz tests/process tests/sdk/test_arguments.py

WHEELS := PATH="$(CURDIR)/.venv-wheels/bin:$$PATH" .venv-wheels/bin/python sdk/native/wheels.py

.venv-wheels/installed:
	test -d .venv-wheels || $(PYTHON) -m venv .venv-wheels
	.venv-wheels/bin/pip install -q --disable-pip-version-check hatchling cmake ninja 'ziglang>=0.16,<0.18' 'lief>=0.16'
	touch $@

wheels: .venv-wheels/installed
	mkdir -p dist
	$(WHEELS) dist

# ONNX Runtime is left out: the kit is to be small, and uses the one of the machine, if it has one.
KIT_PYTHON ?= 3.12
KIT := dist/measuring-kit
kit: .venv-wheels/installed
	rm -rf $(KIT) && mkdir -p $(KIT)/wheels
	$(WHEELS) $(KIT)/wheels manylinux-x86_64
	.venv-wheels/bin/pip download -q --disable-pip-version-check -d $(KIT)/wheels --only-binary=:all: \
	    --python-version $(KIT_PYTHON) --implementation cp --platform manylinux_2_28_x86_64 \
	    --platform manylinux_2_27_x86_64 --platform manylinux_2_17_x86_64 --platform manylinux2014_x86_64 \
	    numpy msgspec typer rich OpenImageIO 'wgpu>=0.32'
	cp bench/measuring_kit/measure.sh $(KIT)/
	du -sh $(KIT)

SANITIZED := cmake -S sdk/native -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ -DCMAKE_BUILD_TYPE=Debug "-DCMAKE_CXX_FLAGS_DEBUG=-O1 -g1"

sanitize:
	for kind in address,undefined thread; do \
	    $(SANITIZED) -B build/$$kind -DSS_SANITIZE=$$kind && cmake --build build/$$kind --parallel $$(nproc) \
	        && ctest --test-dir build/$$kind --output-on-failure || exit 1; \
	done

# Ten million hostile values for each method on each instruction set that this CPU has.
hostile:
	cmake -S sdk/native -B build/tests && cmake --build build/tests --parallel $$(nproc)
	SS_HOSTILE=1300 build/tests/test_api

SECONDS ?= 60

fuzz-native:
	$(SANITIZED) -B build/fuzz -DSS_SANITIZE=address,undefined -DSS_FUZZ=ON
	cmake --build build/fuzz --parallel $$(nproc)
	for name in step model state images; do \
	    mkdir -p build/fuzz/corpus/$$name && build/fuzz/fuzz_$$name -max_total_time=$(SECONDS) -max_len=120000 \
	        -artifact_prefix=build/fuzz/$$name- build/fuzz/corpus/$$name $$(test $$name != model || echo sdk/native/models) || exit 1; \
	done

# Minutes for each platform; QEMU or Wine must be there.
emulators: $(DEVELOPMENT)
	.venv-dev/bin/pip install -q --disable-pip-version-check 'ziglang>=0.16,<0.18'
	.venv-dev/bin/pytest -q -rs tests/integrations/test_other_platforms.py

traces: $(DEVELOPMENT)
	SUPERSAMPLER_TRACES=all .venv-dev/bin/pytest -q --timeout=1800 tests/export tests/process/test_add_a_method.py

mutation: $(DEVELOPMENT)
	PYTHONPATH=tests .venv-dev/bin/python -m mutation

check: $(DEVELOPMENT)
	.venv-dev/bin/ruff check .
	.venv-dev/bin/ruff format --check .
	.venv-dev/bin/clang-format --dry-run --Werror $(C_SOURCES)
	.venv-dev/bin/mypy

# Hours; nothing else should run. Ctrl-C stops it, and the same command continues.
records: $(DEVELOPMENT)
	.venv-dev/bin/supersampler bench records
	.venv-dev/bin/supersampler bench tables

docs: $(DOCS)
	NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --quiet

clean:
	rm -rf .venv .venv-* .node .onnxruntime examples/node_dawn/node_modules out dist build .mypy_cache .pytest_cache .ruff_cache .hypothesis

# A copy of the package as users get it: made anew when a source changes.
$(RUNTIME): pyproject.toml $(SOURCES)
	test -d .venv || $(PYTHON) -m venv .venv
	.venv/bin/pip install -q --disable-pip-version-check .
	touch $@

# Editable: only new dependencies make it anew. Python compiles what it imports; pip would compile all of torch.
$(DEVELOPMENT): pyproject.toml
	test -d .venv-dev || $(PYTHON) -m venv .venv-dev
	.venv-dev/bin/pip install -q --no-compile --disable-pip-version-check -e '.[dev]'
	touch $@

$(DOCS): pyproject.toml
	test -d .venv-docs || $(PYTHON) -m venv .venv-docs
	.venv-docs/bin/pip install -q --disable-pip-version-check -e '.[docs]'
	touch $@
