"""Damaged files given to every reader: a snapshot or one clear line, whatever the damage."""
