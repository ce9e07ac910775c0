"""The tracker of Liland's thesis, as printed: a tree for each vessel, with N-scan pruning."""
