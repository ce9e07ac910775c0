"""Trackers that keep several hypotheses of each vessel open over some looks; the choice over all tracks is reported."""

from coastwatch.tracks.radar.multi_hypothesis.tracking import MultiHypothesis as MultiHypothesis
