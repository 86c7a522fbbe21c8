"""What the keys of a snapshot's summary mean."""

# What the verdicts on loops assume, and what they are worth.
BLOCKED = "every grain is held from turning, which leaves nearly every loop of any packing stable"
FREED = (
    "grains turn freely and the loop is cut out of its packing, which makes nearly every loop of "
    "five grains and more unstable; inside a packing the other grains hold it"
)
WORTH = (
    "neither says what a loop does in its packing: grainloops series compares both with the work "
    "that loops really did"
)

IN_PLACE = (
    "grains turn freely and all others stand around the loop as they do in the packing; contacts "
    "flagged sliding keep sliding, all others stick; the sample ends at: {boundary}"
)

GEOMETRY = {
    "area": "of the periodic cell, else within the polygons around the network",
    "area_sum": "sum of the areas of the loops",
    "components": "connected parts of the network without dangling grains",
    "contact_fabric": "mean of n (x) n over the contacts between grains; std of each component "
    "over the contacts; anisotropy: difference of the principal values; direction of the larger "
    "one, degrees to axis 1; fourier_amplitude: a of the density of contact directions "
    "(1 + a cos 2(theta - direction))/(2 pi), twice the anisotropy",
    "contact_fabric_by_length": "as contact_fabric, each contact weighted by its branch length",
    "contacts": "contacts between grains",
    "contacts_per_grain": "spread over the grains of the network without dangling ones; its mean "
    "is coordination",
    "coordination": "2 edges / vertices, of the network without dangling grains",
    "coordination_all": "2 contacts / grains, of all grains",
    "dangling_grains": "grains removed because fewer than two contacts are left to them, "
    "those without any contact included",
    "edges": "contacts of the network without dangling grains",
    "elongation_by_order": "spread of the ratio of the principal axes of the loops' areas",
    "euler_ok": "whether Euler's formula holds for every component",
    "faces": "half-edge cycles of the network, outer ones included",
    "grains": "all grains",
    "long_axis": "mean orientation of the loops' long axes, degrees to axis 1, by doubled angles; "
    "resultant from 0 (no axis preferred) to 1 (all alike); std: sqrt(-2 ln resultant)/2, degrees",
    "loop_area_by_order": "spread of the area of the loops",
    "loop_shape": "mean over the loops, weighted by area, of sum e (x) e / sum |e|^2 over the "
    "edges e of a loop: half the unit tensor for a regular polygon of any order; else as "
    "contact_fabric",
    "loops": "bounded faces",
    "mean_order": "mean number of grains of a loop",
    "mean_order_by_area": "the same, each loop weighted by its area",
    "mean_order_from_coordination": "2 z / (z - 2), exact for one cluster that winds around a "
    "periodic cell",
    "order_spread": "spread of the orders of the loops",
    "orders": "number of loops of each order",
    "orders_area": "area of the loops of each order",
    "orders_grouped": "loops and area by order, of 8 and beyond together (8+), and their shares",
    "rattlers": "grains without any contact with a grain; contacts with walls don't count",
    "spread": "mean, std (of the values, not of their mean), quartiles and number of what is "
    "known; by order: 3, 4, 5, 6 and beyond, all",
    "vertices": "grains of the network without dangling ones",
    "wall_contacts": "contacts of grains with walls: they belong to no loop",
}
MECHANICS = {
    "boundary_area": "area that stress_walls and stress_total are taken over",
    "boundary_area_is": "which area that is: within the box of upright walls, else as area",
    "boundary_share": "share of the mean stress that contacts with walls carry: "
    "tr stress_walls / tr stress_total, whatever the area",
    "cone_opening": "spread of the opening (degrees) over the loops that have a cone of negative "
    "second-order work in the plane of (11, 22) strains",
    "eigenvalues": "spread of the three eigenvalues of Ks over the mean kn, symmetric subspace; "
    "spins blocked, of traction_free free",
    "force_chains": "after Peters et al. 2005: grains whose major principal stress is above the "
    "mean, each touching the next within 45 degrees of the axes of both, three at least; "
    "share_of_grains of all grains; loops_beside: share of the loops with a link of a chain among "
    "their contacts (column chain_contacts), which chains.parquet sets beside the others",
    "mean_kn": "mean normal stiffness of the contacts",
    "mean_unstable_directions": "mean over the loops of an order of the share of directions with "
    "negative second-order work",
    "normal_force": "spread over the contacts between grains",
    "sliding_by_order": "spread over the loops of the share of their contacts that slide",
    "sliding_contacts": "share of the contacts between grains that slide, with the standard error "
    "sqrt(p (1 - p)/n) as if they were independent",
    "sliding_fraction": "share of the contacts between grains that slide",
    "soft_loops": "of the unstable loops: mean orientation of their long axes and of soft_angle, "
    "the axis of compression in the mode of the smallest eigenvalue; as long_axis",
    "stress": "Love-Weber stress of the contacts between grains over area; row = force, "
    "column = branch",
    "stress_by_order": "pressure, deviator and tensor of the loops' stress, each contact shared "
    "half and half between its two loops; mean and std weighted by area, quartiles not",
    "stress_loops": "sum of stress times area over the loops, over area: lacks dangling "
    "contacts, and half of each contact on the outline",
    "stress_total": "stress of the contacts between grains and with walls over boundary_area",
    "stress_walls": "(1/boundary_area) sum f (x) branch over the contacts with walls, branch from "
    "the wall to the grain's centre, f on the grain",
    "unstable_by_order": "share of the loops that are unstable, by groups of orders, with the "
    "standard error sqrt(p (1 - p)/n) as if loops were independent",
    "unstable_directions": "spread over the loops of the share of directions with negative "
    "second-order work",
    "unstable_loops": "share of the loops of an order with a negative eigenvalue of Ks beyond the "
    "tolerance, symmetric subspace, contacts flagged sliding as sliding; affine and traction: "
    f"{BLOCKED}; traction_free: {FREED}",
    "untrusted_loops": "loops whose tangent is not trusted, or the sign of whose smallest "
    "eigenvalue is within its error: left out wherever it is needed",
    "wall_force": "spread of the size of the forces of the walls",
}
PACKING = {
    "in_packing": "how loops were judged in their packing: the method, the radius of patches in "
    "mean diameters; what drives the sample from outside; grains with fewer than two contacts "
    "(pruned), clusters that nothing holds and their grains: they carry nothing",
    "packing_error": "spread of the stated error of the operators in place, relative to the whole "
    "packing: 99 of 100 loops are within theirs while the packing itself is stable",
    "surroundings_positive": "share of the loops whose surroundings A_env = A_in - A_loop resist "
    "every strain: smallest eigenvalue in the symmetric subspace above zero",
    "surroundings_share": "spread of the surroundings' share of the trace of A_in, symmetric "
    "subspace: 1 - tr A_loop / tr A_in, A_loop with free spins; loops whose A_loop is undetermined "
    "are left out",
}
