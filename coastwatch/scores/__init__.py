"""Scores: the output of the stages against the truth."""

from coastwatch.scores.tally import Tally as Tally, add as add, figure_names as figure_names, result as result
