"""Second-order work in every direction, in the contact regimes that this direction activates."""

from stability.directional.edge import EdgeContacts, edge_contacts
from stability.directional.fraction import BranchFraction, branch_fraction
from stability.directional.work import DirectionalWork, directional_work

__all__ = [
    "BranchFraction",
    "DirectionalWork",
    "EdgeContacts",
    "branch_fraction",
    "directional_work",
    "edge_contacts",
]
