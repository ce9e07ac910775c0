"""Tables, CSV or Parquet: AIS, plots, bearings and finished tracks."""
