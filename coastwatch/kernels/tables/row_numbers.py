"""A check of row numbers that did not come from this process. Kernels do not check them."""

from __future__ import annotations

from coastwatch.kernels.arrays import Ints, Rows


def require_rows(name: str, rows: Ints | Rows, count: int, least: int = 0) -> None:
    """Raises: ValueError: a row number is not from `least` to count - 1. Args: name: of the field, for the message."""
    low, high = int(rows.min(initial=least)), int(rows.max(initial=least))
    if low < least or (len(rows) and high >= count):
        raise ValueError(f"{name}: got row numbers {low} to {high}, needed {least} to {count - 1}")
