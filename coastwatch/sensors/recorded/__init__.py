"""Feeds of recorded files."""
