"""The page's fixed text: equations and what they are held against, figures, readings."""

from __future__ import annotations

# Equation numbers, what they say, what they are held against, and the key of the residual.
EQUATIONS = (
    ("(1)–(5)", "relative motion at a contact, spins blocked",
     "complex-step derivatives of length and angle of the branch", "1-5"),
    ("(8a)", "normal force `N = kn (2r - l)`", "grain graph built from the strains", "8a"),
    ("(8b)", "elastic shear `T' = kt l α'`", "derivative of the exact drained path", "8b"),
    ("(9), (10)", "work along the two routes of Fig. 4", "the rate law (8) integrated", "9-10"),
    ("(11), (15), (16)", "diagonals, their rates, contact rates",
     "distances of opposite grains; complex-step derivatives", "11, 15, 16"),
    ("(12)", "balance", "resultants of the contact forces on the grains", "12"),
    ("(13)", "rate form of the balance", "complex-step derivative of (12)", "13"),
    ("(14), (17)–(20)", "tangent `K~` of forces, elastic and sliding",
     "force rates from the contact law", "14, 17-20"),
    ("(21)–(24), (48)", "tangent `K^ = A K~ B` of stresses", "(26)", "21-24, 48"),
    ("(25), (26)", "dimensionless tangent K, elastic and sliding",
     "tangent of any loop on (11, 22), affine and traction closure", "25-26"),
    ("(27), (28), (53)–(57)", "split into Kmat and Kgeo",
     "parts of `K~` transformed; their sum", "27-28, 53-57"),
    ("(29)", "`Kmat12 - Kmat21 = s μ` where sliding", "(27)", "29"),
    ("(30), (31)", "Kgeo symmetric where T = 0", "`Kgeo12 - Kgeo21 = -T/(kn l)`", "30-31"),
    ("(34)–(36)", "det K in closed form", "determinant of (26)", "34-36"),
    ("(37)", "loss of det K", "its left side is `N/(kn l)`, whatever T", "37"),
    ("(38)–(43)", "isotropic strain, `E* = κ/(1 + κ)`", "(26), its determinant", "38-43"),
    ("(44), (45)", "second-order work; Bromwich's inequality",
     "quadratic form of Ks", "44-45"),
    ("(46), (47)", "Love–Weber stress", "nominal stress of the grain graph", "46-47"),
    ("(49)–(52)", "Appendix I: `K^ = D K~ D`",
     "both computed; a congruence, not the similarity claimed (see below)", "49-52"),
)  # fmt: skip
READINGS = """In (18)–(20), (29) and (36) the printed `ζn ζt` is read as `s = sign(T)`: see (8c).
Misprints: (24) is read with Λ for `Λ kt`, the line before (26) with `K = K^/kn` for `kn K^`, (57)
with `S2/kn` for `S2`. (6) and (7) are first-order increments; every path here integrates the rates
(5) instead. (32) and (33), the drained test and its slope, are measured with the tables."""

GIVEN = {
    1: "α0 = 45°, s0 = 0.3, κ = 0.2, φg = 5°",
    2: "α0 = 35°, s0 = 0.35, κ = 0.24, φg = 14°",
}

HEAD = """# The paper, figure by figure

F. Nicot, G. Veylon, H. Zhu, J. Lerbet, F. Darve, *Mesoscopic scale instability in particulate
materials*, J. Eng. Mech. 142 (2016), beside what this platform computes. Made by
`python -m studies.paper --out docs`; every number comes from that run. Lengths are over `l0 = 2r`,
forces over `kn l0`, stresses over `kn`; compression is positive, angles are in degrees,
`κ = kt/kn`, `μ = tan φg`. Differences are the largest found: relative to the size of the quantity
for equations (on 1,000 random diamonds each, elastic and sliding where both apply), absolute for
states. The paper's curves are compared by what its text says of them: it prints no numbers.
"""

# The paper's number, table, the study's name of the figure, and what is to be seen.
FIGURES = (
    ("Fig. 4", 1, "path_dependence", "Two routes to one position of a contact, and their work."),
    ("Fig. 6", 1, "axial_stress", "Axial stress under Table 1, with I, A and B."),
    ("Fig. 7", 1, "determinant", "Determinants of K and Ks under Table 1."),
    ("Fig. 8", 2, "axial_stress", "Axial stress under Table 2, with I, A and B."),
    ("Fig. 9", 2, "determinant", "Determinants of K and Ks under Table 2."),
    ("Fig. 10", 2, "eigenvalues", "Eigenvalues of K and Ks under Table 2."),
    ("Fig. 11", 2, "polar", "Normalised second-order work over the direction at I, A and B."),
    ("Fig. 12", 2, "cone", "Opening of the instability cone and the loading direction."),
    ("Equations (27)–(31)", 2, "split", "Entries of Kmat and Kgeo, and both nonsymmetries."),
    ("Equation (8c)", 1, "sliding_rules", "Coulomb's law and (8c) as printed beyond B."),
    ("Opposite grains, Table 1", 1, "added_contact", "With both contacts added at once."),
    ("Opposite grains, Table 2", 2, "added_contact", "With contacts added where grains meet."),
)
