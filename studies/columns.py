"""What every column of a result table is: for the files themselves and for `docs/columns.md`."""

from __future__ import annotations

from fnmatch import fnmatchcase
from functools import cache

STRESS = "force/length"
KS = "the symmetric part of the tangent, in the symmetric subspace"
JUDGES = (
    "before it the judge: affine, traction (spins blocked), traction_free (spins free, cut out of "
    "the packing) or packing (in place, spins free)"
)
DRIVEN = "components 11, 12, 21, 22, rows first; compression positive"
# Of these commands; tables of others share names, not meanings.
COMMANDS = ("snapshot", "series", "probe", "evolve", "diamond", "polygon", "domain")
# Pattern of a name: unit, meaning. `table:name` or `command:name` where the name is another thing
# there; a name written out comes before a pattern. Lengths and forces are those of the input; `kn`
# and `l0` in a unit are what the number has been divided by.
COLUMNS: dict[str, dict[str, tuple[str, str]]] = {
    "Snapshots, series and probes": {
        "loop": ("", "number of the loop in its snapshot, from 0"),
        "order": ("1", "number of grains of the loop; of a skill by order 8 stands for all beyond"),
        "grains": ("", "ids of the loop's grains, counter-clockwise"),
        "evolution:grains": ("1", "number of grains"),
        "x": ("length", "centroid of the loop's polygon, axis 1"),
        "y": ("length", "centroid of the loop's polygon, axis 2"),
        "area": ("length^2", "area of the loop's polygon, at the earlier snapshot of an interval"),
        "orders:area": ("length^2", "area of all loops of the order"),
        "evolution:area": ("length^2", "area of the periodic cell, else within the outline"),
        "perimeter": ("length", "of the loop's polygon"),
        "elongation": ("1", "ratio of the long to the short principal axis of the loop's area"),
        "orientation": ("degree", "long axis from axis 1, in (-90, 90], counter-clockwise"),
        "sliding_contacts": ("1", "contacts of the loop that are flagged sliding"),
        "stress_[12][12]": (STRESS, "Love-Weber stress of the loop, (1/2V) sum f (x) d over its "
                            "contacts; row = force, column = branch; compression positive"),
        "pressure": (STRESS, "(stress_11 + stress_22)/2"),
        "deviator": (STRESS, "half the difference of the principal stresses of the symmetric part"),
        "chain_contacts": ("1", "contacts of the loop that are links of force chains"),
        "place": ("", "loops beside force chains, with a link among their contacts; or elsewhere"),
        "orders": ("", "group of orders, or all"),
        "chains:mean_order": ("1", "mean order of these loops"),
        "chains:*_lambda_min": ("kn", "median of *_lambda_min"),
        "*_unstable_error": ("1", "standard error of the share, as if loops were independent"),
        "surroundings_lambda_min": ("kn", f"smallest eigenvalue of {KS}, of what surrounds the "
                                    "loop; over the mean kn"),
        "*_lambda_min": ("kn", f"smallest eigenvalue of {KS}, over the mean kn: below zero the "
                         f"loop is unstable; {JUDGES}"),
        "*_lambda_mid": ("kn", "the eigenvalue between smallest and largest, as *_lambda_min"),
        "*_lambda_max": ("kn", "the largest eigenvalue, as *_lambda_min"),
        "affine_unstable_fraction": ("1", "share of strain directions with W2 < 0, in the "
                                     "symmetric subspace, affine closure"),
        "traction_unstable_fraction": ("1", "the same, traction closure"),
        "packing_unstable_fraction": ("1", "the same, in the packing"),
        "*_cone_opening": ("degree", "width of the cone of W2 < 0 in the plane of (11, 22) "
                           "strains, 0 if there is none"),
        "*_soft_angle": ("degree", "axis of compression of the mode of the smallest eigenvalue, "
                         "from axis 1, in (-90, 90]"),
        "traction_condition": ("1", "factor by which rounding may have been amplified"),
        "packing_error": ("1", "stated error of the operator in place over its norm; 0 for the "
                          "whole packing"),
        "orders:loops": ("1", "number of loops of the order"),
        "*_unstable_loops": ("1", "share of the loops of the order with *_lambda_min < 0"),
        "surroundings_*": ("1", "quartile or median over the loops of the order of the "
                           "surroundings' share of the trace of the operator in place"),
        "angle": ("degree", "centre of a bin of contact directions, from axis 1"),
        "count": ("1", "contacts in the bin"),
        "density": ("1/rad", "density of contact directions over the full turn"),
        "second_order": ("1/rad", "(1 + a cos 2(theta - direction))/(2 pi) of the summary's "
                         "contact_fabric"),
        "snapshot": ("", "number of the snapshot in the order given, from 0"),
        "step": ("", "time step that the file tells"),
        "snapshot_before": ("", "number of the earlier snapshot of an interval"),
        "snapshot_after": ("", "number of the later snapshot of an interval"),
        "loop_before": ("", "column loop of the earlier snapshot; -1 of a loop that was born"),
        "loop_after": ("", "column loop of the later snapshot"),
        "rotation": ("degree", "mean turn of the loop, counter-clockwise"),
        "dP[12][12]": (STRESS, "nominal stress increment of the loop, (1/2V0) sum (f - f0) (x) d0"),
        "hill_work": (STRESS, "dP : H, not blind to rotation"),
        "hill_cosine": ("1", "hill_work/(|dP| |H|)"),
        "W2": (STRESS, "second-order work; of a loop in the frame that turns with it: "
               "(R^T P - P0) : (1 - U), with 1 - H = R U"),
        "w2": ("1", "W2 over the sizes of its two factors, from -1 to 1"),
        "*_W2": (STRESS, "W2 as foretold: e.A e/2 with the strain e that the loop took; before it "
                 "closure and spins (blocked where no word stands)"),
        "packing_W2": (STRESS, "W2 over the interval as foretold by the packing's rate problem"),
        "packing_w2": ("1", "packing_W2 over the sizes of its two factors"),
        "packing_work": (STRESS, "additive work -(1/2V) sum f'.d': areas times it sum to the "
                         "sample's"),
        "packing_nonaffinity": ("1", "nonaffinity as foretold"),
        "nonaffinity": ("1", "|strain of the loop - strain of the sample|/|strain of the sample|"),
        "packing_opening": ("1", "share of the interval until a contact of the loop opens; "
                            "infinite if none does"),
        "packing_closing": ("1", "share of the interval until a gap across the loop closes; "
                            "infinite if none does"),
        "path_w2": ("1", "w2 over the interval at the end of the packing's path by events"),
        "path_nonaffinity": ("1", "packing_nonaffinity at the end of the path by events"),
        "path_opening": ("1", "packing_opening by the overlaps at the end of the path by events"),
        "path_closing": ("1", "packing_closing by the gaps at the end of the path by events"),
        "replay_w2": ("1", "w2 over the interval at the end of the packing's replay from rest"),
        "replay_nonaffinity": ("1", "packing_nonaffinity at the end of the replay"),
        "replay_opening": ("1", "packing_opening by the overlaps at the end of the replay"),
        "replay_closing": ("1", "packing_closing by the gaps at the end of the replay"),
        "own_w2": ("1", "packing_w2 by the motion that the grains really had"),
        "own_opening": ("1", "packing_opening by the same"),
        "own_closing": ("1", "packing_closing by the same"),
        "packing_status": ("", "of the rate problem: unique, several found, none, not converged; "
                           "refused where there is none"),
        "packing_proof": ("", "what stands behind the number of solutions"),
        "packing_residual": ("1", "force rate out of balance over that of the affine motion"),
        "packing_disagreeing": ("1", "contacts whose regime doesn't agree with their rates"),
        "packing_sliding": ("1", "contacts that slide in the rate problem"),
        "packing_candidates": ("1", "contacts within the yield band"),
        "packing_settled": ("1", "contacts at yield of a grain with two contacts: they stick"),
        "packing_rattlers": ("1", "grains left out: they carry nothing"),
        "packing_boundary": ("", "where the sample ends"),
        "fate": ("", "what became of the loop: survived, split, merged, changed, died; born, of "
                 "a later loop without a predecessor"),
        "successor": ("", "the later loop that shares most half-edges, -1 for none"),
        "successors": ("", "all later loops that share half-edges, ascending"),
        "*_verdict": ("", "of the earlier loop, by the sign of *_lambda_min: stable, unstable, "
                      "undetermined; empty of one that was born"),
        "judge": ("", "who judged: affine, traction, traction_free; as before *_lambda_min"),
        "verdict": ("", "stable, unstable or undetermined"),
        "survival:order": ("1", "order of the earlier loops, 8 for all beyond, 0 for all orders"),
        "survival:loops": ("1", "earlier loops of the verdict and order"),
        "share": ("1", "share that survived the interval"),
        "share_low": ("1", "lower end of its 95 % interval by Wilson's score"),
        "share_high": ("1", "upper end of it"),
        "contact_lost": ("", "whether a contact of the loop opened"),
        "smallest_N": ("1", "smallest normal force of the loop's contacts over the mean"),
        "name": ("", "name of the snapshot"),
        "contacts": ("1", "contacts between grains"),
        "loops": ("1", "number of loops"),
        "coordination": ("1", "2 edges/vertices of the network without dangling grains"),
        "mean_order": ("1", "mean number of grains of a loop"),
        "share_[3-8]": ("1", "share of the loops of this order; 8 stands for all beyond"),
        "area_share_[3-8]": ("1", "share of their area; 8 stands for all beyond"),
        "S[12][12]": (STRESS, "Love-Weber stress of the contacts between grains over area"),
        "sliding_fraction": ("1", "share of the contacts that slide"),
        "*_unstable": ("1", "share of the loops, of those judged, with *_lambda_min < 0"),
        "H[12][12]": ("1", "displacement gradient: of the loop by the boundary formula, of the "
                      f"sample since the first snapshot, of a probe's direction; {DRIVEN}"),
        "dH[12][12]": ("1", "displacement gradient of the sample over the interval before"),
        "shear_strain": ("1", "sum of (e1 - e2)/2 of the intervals' principal stretches"),
        "strain_from": ("", "where the strain is known from: cell, grains, unknown"),
        "opened": ("1", "contacts lost over the interval before"),
        "closed": ("1", "contacts gained over the interval before"),
        "survived": ("1", "earlier loops with the same contacts later"),
        "split": ("1", "earlier loops divided into several by new contacts"),
        "merged": ("1", "earlier loops that became one with others as contacts opened"),
        "changed": ("1", "earlier loops of any other fate, as an exchange of contacts"),
        "died": ("1", "earlier loops without a successor"),
        "born": ("1", "later loops without a predecessor"),
        "negative_W2": ("1", "survived loops with W2 < 0"),
        "*_W2_*_*": ("1", "survived loops by the sign of the actual, then of the foretold W2"),
        "order_before": ("1", "order of the earlier loop, 0 for none"),
        "order_after": ("1", "order of its successor, 0 for none"),
        "exchange:loops": ("1", "loops that went from one order to the other"),
        "order_1": ("1", "smaller order of a pair of loops"),
        "order_2": ("1", "larger order of the pair"),
        "order_merged": ("1", "order_1 + order_2 - 2, of the loop that they merge into"),
        "openings": ("1", "contacts between the two that opened, each alone in its interval"),
        "closings": ("1", "contacts that closed and left the two, each alone in its interval"),
        "opening_rate": ("1/time", "openings over the time integral of N_1 N_2/G (of two alike "
                         "N (N - 1)/2 G), G = sum (n - 2) N_n/2; time as kinetics of the summary "
                         "says"),
        "closing_rate": ("1/time", "closings over the time integral of the number of loops of "
                         "order_merged"),
        "*ing_rate_low": ("1/time", "lower limit of the rate, 95 %, Poisson's counts"),
        "*ing_rate_high": ("1/time", "upper limit of the rate, 95 %, Poisson's counts"),
        "balance_z": ("1", "(openings - closings)/sqrt(openings + closings)"),
        "balance_p": ("1", "exact two-sided level of the pair under detailed balance"),
        "observed_share": ("1", "share of the loops, mean over the time of the series"),
        "steady_share": ("1", "share in the steady state of the rates; NaN: too few events"),
        "steady_error": ("1", "its standard error by Poisson's counts"),
        "predictor": ("", "what foretells, see docs/series.md"),
        "target": ("", "what is foretold, see docs/series.md"),
        "base": ("1", "share of the loops for which the target came true"),
        "coverage": ("1", "share of the loops that have a score"),
        "agreement": ("1", "share of right signs"),
        "precision": ("1", "share that came true, of those foretold"),
        "recall": ("1", "share that was foretold, of those that came true"),
        "auc": ("1", "chance that of two loops the one that came true is ranked first"),
        "rank_correlation": ("1", "Spearman's, of score and outcome"),
        "skill*:loops": ("1", "loops with a score"),
        "probe_w2": ("1", "smallest normalised second-order work of the sample over (11, 22)"),
        "probe_theta_deg": ("degree", "its direction"),
        "probe_unstable_fraction": ("1", "share of directions with W2 < 0"),
        "probe_cone_*_deg": ("degree", "edges of the widest cone of W2 < 0"),
        "probe_undetermined": ("1", "directions without a solution that could be found"),
        "theta_deg": ("degree", "direction of H' or P' (by --control), tan theta = 22/11"),
        "P[12][12]": (STRESS, "nominal stress: of a probe its rate per unit of the direction, with "
                      f"--amplitude its increment over that; of a path the whole; {DRIVEN}"),
        "elastic_H[12][12]": ("1", "H' with all contacts at yield sticking"),
        "elastic_P[12][12]": (STRESS, "P' with all contacts at yield sticking"),
        "probe:status": ("", "unique, several found, none, not converged; with --amplitude that "
                         "of the path: finished, instabilities, no_solution, lost"),
        "sliding": ("1", "contacts that slide"),
        "disagreeing": ("1", "contacts whose regime doesn't agree with their rates"),
        "residual": ("1", "force rate out of balance over that of the affine motion"),
        "piece": ("", "number of the set of regimes, -1 where undetermined"),
        "begin_deg": ("degree", "angle from which the piece holds"),
        "end_deg": ("degree", "angle up to which the piece holds"),
        "directions": ("1", "probed directions that met the piece"),
        "pieces:K[1-3][1-3]": (STRESS, "tangent of the piece on the subspace"),
        "orders:order": ("1", "number of grains of the loops; 0: contacts in no loop or in one"),
        "area_share": ("1", "area of the loops of the order over that of all loops"),
        "orders:W2": (STRESS, "their part of the sample's second-order work"),
        "loops:W2": (STRESS, "the loop's part of the sample's W2 in the softest direction"),
        "W2_share": ("1", "W2 over the sample's"),
        "negative": (STRESS, "sum over the loops of the order with negative work"),
        "negative_share": ("1", "negative over that of all orders"),
        "additive_w": (STRESS, "W2 times the sample's area over the loop's own"),
    },
    "The path of a packing": {
        "row": ("", "row of the path, from 0"),
        "driven": ("1", "strain that the programme drives (isotropic-stress: the stress), "
                   "zero at the first snapshot"),
        "evolve:H[12][12]": ("1", "displacement gradient since the first snapshot, of the sample "
                             f"or of the loop; {DRIVEN}"),
        "evolve:P[12][12]": (STRESS, "nominal stress of the sample; of a loop its increment since "
                             f"the first snapshot; {DRIVEN}"),
        "evolve:work": ("force length", "external work since the start"),
        "slip_work": ("force length", "heat of sliding since the start"),
        "shear_work": (
            "force length",
            "what the law's shear increment leaves of T times the motion at the contacts",
        ),
        "released": (
            "force length",
            "work of what was out of balance: kinetic and viscous loss at instabilities",
        ),
        "energy": ("force length", "of the springs"),
        "evolve:imbalance": ("1", "largest drift of a grain's resultant over the mean force"),
        "events": ("1", "events so far"),
        "evolve:kind": ("", "of the event: a change of regime, or instability"),
        "contact": ("", "number of the contact"),
        "passed": ("", "how an instability was passed"),
        "detail": ("", "what happened, in words"),
        "evolve:W2": (STRESS, "second-order work of the loop from the start to the end, in the "
                      "frame that turns with it"),
        "evolve:additive_w": (STRESS, "additive work -(1/2V) sum f'.d' from the start to the end"),
        "negative_row": ("", "first row at which the loop's W2 is negative, -1 for none"),
        "negative_from": ("1", "driven at that row"),
    },
    "Diamonds, polygons and domains": {
        "stage": ("", "stage of the programme"),
        "parameter": ("1", "loading parameter within the path"),
        "regime": ("", "open, elastic or sliding; a polygon: a list, one a contact; polar "
                   "diagrams: that the direction activates"),
        "E1": ("1", "strain 1 - L1/L10, H11 of a polygon; compression positive"),
        "E2": ("1", "strain 1 - L2/L20, H22 of a polygon; compression positive"),
        "s1": ("kn", "nominal stress F1/(kn L20), P11/kn of a polygon; compression positive"),
        "s2": ("kn", "nominal stress F2/(kn L10), P22/kn of a polygon; compression positive"),
        "s12": ("kn", "nominal shear stress P12/kn, row = force"),
        "s21": ("kn", "nominal shear stress P21/kn"),
        "alpha_deg": ("degree", "angle of the branches, of Fig. 4 the turn of the branch"),
        "l": ("l0", "branch length"),
        "N": ("kn l0", "normal force, compression positive; a polygon: a list, one a contact"),
        "T": ("kn l0", "shear force, of a diamond positive when alpha grows; a polygon: a list"),
        "path:x": ("l0", "centres of the grains, axis 1: a list"),
        "path:y": ("l0", "centres of the grains, axis 2: a list"),
        "K[12][12]": ("kn", "tangent of s' = K E', equation (26)"),
        "Kmat[12][12]": ("kn", "its part of the contact law, equation (27)"),
        "Kgeo[12][12]": ("kn", "its part of the stresses, equation (28)"),
        "A[12][12]_[12][12]": ("kn", "tangent of P' = A H', stress component, strain component"),
        "det_K": ("kn^2", "determinant of K, of a polygon on (11, 22)"),
        "det_Ks": ("kn^2", "determinant of the symmetric part of K"),
        "lambda_[12]": ("kn", "eigenvalues of the symmetric part of K, ascending"),
        "eigenvalue_[12]_real": ("kn", "real part of the eigenvalues of K"),
        "eigenvalue_[12]_imag": ("kn", "imaginary part of the eigenvalues of K"),
        "path:status": ("", "of the second-order work: stable, unstable, undetermined"),
        "cone_status": ("", "empty, ray, open, all or undetermined"),
        "cone_opening_deg": ("degree", "width of the cone of W2 < 0 in (11, 22), 0 if a ray"),
        "cone_axis_deg": ("degree", "its axis, from E1 towards E2"),
        "cone_edge_[12]_deg": ("degree", "its edges, from E1 towards E2"),
        "unstable_fraction": ("1", "share of directions of (11, 22) with W2 < 0"),
        "unstable_fraction_*": ("1", "the same in the subspace diagonal, symmetric or full"),
        "lambda_min": ("kn", "smallest eigenvalue of Ks on (11, 22)"),
        "lambda_min_*": ("kn", "smallest eigenvalue of Ks in the subspace"),
        "loading_alphaE_deg": ("degree", "the path's own direction, tan alphaE = E1'/E2'"),
        "w2_loading": ("1", "normalised second-order work along it"),
        "gap_[12]": ("l0", "gap between opposite grains along the axis, negative: they overlap"),
        "chord_[12]": ("kn l0", "force of the contact added between opposite grains"),
        "work": ("kn", "work from outside since the start, over the reference area"),
        "stored": ("kn", "elastic energy of the contacts, over the reference area"),
        "dissipated": ("kn", "heat of sliding, over the reference area"),
        "energy_error": ("1", "what lacks in the balance of work, over its largest term"),
        "imbalance": ("1", "largest unbalanced force on a grain over kn sqrt(V0); nan under the "
                      "affine closure, which doesn't balance grains"),
        "state": ("", "named state: I, A or B"),
        "alphaE_deg": ("degree", "direction of the strain rate, tan alphaE = E1'/E2'"),
        "polar:x": ("1", "(2 + w2) cos alphaE, equation (45)"),
        "polar:y": ("1", "(2 + w2) sin alphaE"),
        "compression": ("l0", "compression of the branch in Fig. 4"),
        "shear_then_compress*": ("kn l0^2", "work of the route (9); integrated: of the rate law"),
        "compress_then_shear*": ("kn l0^2", "work of the route (10); integrated: of the rate law"),
        "opposite": ("", "contacts between opposite grains: ignored or added"),
        "id": ("", "number of the grain"),
        "grains_A:x": ("l0", "centre of the grain, axis 1"),
        "grains_A:y": ("l0", "centre of the grain, axis 2"),
        "radius": ("l0", "radius of the grain"),
        "id[12]": ("", "grains of the contact"),
        "branch_[xy]": ("l0", "from the first grain's centre to the second's"),
        "fn": ("kn l0", "normal force, compression positive"),
        "fs[xy]": ("kn l0", "shear force of the first grain on the second"),
        "kn": ("kn", "normal stiffness"),
        "ks": ("kn", "tangential stiffness"),
        "mu": ("1", "coefficient of friction"),
        "critical_strain_*": ("1", "isotropic strain at which Ks is first lost in the subspace"),
        "first_yield_E[12]": ("1", "strain at which contacts first reach |T| = mu N"),
        "first_yield_s1": ("kn", "s1 there"),
        "peak_E[12]": ("1", "strain at the largest s1 after the confinement"),
        "peak_s1": ("kn", "largest s1 after the confinement"),
        "end_E1": ("1", "E1 at the end of the path"),
        "compare:status": ("", "of the path: finished, or why it ends before"),
        "alpha0_deg": ("degree", "branch angle of the reference"),
        "kappa": ("1", "kt/kn"),
        "phi_deg": ("degree", "friction angle"),
        "domain:contacts": ("", "sticking (never slide) or frictional"),
        "kind": ("", "what is lost: det_Ks_zero or det_K_zero"),
        "programme_deg": ("degree", "angle of the straight strain path from E1 to E2"),
        "opposite_overlap": ("", "whether opposite grains overlap there"),
    },
}  # fmt: skip


@cache
def described(place: str, column: str) -> tuple[str, str] | None:
    """Unit and meaning of a column of `command/table`; None where these commands have none."""
    command, _, table = place.partition("/")
    if command not in COMMANDS:
        return None
    known = {pattern: said for part in COLUMNS.values() for pattern, said in part.items()}
    for name in (f"{command}:{column}", f"{table}:{column}", column):
        if name in known:
            return known[name]
        for pattern, said in known.items():
            if (":" in pattern) == (":" in name) and fnmatchcase(name, pattern):
                return said
    return None


def metadata(place: str, column: str) -> dict[bytes, bytes] | None:
    """The same for the field of a Parquet file."""
    said = described(place, column)
    return None if said is None else {b"unit": said[0].encode(), b"meaning": said[1].encode()}
