"""Scores: the output of the stages against the truth."""

from coastwatch.scores.tally import Tally, add, result, start

__all__ = ["Tally", "add", "result", "start"]
