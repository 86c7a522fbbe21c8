"""The commands of `grainloops`."""
