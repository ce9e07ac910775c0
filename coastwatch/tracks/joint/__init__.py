"""Radar tracks with a probability of existence, by joint probabilistic data association: see the README."""
