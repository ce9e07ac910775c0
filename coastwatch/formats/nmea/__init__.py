"""NMEA 0183: sentences of AIS and of tracked targets."""
