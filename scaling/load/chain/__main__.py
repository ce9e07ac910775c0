"""Runs the command: `python -m scaling.load.chain --help`."""

from scaling.load.chain.command import main

if __name__ == "__main__":
    main()
