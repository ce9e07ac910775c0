"""Truth against what the stages yielded."""

from coastwatch.scores.tally import Tally, add, result, start

__all__ = ["Tally", "add", "result", "start"]
