"""Figures by name, `gl.plot.map(snapshot)`: each draws into the axes given, or into pyplot's.

Examples
--------
>>> import grainloops as gl
>>> from matplotlib.figure import Figure
>>> ax = gl.plot.loop(gl.regular_polygon(5, strain=0.1), ax=Figure().add_subplot())
>>> ax.get_xlabel()
'$x_1$ (length)'
"""

from studies.plots import plot_cone as cone
from studies.plots import plot_domain as domain
from studies.plots import plot_envelope as envelope
from studies.plots import plot_evolution as evolution
from studies.plots import plot_loop as loop
from studies.plots import plot_map as map
from studies.plots import plot_path as path
from studies.plots import plot_rose as rose
from studies.style import figure_width

__all__ = ["cone", "domain", "envelope", "evolution", "figure_width", "loop", "map", "path", "rose"]
