"""Steps of regional centres that are quick to compute, in a module that another process imports fast."""

import os


def add(memory, given):
    """A step that writes into its memory, and yields the sum and the process."""
    total, cycles = memory
    total += given
    return (total, cycles + 1), (float(total.sum()), os.getpid())


def refuse(memory, given):
    raise KeyError("nothing")
