"""The commands of `grainloops`, one module each."""
