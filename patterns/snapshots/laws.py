"""The law of a snapshot: as the user gives it, as columns tell it, and the regimes of contacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from loops import CohesiveFrictional, HertzMindlin, InputError, LinearFrictional, Regime
from loops.arrays import Floats, median
from loops.errors import counted
from loops.laws.frictional import ShearIncrement
from loops.laws.kinds import HERTZ, HERTZ_BAND
from patterns.snapshots.checked import goes_with_root
from patterns.snapshots.checks import SLIDING_SHARE
from patterns.snapshots.findings import rounding
from patterns.snapshots.geometry import Contacts
from patterns.snapshots.source import COHESIVE, LawName, Source
from patterns.snapshots.tables import Table

# Multiples of the rounding of centres above which an overlap tells a law.
SURE_ROUNDINGS = 20.0
TOLD = (
    "Hertz's law, told by the columns: kn goes with the root of the overlap, and N is 2/3 of kn "
    "times it; --law linear if it is another"
)


def told_law(contacts: Contacts, normal: Floats) -> tuple[LawName | None, list[str]]:
    """Return the law that stiffnesses and forces tell, and a note; None where they tell none."""
    table, overlap = contacts.table, contacts.overlap
    # Springs that are all alike are not Hertz's; overlaps that are rounded say nothing.
    if table.has("kn", "ks") and np.ptp(kn := table.column("kn")):
        coarse = SURE_ROUNDINGS * rounding(contacts.bodies.x)
        told = np.flatnonzero((kn > 0) & (normal > 0) & (overlap > coarse))
        kn, own = kn[told], overlap[told]
        with np.errstate(divide="ignore", over="ignore"):
            near = abs(median(normal[told] / (kn * own)) / HERTZ - 1) <= HERTZ_BAND
        if near and goes_with_root(kn, contacts.bodies.radii[contacts.pairs[told]], own):
            return "hertz", [TOLD]
    if table.has("kn", "adhesion"):
        kn, pull = table.column("kn"), table.column("adhesion")
        if pull.any():
            # Most forces are those of the springs less the adhesion, or those of the springs.
            pulls, spring = pull > 0, kn * overlap
            less = np.abs(normal - spring + pull)[pulls]
            attract = median(less) < median(np.abs(normal - spring)[pulls])
            law: LawName = "cohesive" if attract else "bonded"
            return law, [f"law {law!r}, told by the column 'adhesion' and the forces"]
    return None, []


def lacks_of(source: Source, table: Table) -> list[str]:
    """List the options of the law that neither the call nor the table gives."""
    wanted = [("kn", "kn", source.kn)]
    if not frictionless(table, source.mu):
        wanted.append(("kt", "ks", source.kt))
    lacks = [name for name, column, value in wanted if value is None and not table.has(column)]
    if source.law == "hertz" and (lacks or source.young is not None):
        lacks = [n for n in ("young", "poisson") if getattr(source, n) is None]
    if source.law in COHESIVE and source.adhesion is None and not table.has("adhesion"):
        lacks.append("adhesion")
    return lacks


def frictionless(table: Table, mu: float | None) -> bool:
    """Whether no contact has friction, by the column or as given."""
    return not table.column("mu").any() if table.has("mu") else mu == 0


def law_of(
    contacts: Contacts,
    normal: Floats,
    shear: Floats,
    source: Source,
    of_source: ShearIncrement | None,
    notes: list[str],
) -> tuple[LinearFrictional | CohesiveFrictional | HertzMindlin, NDArray[np.int8]]:
    """Law and regime of every contact; assumptions are added to the notes.

    A contact is sliding where the table flags it, else from the forces.
    """
    table = contacts.table

    def parameter(column: str, name: str) -> Floats:
        value = getattr(source, name)
        if table.has(column):
            if value is not None:
                notes.append(f"--{name} {value} not used: the table has the column {column!r}")
            return table.column(column)
        assert value is not None  # a law is made where nothing lacks
        notes.append(f"{column} = {value} for every contact, from --{name}")
        return np.full(len(table), float(value))

    mu = parameter("mu", "mu") if table.has("mu") or source.mu is not None else None
    adhesion = cohesion = np.zeros(len(normal))
    cohesive = source.law in COHESIVE
    if cohesive:
        adhesion = parameter("adhesion", "adhesion")
        cohesion = np.where(np.isfinite(mu), mu, 0.0) * adhesion if mu is not None else cohesion
        if table.has("cohesion") or source.cohesion is not None:
            cohesion = parameter("cohesion", "cohesion")
        else:
            notes.append("cohesion = mu times the adhesion: friction knows N + adhesion")
    slides_at = "cohesion + mu N" if cohesive else "mu N"
    strength = cohesion + (normal if mu is None else mu * normal)
    carries = strength > 0
    if table.has("sliding"):
        sliding = (table.column("sliding") != 0) & carries
    elif mu is not None:
        sliding = (np.abs(shear) >= SLIDING_SHARE * strength) & carries
        notes.append(f"no column 'sliding': sliding where |T| >= {SLIDING_SHARE} {slides_at}")
    else:
        sliding = np.zeros(len(normal), dtype=bool)
        notes.append("neither 'sliding' nor 'mu': every contact is taken as elastic")
    if mu is None:
        # Only the sliding blocks need the friction: |T|/N where the file flags sliding.
        loaded = np.where(normal > 0, normal, 1.0)
        mu = np.where(sliding, np.abs(shear) / loaded, np.inf)
        if sliding.any():
            notes.append("no column 'mu': friction of sliding contacts taken as |T|/N")
    # Nothing sticks without friction, and nothing slides: there is no shear force.
    free = (mu == 0) & (cohesion == 0)
    sliding &= ~free
    chosen = source.shear_increment
    increment = chosen or of_source or "branch"
    if chosen is None and of_source == "radii":
        notes.append(
            "shear increment 'radii', Yade's default: --shear-increment branch if the simulation "
            "had avoidGranularRatcheting=False"
        )
    elif chosen is not None and "radii" in (chosen, of_source):
        other = "" if of_source in (None, chosen) else f", not {of_source!r}"
        notes.append(f"shear increment {chosen!r} as given{other}")
    regime = np.where(sliding, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    if source.law == "hertz":
        young, poisson, ratio = _moduli(contacts, normal, source, notes)
        history = source.shear_history or "force"
        rule = "T stays" if history == "force" else "T goes with kt"
        notes.append(f"Hertz's law, shear history {history!r}: {rule} while the overlap changes")
        law = HertzMindlin(young, poisson, mu, increment, history, ratio)
        ratio = np.where(free, 0.0, law.stiffness_ratio) if free.any() else ratio
        return replace(law, ratio=ratio), regime
    kn = parameter("kn", "kn")
    kt = 0.0 if free.all() else parameter("ks", "kt")
    if free.any():
        kt = np.where(free, 0.0, kt)
        notes.append(f"mu = 0 of {counted(free.sum(), 'contact')}: no shear stiffness, no sliding")
    if cohesive:
        bonded = source.law == "bonded"
        notes.append(f"law {source.law!r}: see CohesiveFrictional")
        return CohesiveFrictional(kn, kt, mu, adhesion, cohesion, bonded, increment), regime
    return LinearFrictional(kn=kn, kt=kt, mu=mu, shear_increment=increment), regime


def _moduli(
    contacts: Contacts, normal: Floats, source: Source, notes: list[str]
) -> tuple[Floats | float, Floats | float, Floats | None]:
    """Young's modulus, Poisson's ratio, and kt/kn where the file gives tangents.

    A tangent `kn = (6 E*^2 R* N)^(1/3)` tells `E*` without the overlap, which a file may round.
    """
    table = contacts.table
    if source.young is not None and source.poisson is not None:
        if table.has("kn") or table.has("ks"):
            notes.append("columns 'kn' and 'ks' not used: --young and --poisson are given")
        return source.young, source.poisson, None
    kn, ks = table.column("kn"), table.column("ks")
    told = (kn > 0) & (normal > 0)
    if not told.any():
        remedy = "Give --young and --poisson."
        raise InputError(f"column 'kn' of {table.path}", "no tangent", "one at a force", remedy)
    radii = contacts.bodies.radii[contacts.pairs]
    reduced = radii.prod(axis=1) / radii.sum(axis=1)
    modulus, ratio = np.empty(len(normal)), np.empty(len(normal))
    # At Poisson's ratio 0 Young's modulus is E/(1 - nu^2) = 2 E*.
    modulus[told] = 2.0 * np.sqrt(kn[told] ** 3 / (6.0 * reduced[told] * normal[told]))
    ratio[told] = ks[told] / kn[told]
    for values in (modulus, ratio):
        values[~told] = median(values[told])
    notes.append(
        f"E/(1 - nu^2) = {median(modulus):.4g} and kt/kn = {median(ratio):.4g} (medians), "
        "from the columns 'kn' and 'ks' as tangents"
    )
    return modulus, 0.0, ratio
