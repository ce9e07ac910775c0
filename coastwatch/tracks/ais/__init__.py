"""AIS reports into tracks: `ais_filter` is the default, `dead_reckoning` moves the newest report."""
