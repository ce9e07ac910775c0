"""Recorded radar video."""
