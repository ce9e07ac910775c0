"""Scores: the output of the stages against the truth."""

from coastwatch.scores.tally import Tally, add, figure_names, result

__all__ = ["Tally", "add", "figure_names", "result"]
