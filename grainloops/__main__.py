"""The command, as `python -m grainloops`."""

from studies.cli import main

# Workers of a pool import this module again.
if __name__ == "__main__":
    main()
