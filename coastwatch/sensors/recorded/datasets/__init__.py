"""Recordings of research projects, each in files of its own kind, with their truth."""
