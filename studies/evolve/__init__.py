"""The study behind `grainloops evolve`: a snapshot's packing followed from event to event."""

from studies.evolve.run import run_evolve as run_evolve
