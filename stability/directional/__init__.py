"""Second-order work in every direction, in the contact regimes that this direction activates."""

from stability.directional.branches import YieldingContacts as YieldingContacts
from stability.directional.branches import edge_contacts as edge_contacts
from stability.directional.work import BranchFraction as BranchFraction
from stability.directional.work import DirectionalWork as DirectionalWork
from stability.directional.work import branch_fraction as branch_fraction
from stability.directional.work import directional_work as directional_work
