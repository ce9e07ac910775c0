"""Tracks of bearings."""

from coastwatch.tracks.bearing.memory import BearingMemory as BearingMemory
from coastwatch.tracks.bearing.tracker import BearingWindow as BearingWindow
