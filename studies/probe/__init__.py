"""The study behind `grainloops probe`: a snapshot's response in many directions."""

from studies.probe.run import run_probe as run_probe
