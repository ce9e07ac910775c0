"""Trackers that keep several hypotheses of each vessel open over some looks."""
