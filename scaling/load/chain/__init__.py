"""The whole chain from plots, on a coast of radar regions of any size: `python -m scaling.load.chain`. README.md says what is in it."""
