"""Snapshots of discrete-element simulations, one reader per format."""
