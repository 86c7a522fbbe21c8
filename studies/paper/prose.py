"""What the page says of the numbers of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from studies.paper.numbers import POINT_B

ADDED_TABLE_1 = (
    "A departure, see below. At 45° both pairs meet at once; the two branches cross, so that the "
    "loop is no longer planar. Lines break where a contact comes in or leaves."
)
ADDED_TABLE_2 = "A departure, see below. One contact makes two triangles of the diamond."


def short(value: float) -> str:
    """Six significant digits; round-off about zero is zero.

    Parameters
    ----------
    value : float
        What to write.

    Returns
    -------
    str

    Examples
    --------
    >>> from studies.paper.prose import short
    >>> short(1.0 / 3.0), short(-3e-17)
    ('0.333333', '0')
    """
    return "0" if abs(value) < 1e-14 else f"{value:.6g}"


def rounding(value: float) -> str:
    """A difference near round-off, one digit.

    Parameters
    ----------
    value : float
        What to write.

    Returns
    -------
    str
    """
    return f"{value:.0e}"


def verdict(numbers: dict[str, Any]) -> str:
    """The page in one paragraph.

    Parameters
    ----------
    numbers : dict
        From `collect`.

    Returns
    -------
    str
    """
    worst = max(numbers["equations"].values())
    at_B = max(numbers["tables"][k]["point_B_difference"] for k in POINT_B)
    return (
        f"Apart from (8c) and three misprints every equation holds, to {rounding(worst)}. Both "
        "tables are followed to yield and beyond by an exact solution; point B agrees with "
        f"20-digit values to {rounding(at_B)}. What the text says of its figures holds. Four "
        "things depart, each described at the end: the sign in (8c), what Table 2 calls "
        "isotropic, opposite grains that overlap, and the claim of Appendix I. "
    )


def beside_figures(numbers: dict[str, Any]) -> dict[tuple[str, int], str]:
    """What was measured, by the paper's number of a figure and its table.

    Parameters
    ----------
    numbers : dict
        From `collect`.

    Returns
    -------
    dict
    """
    one, two = numbers["tables"][1], numbers["tables"][2]
    return {
        ("Fig. 4", 1): _works(numbers["path_dependence"]),
        ("Fig. 6", 1): _stress(one),
        ("Fig. 7", 1): _determinant(one),
        ("Fig. 8", 2): _stress(two)
        + f" Softening at A is weaker than under Table 1 ({short(one['slopes']['at_A'])} there),"
        " as the paper says.",
        ("Fig. 9", 2): _determinant(two),
        ("Fig. 10", 2): _eigenvalues(two["eigenvalue_gap"]),
        ("Fig. 11", 2): _polar(two["opening"]),
        ("Fig. 12", 2): _cone(two["loading"], two["opening"]),
        ("Equations (27)–(31)", 2): "Agrees: Kmat is symmetric until the contacts slide, where "
        "`K12 - K21` gains `s μ`; Kgeo is symmetric until A, while T is zero.",
        ("Equation (8c)", 1): "A departure, see below: |T| leaves Coulomb's cone.",
        ("Opposite grains, Table 1", 1): ADDED_TABLE_1,
        ("Opposite grains, Table 2", 2): ADDED_TABLE_2,
    }


def departures(numbers: dict[str, Any]) -> list[str]:
    """Where the platform departs from the paper, a paragraph each.

    Parameters
    ----------
    numbers : dict
        From `collect`.

    Returns
    -------
    list of str
    """
    one, two = numbers["tables"][1], numbers["tables"][2]
    return [
        _printed_rule(one["rules"], two["rules"]),
        _isotropic(two["states"]["A"]),
        _opposite_grains(one, two),
        _appendix(numbers["appendix_one"]),
    ]


def _works(works: dict[str, float]) -> str:
    first, second, ratio = (short(works[key]) for key in ("first", "second", "ratio"))
    return (
        f"Agrees: at 45° and D = {short(works['compression'])} the works are {first} and "
        f"{second}, ratio {ratio}; the work depends on the path although nothing dissipates."
    )


def _stress(found: dict[str, Any]) -> str:
    at_A, before, after = (short(found["slopes"][key]) for key in ("at_A", "before_B", "after_B"))
    return (
        f"Agrees: s1 falls from A on, with slope {at_A} at A and nowhere above "
        f"{short(found['slopes']['largest'])}; at B the slope changes from {before} to {after}."
    )


def _determinant(found: dict[str, Any]) -> str:
    states = found["states"]
    before, after = short(states["B"]["det_K"]), short(found["beyond"]["det_K"])
    return (
        f"Agrees: det K vanishes at E1 = {short(states['I']['E1'])}, is negative from there on, "
        f"and jumps at B from {before} to {after}."
    )


def _eigenvalues(gap: dict[str, float]) -> str:
    return (
        "Agrees: the eigenvalues of K and Ks coincide up to A, where K is symmetric, differ by at "
        f"most {short(gap['elastic'])} until B and by up to {short(gap['sliding'])} beyond."
    )


def _polar(opening: dict[str, float]) -> str:
    A, B, beyond = (short(opening[key]) for key in ("A", "B", "beyond"))
    return (
        "Agrees: a single direction at I, cones at A and B. The cone is "
        f"{A}° wide at A and {B}° on arrival at B. At B the operator of sliding contacts, with a "
        f"cone of {beyond}°, governs only directions that make the contacts slide; the opposite "
        "ones unload them. So the diagram at B (full line) is not symmetric about its centre; the "
        "dashed line takes sliding contacts in every direction."
    )


def _cone(loading: dict[str, float], opening: dict[str, float]) -> str:
    return (
        "Agrees: the loading direction lies outside the cone until A (w2 at least "
        f"{short(loading['least_isotropic'])}) and inside from A on (w2 at most "
        f"{short(loading['largest_drained'])}). The cone widens at B "
        f"from {short(opening['B'])}° to {short(opening['beyond'])}°."
    )


def _printed_rule(one: dict[str, Any], two: dict[str, Any]) -> str:
    ratios = [short(rules["printed"]["shear_ratio"]) for rules in (one, two)]
    stress = [short(one[rule]["s1"]) for rule in ("printed", "coulomb")]
    return (
        "**(8c).** With `ζn = sign(un')` as printed, |T| grows while N falls: |T|/(μN) reaches "
        f"{ratios[0]} at {short(one['strain_after_yield'])} of strain after B under Table 1 and "
        f"{ratios[1]} under Table 2. The platform takes `T' = s μ N'` with `s = sign(T)`, which "
        f"keeps it at {short(one['coulomb']['shear_ratio'])}. `--sliding printed` follows the "
        f"printed rule; s1 is then {stress[0]} instead of {stress[1]} at that strain (Table 1)."
    )


def _isotropic(A: dict[str, float]) -> str:
    return (
        "**Table 2 is isotropic in strain, not in stress.** The curves of Figs. 8 and 9 are those "
        f"of E1 = E2 = {short(A['E1'])} at A with s1 = {short(A['s1'])} and s2 = "
        f"{short(A['s2'])}. With s1 = s2 at 35° the contacts would slide from the first touch: "
        "T/N = -cot 70° = -0.364, beyond tan 14° = 0.249."
    )


def _opposite_grains(one: dict[str, Any], two: dict[str, Any]) -> str:
    first, second = one["added"], two["added"]
    return (
        "**Opposite grains.** The paper lets them overlap. Under Table 1 both pairs meet at E = "
        f"{short(first['touching_strains'][0])}, before A; under Table 2 one pair meets at "
        f"{short(second['touching_strains'][1])}, before I. With `--contact-on-touch add` they "
        "make a contact there. Under isotropic strain Ks is then positive definite over "
        f"{_intervals(first['definite_added'])} (Table 1; without, over "
        f"{_intervals(first['definite_ignored'])}) and {_intervals(second['definite_added'])} "
        f"(Table 2; without, over {_intervals(second['definite_ignored'])}). With both contacts "
        "the limit is (1 + κ)/(2 + κ), that of the triangle. In the drained test the smallest "
        f"eigenvalue of Ks stays above {short(first['least_eigenvalue_drained'])} (Table 1) and "
        f"{short(second['least_eigenvalue_drained'])} (Table 2), and s1 rises instead of falling: "
        f"from {short(first['s1_at_A'])} at A to {short(first['s1_end'])} at E1 = "
        f"{short(first['E1_end'])}, and from {short(second['s1_at_A'])} to "
        f"{short(second['s1_end'])} at {short(second['E1_end'])}. So the softening of Figs. 6 and "
        "8 needs opposite grains that pass through each other; the loss of definiteness at I does "
        "not under Table 1, where it comes before they meet."
    )


def _appendix(found: dict[str, float]) -> str:
    return (
        "**Appendix I.** `K^ = D K~ D` with `D = diag(tan(α0)^-1/2, tan(α0)^1/2)` is a "
        "congruence: determinants agree, and so do the signs of the eigenvalues of Ks (they "
        f"differ on {int(found['signs_differ'])} of 1,000 diamonds). The eigenvalues of K "
        f"themselves agree at 45° alone ({rounding(found['gap_at_45_degrees'])}); elsewhere they "
        f"lie apart by up to {short(found['largest_relative_gap'])} times the larger one of `K~`."
    )


def _intervals(pairs: Sequence[tuple[float, float]]) -> str:
    return " and ".join(f"[{short(a)}, {short(b)})" for a, b in pairs)
