# Few verbs; each sets up what it needs. Only python3, make and a package index are assumed.
PYTHON ?= python3
UV_VERSION = 0.13.8
BIN = .venv/bin
export UV_PROJECT_ENVIRONMENT = .venv

.PHONY: demo test check bench docs clean

.venv/.ready: pyproject.toml uv.lock
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check "uv==$(UV_VERSION)"
	@$(BIN)/uv sync --quiet --locked --inexact
	@touch $@

# A small scenario compiles the kernels that runs use.
.venv/.warm: .venv/.ready $(wildcard coastwatch/kernels/*/*.py)
	@$(BIN)/coastwatch run guanabara --db sqlite:///.venv/warm.db --restart >/dev/null
	@touch $@

demo: .venv/.warm  ## set up, run the guanabara scenario, leave a database and a picture in out/
	@mkdir -p out
	$(BIN)/coastwatch run guanabara --db sqlite:///out/guanabara.db --restart
	$(BIN)/coastwatch plot --db sqlite:///out/guanabara.db --output out/guanabara.png

test: .venv/.warm  ## set up and run the tests
	$(BIN)/python -m pytest

check: .venv/.ready  ## style, types and the import contract
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: .venv/.warm  ## time stages, load, peers and kernels: one table, also in scaling/results/bench.txt and bench.md
	$(BIN)/python -m scaling.bench

docs: .venv/.ready  ## write the generated parts of the documentation again
	$(BIN)/python -m coastwatch.operators.reference

clean:
	rm -rf .venv out dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
