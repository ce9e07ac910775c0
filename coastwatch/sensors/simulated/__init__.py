"""The feed of simulated vessels and sensors."""
