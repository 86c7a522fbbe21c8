"""The loops of many snapshots and their fates: the study behind `grainloops series`."""
