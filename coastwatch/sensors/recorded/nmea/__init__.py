"""Files of NMEA 0183 sentences: AIS messages and tracked targets."""
