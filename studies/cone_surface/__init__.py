"""The instability cone in three dimensions as a picture."""

from studies.cone_surface.draw import cone_edge, draw_cone_surface, draw_states

__all__ = ["cone_edge", "draw_cone_surface", "draw_states"]
