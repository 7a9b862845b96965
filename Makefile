# In a fresh clone `make demo` and `make test` install missing dependencies, build changes, and run.
PYTHON ?= python3
VENV ?= .venv
JOBS ?= $(shell nproc)
# clang-tidy checks only sources changed since this commit; empty: all
TIDY_SINCE ?=
# ON: compiler warnings are errors (as in CI)
WERROR ?= OFF

build := build/make
bin := $(VENV)/bin
study := PYTHONPATH=bench $(bin)/python -m studies
python_sources := python web/make_demo.py docs/conf.py docs/programs docs/stand-ins examples/gallery tests scripts/requirements scripts/check-wheel scripts/sbom scripts/compare_benchmarks bench
cpp_files = $(shell git ls-files --cached --others --exclude-standard '*.cpp' '*.hpp')
# Folders too: their time changes when a source is added or removed. And the log of commits: the build contains its commit.
native := CMakeLists.txt cpp/CMakeLists.txt python/CMakeLists.txt $(shell find cpp/include cpp/src cpp/cmake python/bindings) \
  $(wildcard $(shell git rev-parse --git-path logs/HEAD 2>/dev/null))

# All sources, or those changed since a commit; a list that git cannot make is an error (a clone without that commit, a
# folder of another owner). One SIMD target represents all, since they share one source.
tidied = $(if $(filter cpp/src/%.cpp,$(cpp_files)),,$(error clang-tidy: git lists no sources in $(CURDIR)))$(if \
  $(if $(TIDY_SINCE),$(shell git rev-parse -q --verify '$(TIDY_SINCE)^{commit}'),all),,$(error \
  TIDY_SINCE: got $(TIDY_SINCE), which is no commit of this clone))$(filter cpp/src/%.cpp,$(if $(TIDY_SINCE),$(shell git diff --name-only --diff-filter=d $(TIDY_SINCE)),$(cpp_files)))
# Its compile commands name no precompiled header: clang reads no other compiler's.
tidy = cmake -S . -B build/tidy -DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON >/dev/null && printf '%s\n' $(tidied) | \
  xargs -r -P $(JOBS) -n 1 clang-tidy-14 -p build/tidy --quiet --warnings-as-errors='*' \
  --extra-arg=-DHWY_COMPILE_ONLY_STATIC 2>/dev/null

# of fuzzing, for each target
SECONDS ?= 60
# of the long run in all, and of mutants of the packet code
FRAMES ?= 1000000
MUTANTS ?= 300

export PYTHON
export CMAKE_BUILD_PARALLEL_LEVEL ?= $(JOBS)
export PIP_DISABLE_PIP_VERSION_CHECK ?= 1

.DELETE_ON_ERROR:
.PHONY: help demo test docs docs-links gstreamer web chart limits reproduce nightly fuzz soak coverage mutants lint lint-python lint-cpp format clean build cpp-build cpp-test packages standalone wheel deb arm64

help:
	@echo 'make demo      a recording of the testbed made, decoded and shown (installs what is missing)'
	@echo 'make test      all tests: C++, then Python (installs what is missing)'
	@echo 'make docs      the documentation: build/docs/html/index.html; docs-links checks its external links'
	@echo 'make gstreamer the plugin of GStreamer: $(build)/cpp/gstreamer/libgstocisac.so, and its tests'
	@echo 'make web       the page that measures a lamp in a browser: build/web/site, and its tests in Chromium'
	@echo 'make chart     speed against accuracy of every method: docs/measured/chart.png, docs/measured/chart.csv, docs/measured/accuracy.md'
	@echo 'make limits    where methods fail, and what the library does there: docs/measured/limits.png, docs/measured/limits.md'
	@echo 'make reproduce the paper'\''s figures and table, and links over distance: docs/measured/paper*, docs/measured/distance*'
	@echo 'make nightly   the tests that take minutes as well, and the C++ tests under sanitizers'
	@echo 'make fuzz      the fuzz targets (fuzz/), each for SECONDS=$(SECONDS), two at a time'
	@echo 'make soak      eight threads for ten minutes, dirty streams in parts of a quarter of an hour, resumed until FRAMES=$(FRAMES) in all'
	@echo 'make coverage  lines and branches of the core that the C++ tests reach'
	@echo 'make mutants   MUTANTS=$(MUTANTS) changes of the packet code, each of which the tests must notice'
	@echo 'make wheel     dist/release: sdist and a wheel that stands alone, tried in fresh environments (scripts/release)'
	@echo 'make deb       build/deb: Debian packages that stand alone, tried in a clean root'
	@echo 'make arm64     cross-built for 64-bit Arm, tests under qemu-user'
	@echo 'make lint      ruff, mypy, clang-format, clang-tidy'
	@echo 'make format    formats C++ and Python'
	@echo 'make build     the virtual environment $(VENV) with the package (editable), and no more'
	@echo 'make clean     removes build/ and $(VENV)'
	@echo 'variables: PYTHON=$(PYTHON) VENV=$(VENV) JOBS=$(JOBS) WERROR=$(WERROR)'

demo: build
	@$(bin)/ocisac demo

test: cpp-test $(VENV)/.requirements-test
	@echo '==> Python tests'
	@OCISAC_RX=$(CURDIR)/$(build)/cpp/apps/ocisac-rx $(bin)/python -m pytest -n $(JOBS) --dist worksteal $(PYTEST_ARGS)

# Warnings are errors: links within the pages, names in them, and every program of the gallery.
docs: cpp-build $(VENV)/.requirements-docs
	@echo '==> documentation'
	@OCISAC_RX=$(CURDIR)/$(build)/cpp/apps/ocisac-rx PATH=$(abspath $(bin)):$$PATH \
	  $(bin)/python -m sphinx -q -W --keep-going -j $(JOBS) -d build/docs/doctrees docs build/docs/html || \
	  { rm -rf build/docs/doctrees; exit 1; }
	@echo 'documentation: build/docs/html/index.html'

# Web pages of others come and go: what is gone is a warning.
docs-links: docs
	@$(bin)/python -m sphinx -q -b linkcheck -d build/docs/doctrees docs build/docs/links || \
	  sed 's/^/warning: /' build/docs/links/output.txt

# A shell over the C interface: cpp/gstreamer.
gstreamer: build
	@scripts/system-packages gstreamer
	@echo '==> plugin of GStreamer'
	@cmake -S . -B $(build) -DOCISAC_BUILD_TESTS=ON -DOCISAC_BUILD_GSTREAMER=ON >$(build)/configure.log || { cat $(build)/configure.log; exit 1; }
	@scripts/with-progress $(build)/build.log cmake --build $(build) --target gstocisac ocisac_gstreamer_tests ocisac_gstreamer_sanitized_tests
	@ctest --test-dir $(build) --output-on-failure -R '^gstreamer'

# The C interface as WebAssembly, a page over it, and a folder for npm: web.
web: build $(VENV)/.requirements-web
	@scripts/system-packages web
	@echo '==> WebAssembly and page'
	@scripts/build-web $(bin)/python
	@echo '==> tests of the page, and of the documentation if it is built, in Chromium'
	@OCISAC_SITE=$(CURDIR)/build/web/site $(if $(wildcard build/docs/html/index.html),OCISAC_DOCS=$(CURDIR)/build/docs/html) \
	  $(bin)/python -m pytest tests/web $(PYTEST_ARGS)

chart: build $(VENV)/.requirements-studies
	@$(study).chart --directory docs/measured --text docs/measured/accuracy.md

limits: build
	@$(study).limits --directory docs/measured --text docs/measured/limits.md

reproduce: build $(VENV)/.requirements-studies
	@$(study).reproduction -o docs/measured/paper --text docs/measured/paper.md
	@$(study).distance -o docs/measured/distance.png --text docs/measured/distance.md

nightly: cpp-test $(VENV)/.requirements-test wheel deb arm64 web
	@echo '==> C++ tests under AddressSanitizer and UndefinedBehaviorSanitizer'
	@scripts/system-packages fuzz
	@cmake --preset sanitize >/dev/null && cmake --build --preset sanitize && ctest --preset sanitize
	@echo '==> without OpenCV, Highway and Eigen'
	@scripts/bundle-sources
	@cmake --preset bare >/dev/null && cmake --build --preset bare && ctest --preset bare
	@echo '==> injected faults, a minute for each call'
	@$(build)/cpp/tests/ocisac_fault_tests 60 $(build)/cpp/apps/ocisac-rx $(build)/cpp/tests/libocisac_faults.so
	@echo '==> dirty streams'
	@$(bin)/python bench/soak.py --frames 10000 --state build/soak-nightly.jsonl --fresh --program $(build)/cpp/apps/ocisac-rx
	@echo '==> C++ tests under ThreadSanitizer'
	@cmake --preset thread >/dev/null && cmake --build --preset thread && ctest --preset thread
	@echo '==> a million damaged packets'
	@$(build)/cpp/tests/ocisac_tests --no-skip -tc='a million*'
	@$(MAKE) --no-print-directory fuzz SECONDS=170
	@echo '==> stated error rates of 100,000 chips, all impairments at once'
	@PYTHONPATH=bench $(bin)/python bench/calibration.py --chips 100000 --check payloads
	@$(MAKE) docs-links
	@echo '==> static analyzer'
	@scripts/system-packages lint
	@$(tidy)
	@$(tidy) --checks='-*,clang-analyzer-*,-clang-analyzer-security.FloatLoopCounter'
	@echo '==> Python tests, those of minutes included, with ten times the random cases'
	@OCISAC_RX=$(CURDIR)/$(build)/cpp/apps/ocisac-rx $(bin)/python -m pytest -m '' --hypothesis-profile nightly $(PYTEST_ARGS)

# libFuzzer targets. Nightly: 170 s each are ten minutes in all.
fuzz: packages
	@scripts/system-packages fuzz
	@echo '==> fuzz targets: build'
	@cmake --preset sanitize >/dev/null && scripts/with-progress build/sanitize/build.log cmake --build --preset sanitize --target ocisac_fuzz
	@echo '==> fuzz targets: $(SECONDS) s each'
	@fuzz/run build/sanitize $(SECONDS)

# A part of the long run, resumed where the last one ended: build/soak.jsonl.
soak: cpp-build
	@$(build)/cpp/tests/ocisac_thread_tests 600
	@$(bin)/python bench/soak.py --frames $(FRAMES) --part 250000 --program $(build)/cpp/apps/ocisac-rx

# Lines and branches of the core that the C++ tests reach: build/coverage/index.html.
coverage: packages
	@scripts/system-packages coverage
	@cmake --preset coverage >/dev/null && scripts/with-progress build/coverage/build.log cmake --build --preset coverage
	@find build/coverage -name '*.gcda' -delete
	@ctest --preset coverage
	@gcovr --root cpp --filter cpp/src --filter cpp/apps/ --exclude cpp/apps/tests --exclude-throw-branches \
	  --html-details build/coverage/index.html --print-summary build/coverage | tail -4

mutants: cpp-build
	@scripts/mutants $(build) --mutants $(MUTANTS)

build: packages $(VENV)/.requirements-cli $(VENV)/.extension

cpp-build: build
	@echo '==> C++ tests and executable: build'
	@cmake -S . -B $(build) -DOCISAC_BUILD_TESTS=ON -DOCISAC_BUILD_APPS=ON >$(build)/configure.log || { cat $(build)/configure.log; exit 1; }
	@scripts/with-progress $(build)/build.log cmake --build $(build)

cpp-test: cpp-build
	@echo '==> C++ tests'
	@ctest --test-dir $(build) -j $(JOBS) --output-on-failure -E '^gstreamer' # make gstreamer runs those

# Both at once: neither keeps all processors busy.
lint: build $(VENV)/.requirements-lint
	@scripts/system-packages lint
	@$(MAKE) --no-print-directory --output-sync=line -j 2 lint-python lint-cpp

lint-python:
	@echo '==> ruff'
	@$(bin)/ruff check -q $(python_sources) && $(bin)/ruff format -q --check $(python_sources)
	@echo '==> mypy --strict, with the types of the extension as built'
	@$(bin)/pybind11-stubgen ocisac_fast._core -o python >$(build)/stubgen.log 2>&1 || { cat $(build)/stubgen.log; exit 1; }
	@$(bin)/mypy

lint-cpp:
	@echo '==> clang-format'
	@$(bin)/clang-format --dry-run -Werror $(cpp_files)
	@echo '==> clang-tidy'
	@$(tidy)

format: $(VENV)/.requirements-lint
	@$(bin)/ruff check -q --fix-only $(python_sources); $(bin)/ruff format $(python_sources)
	@$(bin)/clang-format -i $(cpp_files)

clean:
	rm -rf build $(VENV)

# Static OpenCV core and Highway, for self-contained wheels and programs.
standalone: packages
	@PYTHON=$(PYTHON) scripts/standalone-libraries

# dist/release: the sdist, and from it a manylinux wheel that depends on NumPy alone, each tried in its own environment.
wheel: packages
	@scripts/release --dry-run --python $(PYTHON)

# build/deb: self-contained packages of executable, library and headers, and of the plugin of GStreamer, tested in a clean
# Debian root.
deb: packages standalone
	@echo '==> Debian packages'
	@scripts/system-packages device gstreamer
	@cmake -S cpp -B build/deb -G Ninja -DOCISAC_BUILD_TESTS=OFF -DOCISAC_BUILD_APPS=ON -DOCISAC_BUILD_GSTREAMER=ON \
	  -DCMAKE_INSTALL_PREFIX=/usr -DOCISAC_STANDALONE=$(CURDIR)/build/standalone >build/deb-configure.log
	@cmake --build build/deb && cd build/deb && cpack
	@scripts/check-deb build/deb/ocisac_*.deb build/deb/gstreamer1.0-ocisac_*.deb

# 64-bit Arm: library, tests and executable cross-built, run under qemu-user.
arm64: packages
	@echo '==> 64-bit Arm'
	@scripts/system-packages cross device
	@scripts/arm64-sysroot
	@cmake --preset aarch64 >/dev/null && cmake --build --preset aarch64 && ctest --preset aarch64

packages:
	@scripts/system-packages build

$(bin)/python: | packages
	@echo '==> virtual environment $(VENV) on $(PYTHON)'
	@$(PYTHON) -m venv --clear $(VENV)

# By hash; versions as in pyproject.toml.
$(VENV)/.requirements-lint: scripts/tools-lint.txt | $(bin)/python
	@echo '==> Python packages for: lint'
	@$(bin)/python -m pip install -qq --require-hashes -r $< && cp $< $@

$(VENV)/.requirements-%: pyproject.toml scripts/requirements | $(bin)/python
	@echo '==> Python packages for: $*'
	@$(bin)/python scripts/requirements $* >$@ && $(bin)/python -m pip install -qq -r $@

$(VENV)/.requirements-studies: bench/studies/requirements.txt | $(VENV)/.requirements-cli
	@echo '==> Python packages for: studies'
	@$(bin)/python -m pip install -qq -r $< && cp $< $@

$(VENV)/.extension: $(native) pyproject.toml | $(VENV)/.requirements-cli
	@echo '==> C++ core and Python package: build and install (editable)'
	@SKBUILD_BUILD_DIR=$(build) SKBUILD_CMAKE_DEFINE=OCISAC_WARNINGS_AS_ERRORS=$(WERROR) \
	  scripts/with-progress $(build)/extension.log $(bin)/python -m pip install -v --no-deps --no-build-isolation -e .
	@touch $@
