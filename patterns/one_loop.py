"""One loop of a snapshot, scene, graph, networkx graph or list of grains."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from loops import ContactLaw, GrainGraph, InputError, Regime, contact_state, from_networkx
from loops.arrays import Flags
from loops.assembly import contact_regime
from loops.errors import counted, short
from loops.errors import number as checked_number
from loops.graph import HasGraph
from loops.pruning import component_labels
from loops.scene import Scene, Subject, scene_of
from loops.validation import real
from patterns.snapshots.findings import few
from patterns.snapshots.snapshot import (
    Snapshot,
    SnapshotLoop,
    loop_of_snapshot,
    planar,
    snapshot_of,
)

# Gap over the sum of the radii up to which grains touch, where positions are typed in.
TOUCHING = 1e-6


def loop(
    source: Snapshot | Subject | HasGraph | ArrayLike | Any,
    number: int | None = None,
    *,
    law: ContactLaw | None = None,
    tolerance: float = TOUCHING,
) -> SnapshotLoop:
    """Take one loop out of a sample, or make one; every question about a scene takes it.

    The grains of the loop are put in order, counter-clockwise from the first. Where no contact has
    a normal force, the law gives those of the overlaps; shear forces that are not given are zero.

    Parameters
    ----------
    source : Snapshot, Scene, GrainGraph, networkx.Graph or (n, 3) array
        A sample, with `number`; or grains that form one ring: a scene, a graph, a graph of
        networkx (see `from_networkx`), or rows `x, y, radius` in any order, whose contacts are the
        pairs that touch.
    number : int, optional
        Of the loop in the column `loop` of `loop_table`, where there are several.
    law : ContactLaw, optional
        Law of the contacts, needed where the source has none; a snapshot and a scene have one.
    tolerance : float
        Gap over the sum of the radii up to which two grains count as touching.

    Returns
    -------
    SnapshotLoop
        `graph`, `law`, `regime`, `ids` of its grains (nodes, or rows), `scene`.

    Raises
    ------
    InputError
        If there is no loop of that number, or the grains form no single ring: the message names
        every chord, gap, grain without two contacts, and separate part.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> one = loop(read_snapshot(sample_path()), 62)
    >>> one.graph.grain_count == len(one.ids), one.scene.boundary.kind
    (True, 'free')

    Four discs in any order, each overlapping its two neighbours by 0.05:

    >>> from loops import LinearFrictional
    >>> rows = [(0, 0, 0.5), (0.95, 0.95, 0.5), (0.95, 0, 0.5), (0, 0.95, 0.5)]
    >>> square = loop(rows, law=LinearFrictional(kn=1.0, kt=0.2))
    >>> square.ids.tolist(), square.graph.normal_force.round(12).tolist()
    ([0, 2, 1, 3], [0.05, 0.05, 0.05, 0.05])
    """
    checked_number("tolerance", tolerance, 0.0)
    own = isinstance(source, Snapshot | Scene) or hasattr(type(source), "scene")
    if own != (law is None):
        received = f"{type(law).__name__} with a snapshot or scene" if own else "none"
        expected = "none: it has its own" if own else "the law of the contacts"
        remedy = "Leave it out." if own else "Give law=gl.LinearFrictional(kn, kt, mu)."
        raise InputError("law", received, expected, remedy)
    if isinstance(source, Snapshot):
        return loop_of_snapshot(source, number)
    scene, ids = _scene_of(source, law, tolerance)
    graph = _loaded(scene, tolerance)
    if number is None:
        _require_ring(graph, ids)
    snapshot = planar(snapshot_of(replace(scene, graph=graph)), "the loop")
    found = loop_of_snapshot(snapshot, 0 if number is None else number)
    if number is None and graph.cell is None:
        # The reference of a ring that was strained before.
        found = replace(found, graph=found.graph.replace(x0=graph.x0[found.grains]))
    return replace(found, ids=ids[found.grains])


def _scene_of(source: Any, law: ContactLaw | None, tolerance: float) -> tuple[Scene, NDArray[Any]]:
    """Return a scene, and what its grains are called."""
    if law is None:
        scene = scene_of(source)
        return scene, np.asarray(getattr(source, "ids", np.arange(scene.graph.grain_count)))
    if hasattr(source, "adj"):
        ids = np.fromiter(source.nodes, dtype=object, count=len(source))
        return Scene(from_networkx(source), law), ids
    graph = getattr(source, "graph", source)
    if not isinstance(graph, GrainGraph):
        graph = _touching(source, tolerance)
    return Scene(graph, law), np.arange(graph.grain_count)


def _touching(rows: Any, tolerance: float) -> GrainGraph:
    """Grains listed as `x, y, radius`, and the contacts between those that touch."""
    expected = "a snapshot, scene, graph, graph of networkx, or rows x, y, radius"
    remedy = "Read a file first: gl.read_snapshot(path)."
    table = real("source", rows, expected=expected, remedy=remedy)
    if table.ndim != 2 or table.shape[1] != 3 or len(table) == 0:
        raise InputError("source", short(rows), expected, "Give a row x, y, radius for each grain.")
    x, radii = table[:, :2], table[:, 2]
    GrainGraph(x=x, radii=radii, contacts=[])
    reach = 2.0 * radii.max() * (1.0 + tolerance)
    pairs = np.unique(cKDTree(x).query_pairs(reach, output_type="ndarray"), axis=0)
    i, j = pairs.T
    gap = np.hypot(*(x[j] - x[i]).T) - radii[i] - radii[j]
    return GrainGraph(x=x, radii=radii, contacts=pairs[gap <= tolerance * (radii[i] + radii[j])])


def _loaded(scene: Scene, tolerance: float) -> GrainGraph:
    """Forces of the overlaps where no contact has one; contacts within the tolerance are closed."""
    graph, law = scene.graph, scene.law
    if not graph.normal_force.any():
        forces = law.normal_force(scene.contact_state)
        graph = graph.replace(normal_force=forces, regime=graph.regime)
    if graph.regime is not None:
        return graph
    state = contact_state(graph)
    regime = contact_regime(state, law)
    near = (regime == Regime.OPEN) & (-state.overlap <= tolerance * state.touching_length)
    regime[near] = Regime.ELASTIC
    return graph.replace(regime=regime)


def _next_gap(graph: GrainGraph, loose: Flags) -> str:
    """Say how far the first of some grains is from the nearest one that it does not touch."""
    if not loose.any() or graph.grain_count < 3:
        return ""
    k, radii = int(loose.argmax()), graph.radii
    gap = (np.hypot(*(graph.x - graph.x[k]).T) - radii - radii[k]) / (radii + radii[k])
    gap[[k, *graph.contacts[(graph.contacts == k).any(axis=1)].ravel()]] = np.inf
    return f" (the next gap is {gap.min():.3g} of the radii)"


def _require_ring(graph: GrainGraph, ids: NDArray[Any]) -> None:
    """Raise `InputError` with all that keeps some grains from being one closed ring."""
    contacts, count = graph.contacts, graph.grain_count
    degree = np.bincount(contacts.ravel(), minlength=count)
    parts, label = component_labels(count, contacts, np.ones(count, dtype=bool))
    loose, wide, gaps = degree < 2, degree > 2, graph.regime == Regime.OPEN
    chords = wide[contacts].all(axis=1)

    def pairs(those: Any) -> str:
        return few(ids[contacts[those]], lambda pair: "{}-{}".format(*pair))

    faults = {
        counted(count, "grain"): count < 3,
        f"{parts} separate parts, one with grain {ids[label.argmax()]}": parts > 1,
        f"grains {few(ids[loose])} without two neighbours in contact{_next_gap(graph, loose)}": (
            loose.any()
        ),
        f"chords among contacts {pairs(chords)}": chords.any(),
        f"grains {few(ids[wide])} with three contacts or more": wide.any() and not chords.any(),
        f"no contact across the gaps {pairs(gaps)}": gaps.any(),  # type: ignore[union-attr]
    }
    if wrong := [text for text, holds in faults.items() if holds]:
        expected = "one closed ring of three grains or more, each in contact with two others"
        remedy = "Leave out the rest, pick one of several loops by number=, or raise tolerance="
        remedy += f" (gaps over the sum of radii, {TOUCHING:g} if left out)."
        raise InputError("loop", "; ".join(wrong), expected, remedy)
