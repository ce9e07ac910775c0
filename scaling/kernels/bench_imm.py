"""One prediction, gate and update of each of 4,000 radar tracks: the two banks of models, and filterpy on 100 of them."""

from collections.abc import Callable

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from coastwatch.kernels.tracks.columns import PlotColumns
from coastwatch.tracks.radar.bank.compiled import CompiledBank
from coastwatch.tracks.radar.bank.filterpy import FilterpyBank
from coastwatch.tracks.radar.motion import Manoeuvres, Motion
from coastwatch.tracks.radar.table import Table

TRACKS, FEW = 4_000, 100


def problem(bank: CompiledBank | FilterpyBank, tracks: int) -> Callable[[], None]:
    """Filters that have had a second plot, and the arguments of `update` for further ones: each call takes one that is 3 s newer."""
    rng = np.random.default_rng([1, 0])
    noise = np.tile(np.diag([100.0, 900.0]), (tracks, 1, 1))
    place, rows = rng.normal(size=(tracks, 2)) * 1000.0, np.arange(tracks)
    near = place + rng.normal(size=(2, tracks, 2)) * 20.0
    none = np.zeros(tracks, np.int64)
    first, second, third = (PlotColumns(np.full(tracks, 3.0 * k), at, noise, none, none) for k, at in enumerate((place, *near)))
    table, rows = Table.empty(J=len(bank.prior.table()), R=1).with_slots(rows)
    bank.begin(table, rows, rows, first)
    bank.update(table.filters, table.estimates, rows, rows, second)

    def update() -> None:
        third.time[:] += 3.0
        bank.update(table.filters, table.estimates, rows, rows, third)

    return update


@pytest.mark.benchmark(group="imm: radar filters")
def test_ours_sided_imm(benchmark: BenchmarkFixture) -> None:
    bank = CompiledBank(Manoeuvres())
    benchmark.extra_info["rows"] = TRACKS
    benchmark(problem(bank, TRACKS))


@pytest.mark.benchmark(group="imm: radar filters")
def test_ours_sided_imm_of_three_models(benchmark: BenchmarkFixture) -> None:
    """As many models as `imm` has."""
    models = tuple(m.model_copy(update={"share": 1.0 / 3.0}) for m in Manoeuvres().models[2:5])
    bank = CompiledBank(Manoeuvres(models=models))
    benchmark.extra_info["rows"] = TRACKS
    benchmark(problem(bank, TRACKS))


@pytest.mark.benchmark(group="imm: radar filters")
def test_ours_imm(benchmark: BenchmarkFixture) -> None:
    bank = CompiledBank(Motion())
    benchmark.extra_info["rows"] = TRACKS
    benchmark(problem(bank, TRACKS))


@pytest.mark.benchmark(group="imm: radar filters")
def test_baseline_filterpy(benchmark: BenchmarkFixture) -> None:
    bank = FilterpyBank(Motion())
    benchmark.extra_info["rows"] = FEW
    benchmark.pedantic(problem(bank, FEW), rounds=3)
