"""Figures by name, `gl.plot.map(snapshot)`: each draws into the axes given, or into pyplot's.

Examples
--------
>>> import grainloops as gl
>>> from matplotlib.figure import Figure
>>> ax = gl.plot.loop(gl.regular_polygon(5, strain=0.1), ax=Figure().add_subplot())
>>> ax.get_xlabel()
'$x_1$ (length)'
"""

from typing import Any

from studies.plots import plot_chains as chains
from studies.plots import plot_cone as cone
from studies.plots import plot_domain as domain
from studies.plots import plot_eigenvalues as eigenvalues
from studies.plots import plot_envelope as envelope
from studies.plots import plot_evolution as evolution
from studies.plots import plot_fates as fates
from studies.plots import plot_loop as loop
from studies.plots import plot_map as map
from studies.plots import plot_orders as orders
from studies.plots import plot_path as path
from studies.plots import plot_polar as polar
from studies.plots import plot_rose as rose
from studies.plots import plot_skill as skill
from studies.plots import plot_stress_strain as stress_strain
from studies.style import figure_width

# fmt: off
__all__ = [
    "chains", "cone", "domain", "eigenvalues", "envelope", "evolution", "fates", "figure_width",
    "loop", "map", "orders", "path", "polar", "rose", "skill", "stress_strain",
]
# fmt: on


def __getattr__(name: str) -> Any:
    """Say which figure may be meant."""
    from difflib import get_close_matches

    near = ", ".join(get_close_matches(name, __all__)) or ", ".join(__all__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}: see {near}", name=name)
