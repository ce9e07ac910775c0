"""ASTERIX of EUROCONTROL: plots of radars and tracks of other systems, in and out."""
