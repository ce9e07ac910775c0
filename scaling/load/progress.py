"""The progress display of the product. An older checkout, as a baseline, runs a load of this one and has it under another name."""

try:
    from coastwatch.operators.cli.progress import report_progress
except ImportError:
    from coastwatch.operators.cli.progress import shown as report_progress  # type: ignore[attr-defined, no-redef]

__all__ = ["report_progress"]
