"""db/ and scenarios/ are found in a checkout and in an installed wheel."""

from __future__ import annotations

from pathlib import Path

import pytest

from coastwatch import shipped

pytestmark = pytest.mark.contract


def test_in_a_checkout_they_are_beside_the_package() -> None:
    assert shipped.migrations_folder() == Path(__file__).parents[2] / "db" / "migrations"
    assert shipped.scenarios_folder() == Path(__file__).parents[2] / "scenarios"


def test_a_wheel_has_them_inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "site-packages" / "coastwatch"
    (package / "_data" / "db" / "operator").mkdir(parents=True)
    (tmp_path / "site-packages" / "db").mkdir()  # another package's
    monkeypatch.setattr(shipped, "PACKAGE", package)
    assert shipped.operator_queries_folder() == package / "_data" / "db" / "operator"
    with pytest.raises(FileNotFoundError, match=r"scenarios/ is neither at .* the installation is incomplete"):
        shipped.scenarios_folder()
