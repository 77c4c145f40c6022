# Everything from a bare machine with Python >= 3.11: `make demo` and `make test`.
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3; do command -v $$p >/dev/null && $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
DEV    := $(VENV)/.installed-dev
LOWEST := out/lowest/.installed
BENCHES := bench-calibration bench-tracking bench-broad bench-orientation bench-load bench-bridge bench-cluster bench-network bench-faults bench-hostile bench-outlets bench-storage bench-viewers

.PHONY: setup setup-dev demo test check lint types contracts prose proto study bench $(BENCHES) pins supply fuzz soak nemesis docs release release-check test-lowest lowest clean

setup: $(STAMP)
setup-dev: $(DEV)

$(STAMP): pyproject.toml
	@test -n "$(PYTHON)" || { echo "truerate needs Python 3.11 or newer with the venv module (Debian: apt-get install python3-venv)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'
	$(BIN)/python -m pip install --quiet --editable .
	$(BIN)/python -m estimator.kernels
	@touch $@

$(DEV): $(STAMP)
	$(BIN)/python -m pip install --quiet --group dev
	@touch $@

demo: setup
	$(BIN)/truerate demo

test: setup-dev
	$(BIN)/python -m pytest

# The tests with the lowest allowed version of each dependency; `make test` installs the newest. ARGS='tests/laws' for some.
test-lowest: lowest
	out/lowest/bin/python -m pytest $(ARGS)

lowest: $(LOWEST)
lowest test-lowest: export NUMBA_CACHE_DIR = $(CURDIR)/out/lowest/numba
$(LOWEST): $(DEV)
	$(BIN)/uv venv -q --clear --python $(PYTHON) out/lowest
	$(BIN)/uv pip install -q --python out/lowest/bin/python --resolution lowest-direct --editable '.[ble,cwa,foxglove,hdf5,lsl,mavlink,mqtt,openid,parquet,ros,ros2,s3,xdf]' --group dev
	out/lowest/bin/python -m estimator.kernels
	@touch $@

# The documentation site, in out/docs; a warning is an error.
docs: setup-dev
	$(BIN)/python -m pip install --quiet --group docs
	$(BIN)/sphinx-build -q -W --keep-going -b html docs out/docs

# A release in dist/: wheel, sdist, Debian packages, bundles for machines without a network. ARGS=x86_64 for one platform.
release: setup-dev
	$(BIN)/python -m pip install --quiet --group docs --group release
	$(BIN)/python packaging/release.py $(ARGS)

# The release in dist/ on a new Debian with its own systemd, as root: installed, used, upgraded, removed; the bundle; lintian.
release-check: setup-dev
	$(BIN)/python packaging/check.py

check: lint types contracts prose

lint: setup-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell

# Once more as on Windows: without what has no Windows, which the services need.
LINUX := ^bridge/(transport/(serial_|port_|tcp_|udp_)|diagnose/|sim/pty_port|runtime/service_manager)|^estimator/(cli/init|database|demo|installation|python|web)
types: setup-dev
	$(BIN)/mypy
	$(BIN)/mypy --platform win32 --cache-dir .mypy_cache/windows --follow-imports silent --exclude '$(LINUX)' bridge estimator

contracts: setup-dev
	$(BIN)/lint-imports

# Word rules for pages, help and messages.
prose: setup-dev
	$(BIN)/python -m pytest -n 0 tests/test_prose.py

# Regenerates the committed protobuf modules; tests/bridge/wire/test_proto.py holds them to the .proto files.
proto: setup-dev
	$(BIN)/python -m grpc_tools.protoc -I . --python_out=. --pyi_out=. bridge/wire/truerate.proto bridge/wire/columns.proto

study: setup
	$(BIN)/truerate study all

# Measurements: all of them and one table, which takes hours; or a group, such as `make bench-load ARGS=--json`.
bench: setup-dev
	$(BIN)/python -m tests.bench

bench-calibration: export OPENBLAS_NUM_THREADS = 1
$(BENCHES): bench-%: setup-dev
	$(BIN)/python -m tests.bench $* $(ARGS)

# Regenerates the pins for deployment, each with its hashes: of every platform, and of what builds the package.
pins: setup-dev
	$(BIN)/uv pip compile -q --upgrade --universal --python-version 3.11 --generate-hashes --no-annotate --custom-compile-command 'make pins' --all-extras -o requirements/deploy.txt pyproject.toml
	printf 'hatchling>=1.27\nsetuptools>=80\n' | $(BIN)/uv pip compile -q --upgrade --universal --python-version 3.11 --generate-hashes --no-annotate --custom-compile-command 'make pins' -o requirements/build.txt -

# The supply chain: in an empty environment, what is pinned is installed by its hashes alone, and truerate with it; and the SBOM (CycloneDX)
# of it, out/sbom.cdx.json. Without a network: PIP_NO_INDEX=1 PIP_FIND_LINKS=wheels make supply.
supply: setup-dev
	rm -rf out/supply && $(PYTHON) -m venv out/supply
	out/supply/bin/python -m pip install --quiet --require-hashes -r requirements/build.txt
	out/supply/bin/python -m pip install --quiet --require-hashes --no-build-isolation --prefer-binary -r requirements/deploy.txt
	out/supply/bin/python -m pip install --quiet --no-deps --no-build-isolation .
	out/supply/bin/python -m pip check && out/supply/bin/truerate --version && rm -rf out/supply
	PYTHONWARNINGS=ignore $(BIN)/cyclonedx-py requirements requirements/deploy.txt --pyproject pyproject.toml --output-reproducible --validate --of JSON -o out/sbom.cdx.json
	$(BIN)/python -m tests.bill out/sbom.cdx.json

# Ten million executions of every decoder; ARGS='native --runs 1e6' for a short look.
fuzz: setup-dev
	$(BIN)/python -m tests.fuzz $(ARGS)

# The same tests as in `make test`, with thousands of kills, flipped bits and torn files, and new random examples; for a night.
soak: setup-dev
	TRUERATE_SOAK=1 $(BIN)/python -m pytest -m 'not ward and not soak' tests/laws tests/bridge tests/estimator
	TRUERATE_SOAK=1 $(BIN)/python -m pytest -m soak --timeout=36000 $(ARGS)

# Seeded random faults on a ward of real processes, held against what is promised; clocks are set where libfaketime is installed.
nemesis: setup-dev
	$(BIN)/python -m tests.nemesis $(ARGS)

clean:
	rm -rf $(VENV) out build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
