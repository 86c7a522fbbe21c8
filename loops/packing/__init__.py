"""A packing as one sparse system: who carries, assembly, factorisation, loops in place."""

from loops.packing.carrying import Carrying
from loops.packing.factor import Factor, UpdatedFactors, factorised
from loops.packing.in_place import LoopsInPlace, loops_in_place
from loops.packing.system import (
    PackingSystem,
    assembled,
    balancing_forces,
    contact_blocks,
    in_freedoms,
    packing_system,
    relative_motion,
    stress_rate,
)
from loops.packing.walls import PlaneContacts, outline_grains, plane_contacts

__all__ = [
    "Carrying",
    "Factor",
    "LoopsInPlace",
    "PackingSystem",
    "PlaneContacts",
    "UpdatedFactors",
    "assembled",
    "balancing_forces",
    "contact_blocks",
    "factorised",
    "in_freedoms",
    "loops_in_place",
    "outline_grains",
    "packing_system",
    "plane_contacts",
    "relative_motion",
    "stress_rate",
]
