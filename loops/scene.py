"""A scene: grains, contacts, their law and what they end at; every question takes it first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, wraps
from os import PathLike
from typing import Concatenate, ParamSpec, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Integers, one_blas_thread
from loops.boundary import Boundary, Rows, boundary_of, rows_of
from loops.errors import InputError, check_type
from loops.faces import Faces, find_faces
from loops.graph import (
    ContactState,
    GrainGraph,
    contact_state,
    graph_without,
    require_one_state,
)
from loops.laws.frictional import ContactLaw, require_law
from loops.shown import Shown
from loops.validation import integers


@dataclass(frozen=True, eq=False, repr=False)
class Scene(Shown):
    """A loop, a cluster or a whole packing, with its law and its boundary.

    Attributes
    ----------
    graph : GrainGraph
        Grains and contacts, with forces and the regimes that are known; compression is positive.
    law : ContactLaw
        Law of the contacts between grains.
    boundary : Boundary
        What the sample ends at: if left out the graph's periodic cell, or nothing.
    ids : (G,) array of int, optional
        Ids of the grains, as a file has them, for tables and fates; if left out their numbers.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> row = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1], [1, 0]],
    ...     images=[[0, 0], [1, 0]], cell=[[2, 0], [0, 3]])
    >>> scene = Scene(row, LinearFrictional(1.0, 0.5, 0.5))
    >>> scene.boundary.kind, scene.boundary.volume, scene.ids.tolist()
    ('cell', 6.0, [0, 1])
    """

    graph: GrainGraph
    law: ContactLaw
    boundary: Boundary = None  # type: ignore[assignment]
    ids: Integers = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        remedy = "Give Scene(graph, law); a Snapshot has .scene."
        check_type("graph of a scene", self.graph, GrainGraph, remedy)
        if cast(object, self.boundary) is None:
            object.__setattr__(self, "boundary", boundary_of(self.graph))
        remedy = "Give boundary_of(graph, walls=, held=)."
        check_type("boundary of a scene", self.boundary, Boundary, remedy)
        require_law(self.law, self.graph.contact_shape)
        count = self.graph.grain_count
        ids = np.arange(count) if cast(object, self.ids) is None else self.ids
        object.__setattr__(self, "ids", integers("ids of a scene", ids, count))

    @property
    def given_volume(self) -> float | None:
        """Return the area that was given for stresses; None where the graph's own serves."""
        volume = self.boundary.volume
        return None if volume == boundary_of(self.graph).volume else volume

    @cached_property
    def faces(self) -> Faces:
        """Return the faces of the graph, found when they are first asked for."""
        return find_faces(self.graph)

    @cached_property
    def contact_state(self) -> ContactState:
        """Return the contacts as the law sees them, made when first asked for; of one state."""
        require_one_state(self.graph)
        return contact_state(self.graph)

    @cached_property
    def rows(self) -> Rows:
        """Return all contacts in one table, those with walls included, made when asked for."""
        return rows_of(self.graph, self.law, self.boundary, self.contact_state)

    def without(self, grains: ArrayLike = (), contacts: ArrayLike = ()) -> Scene:
        """Return the scene without some grains and contacts, as they stand: out of balance.

        Parameters
        ----------
        grains : (K,) array of int
            Their numbers in the graph; their contacts, with walls too, go along.
        contacts : (M, 2) array of int
            Pairs of grains, all contacts of each.

        Returns
        -------
        Scene
            Grains are numbered anew in their order and keep their ids; area and cell of the
            boundary stay. `gl.hold` brings it to rest.

        Raises
        ------
        InputError
            For a grain or a contact that there is not.

        Examples
        --------
        >>> from loops import GrainGraph, LinearFrictional, Scene
        >>> row = GrainGraph(x=[[0, 0], [1, 0], [2, 0]], radii=[0.5] * 3, contacts=[[0, 1], [1, 2]])
        >>> less = Scene(row, LinearFrictional(1.0, 0.5, 0.5)).without(grains=[0])
        >>> less.graph.grain_count, less.graph.contacts.tolist()
        (2, [[0, 1]])
        """
        kept = graph_without(self.graph, grains, contacts)
        boundary = self.boundary.of_kept(kept.grains, self.graph.grain_count)
        law, ids = self.law.take(kept.contacts), self.ids[kept.grains]
        return Scene(kept.graph, law, boundary, ids)

    def facts(self) -> dict[str, object]:
        """Return the facts that the prompt and a notebook show."""
        law, boundary = type(self.law).__name__, self.boundary.kind
        return {**self.graph.facts(), "law": law, "boundary": boundary}


class HasScene(Protocol):
    """Object with a scene, accepted in its place: a snapshot, or a packing at rest."""

    @property
    def scene(self) -> Scene:
        """Return graph, law and boundary."""
        ...


Subject = Scene | HasScene
Asked = ParamSpec("Asked")
Answer = TypeVar("Answer")


def scene_of(subject: Subject, where: str = "first argument") -> Scene:
    """Return the scene of a question's argument: itself, or that of a snapshot.

    `InputError` for anything else.
    """
    if isinstance(subject, Scene):
        return subject
    # Looked up on the type: a snapshot without a law names itself what it lacks.
    if not hasattr(type(subject), "scene"):
        received, expected = type(subject).__name__, "a Scene or a Snapshot"
        if isinstance(subject, GrainGraph):
            received = "a graph without its law"
        named = isinstance(subject, str | PathLike)
        remedy = "Read it: gl.read_snapshot(path)." if named else "Give Scene(graph, law)."
        raise InputError(where, received, expected, remedy)
    return subject.scene


def of_scene(
    question: Callable[Concatenate[Scene, Asked], Answer],
) -> Callable[Concatenate[Subject, Asked], Answer]:
    """Let a function of a scene take a snapshot too; its linear algebra has one thread."""

    @wraps(question)
    def of_subject(scene: Subject, *args: Asked.args, **options: Asked.kwargs) -> Answer:
        with one_blas_thread():
            return question(scene_of(scene), *args, **options)

    return of_subject
