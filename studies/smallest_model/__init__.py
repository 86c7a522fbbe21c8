"""What the smallest model of a path saves, and that it gives what the full one gives."""

from studies.smallest_model.measure import SCENES, Scene, compared, rows

__all__ = ["SCENES", "Scene", "compared", "rows"]
