"""Plots of a region into tracks: `tracker` has the settings and the step; `region` the cycle."""
