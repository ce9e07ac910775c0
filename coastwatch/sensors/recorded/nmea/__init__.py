"""The feed of files of NMEA 0183 sentences, and their tracked targets."""
