"""Faces the slow way: a dictionary of neighbours, `atan2`, one step at a time."""

import math
from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True)
class ReferenceFace:
    half_edges: tuple[tuple[int, bool], ...]  # (contact, forward), from the first one on
    grains: tuple[int, ...]
    area: float
    winding: tuple[int, int]


def kept_contacts(contacts):
    """Contacts that are left once grains with one contact are removed, one at a time."""
    left = dict(enumerate(map(tuple, contacts)))
    while True:
        degree = defaultdict(int)
        for i, j in left.values():
            degree[i] += 1
            degree[j] += 1
        lone = [c for c, (i, j) in left.items() if 1 in (degree[i], degree[j])]
        if not lone:
            return left
        del left[lone[0]]


def reference_faces(graph):
    """Every face of the graph as a `ReferenceFace`, in canonical order."""
    contacts = kept_contacts(graph.contacts.tolist())
    images = graph.images.tolist() if graph.images is not None else [(0, 0)] * graph.contact_count
    (a, b), (c, d) = graph.cell.tolist() if graph.cell is not None else ((0, 0), (0, 0))
    x = graph.x.tolist()

    steps = {}  # (contact, forward) -> start, end, vector, image
    around = defaultdict(list)
    for k, (i, j) in contacts.items():
        p, q = images[k]
        vector = (x[j][0] - x[i][0] + a * p + b * q, x[j][1] - x[i][1] + c * p + d * q)
        steps[k, True] = i, j, vector, (p, q)
        steps[k, False] = j, i, (-vector[0], -vector[1]), (-p, -q)
    for half_edge, (start, _, vector, _) in steps.items():
        around[start].append((math.atan2(vector[1], vector[0]), half_edge))
    for neighbours in around.values():
        neighbours.sort()

    def following(half_edge):
        k, forward = half_edge
        end = steps[half_edge][1]
        turned = [name for _, name in around[end]]
        return turned[turned.index((k, not forward)) - 1]

    faces, seen = [], set()
    # By first grain, second grain, image.
    for first in sorted(steps, key=lambda name: (*steps[name][:2], steps[name][3])):
        walk = []
        while first not in seen:
            seen.add(first)
            walk.append(first)
            first = following(first)
        if walk:
            faces.append(_face(walk, steps))
    return faces


def _face(walk, steps):
    area, corner, winding = 0.0, (0.0, 0.0), (0, 0)
    for half_edge in walk:
        _, _, (dx, dy), (p, q) = steps[half_edge]
        area += 0.5 * (corner[0] * dy - corner[1] * dx)
        corner = corner[0] + dx, corner[1] + dy
        winding = winding[0] + p, winding[1] + q
    return ReferenceFace(tuple(walk), tuple(steps[h][0] for h in walk), area, winding)


def half_edge_cycles(faces):
    """Each face as the tuple of its half-edges."""
    half_edges = list(zip(faces.contacts.tolist(), faces.forward.tolist(), strict=True))
    return [tuple(half_edges[a:b]) for a, b in pairwise(faces.offsets)]
