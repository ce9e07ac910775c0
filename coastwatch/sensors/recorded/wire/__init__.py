"""Files of what live feeds carry, and captures of a network."""
