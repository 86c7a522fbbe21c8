"""Options of the studies of paths: the paper's diamond, a polygon, a snapshot's loop, many orders.

Angles in degrees; grains of diameter 1, `kn = 1`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

import numpy as np

from loops import (
    ContactLaw,
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    RollingResistance,
    contact_state,
    polygon_centroid,
)
from loops.arrays import Floats
from loops.closures import Closure, Spins
from loops.errors import check_choice
from loops.laws.of_pairs import require_linear_springs
from patterns.diamond import TABLE_1, TABLE_2, DiamondParameters, diamond
from patterns.polygons import (
    Orientation,
    compressed_ring,
    polydisperse_polygon,
    regular_polygon,
)
from stability import Programme, Stage, programmes
from stability.path import ModelOption
from stability.paths.loop_path import OnTouch
from studies.output import values_of
from studies.questions import Averaging, DiamondChoice, OfProgramme

if TYPE_CHECKING:
    from patterns import Snapshot

LawName = Literal["linear", "hertz"]
ProgrammeName = Literal[
    "drained", "cauchy-drained", "biaxial", "isotropic", "isotropic-stress", "oedometric",
    "proportional-strain", "undrained",
]  # fmt: skip
TABLES = {1: TABLE_1, 2: TABLE_2}
DIAMOND_PARAMETERS = ("alpha0_deg", "kappa", "phi_deg", "confine")
# Strain of the diamond's path after A.
AFTER_A = 0.3
# Its least strain after B.
AFTER_B = 0.15
# Default end of a polygon's programme: share of the strain between A and 1.
PROGRAMME_SHARE = 0.4
LARGEST_ORDER = 1000
MOST_ORDERS = 40
# Largest order of which a domain is drawn.
LONGEST = 60
# Default end of a programme on a snapshot's loop: E1 over the mean overlap.
PROGRAMME_OVERLAPS = 5.0
RING_NEWTON_STEPS = 20
# Largest move of a grain of a ring whose neighbours shall touch, over the mean diameter.
MOST_MOVED = 0.25


def programme_named(
    name: str,
    *,
    rate: float = 1.0,
    axis: int = 1,
    fluid_bulk_modulus: float | None = None,
    strain_ratio: float | None = None,
) -> Programme:
    """Return the programme of a name on the command line, with the numbers that it asks for."""
    if fluid_bulk_modulus is not None and name != "undrained":
        received, expected = f"given with {name}", "--programme undrained"
        raise InputError("--fluid-bulk-modulus", received, expected, "Leave it out.")
    if (strain_ratio is not None) != (name == "proportional-strain"):
        received = f"{'none' if strain_ratio is None else 'given'} with {name}"
        expected = "a ratio with --programme proportional-strain, and none with others"
        raise InputError("--strain-ratio", received, expected, "Add it, or leave it out.")
    if strain_ratio is not None:
        inside("--strain-ratio", strain_ratio, lambda _: True, "a finite number")
        along, across = rate, strain_ratio * rate
        strains = (along, across) if axis == 1 else (across, along)
        return programmes.proportional_strain(*strains)
    if fluid_bulk_modulus is not None:
        if fluid_bulk_modulus != np.inf:
            expected = "a stress of zero or more, or inf"
            inside("--fluid-bulk-modulus", fluid_bulk_modulus, lambda K: K >= 0.0, expected)
        return programmes.undrained(axis, rate, fluid_bulk_modulus)  # type: ignore[arg-type]
    given = {"rate": rate} if name.startswith("isotropic") else {"rate": rate, "axis": axis}
    return programmes.BY_NAME[name.replace("-", "_")](**given)


@dataclass(frozen=True, kw_only=True)
class DiamondOptions(DiamondChoice):
    """Options of `grainloops diamond`; parameters left out are those of Table 1.

    `confine` is the isotropic strain at A; at 90 degrees of `phi_deg` nothing slides.
    """

    closure: Closure = "affine"
    contact_on_touch: OnTouch = "ignore"
    model: ModelOption = "auto"

    spins: ClassVar[Spins] = "blocked"
    # Least number of rows of a stage: curves through them look smooth.
    rows: ClassVar[int] = 80

    def __post_init__(self) -> None:
        _check_shared(self)
        check_choice("--contact-on-touch", self.contact_on_touch, get_args(OnTouch))
        chosen = [name for name in DIAMOND_PARAMETERS if getattr(self, name) is not None]
        if self.table is not None:
            check_choice("--table", self.table, tuple(TABLES))
            if chosen:
                where, remedy = "--table", "Leave --table out to choose parameters of your own."
                received = f"a table and {', '.join(chosen)}"
                raise InputError(where, received, "one or the other", remedy)
        inside("--alpha0", self.alpha0_deg, lambda a: 0.0 < a < 90.0, "degrees in (0, 90)")
        if self.contact_on_touch == "add":
            expected = "30 to 60 degrees with --contact-on-touch add: elsewhere opposite grains "
            expected += "overlap from the start"
            inside("--alpha0", self.alpha0_deg, lambda a: 30.0 <= a <= 60.0, expected)

    @property
    def parameters(self) -> DiamondParameters:
        """The diamond in radians."""
        given = TABLES[self.table or 1]
        return DiamondParameters(
            alpha0=given.alpha0 if self.alpha0_deg is None else float(np.radians(self.alpha0_deg)),
            kappa=given.kappa if self.kappa is None else self.kappa,
            phi=given.phi if self.phi_deg is None else float(np.radians(self.phi_deg)),
            confinement=given.confinement if self.confine is None else self.confine,
        )

    @property
    def volume(self) -> float:
        """`L10 L20`, the paper's reference area: twice the rhombus."""
        return float(2.0 * np.sin(2.0 * self.parameters.alpha0))

    def graph(self) -> GrainGraph:
        """The barely touching diamond."""
        return diamond(self.parameters.alpha0)

    def law(self) -> LinearFrictional:
        """Linear springs with Coulomb's friction."""
        loop = self.parameters
        return LinearFrictional(1.0, loop.kappa, loop.mu)

    def stages(self, end: float | None = None) -> tuple[tuple[str, Stage], ...]:
        """Isotropic strain to A, then the drained biaxial test; names and stages.

        Without confinement there is no lateral stress: contacts of an angle above that of friction
        open as the test starts, and nothing is left to follow.
        """
        loop = self.parameters
        to_A = ("isotropic", Stage(programmes.isotropic_strain(), "H11", loop.confinement))
        if loop.confinement == 0.0 and (loop.phi <= loop.alpha0 or loop.kappa == 0.0):
            return (to_A,)
        last = self.last_strain() if end is None else end
        return (to_A, ("drained", Stage(programmes.drained_biaxial(), "H11", last)))

    def last_strain(self, at_B: float | None = None) -> float:
        """E1 at the end of the drained test, which goes on beyond B where B is known."""
        confined = self.parameters.confinement
        latest, least = (confined, 0.0) if at_B is None else (at_B, at_B + AFTER_B)
        return min(max(confined + AFTER_A, least), 0.5 * (1.0 + latest))

    def described(self) -> dict[str, Any]:
        """Value of every option by its name on the command line."""
        loop = self.parameters
        return {
            **asdict(self),
            "alpha0_deg": round(float(np.degrees(loop.alpha0)), 12),
            "kappa": loop.kappa,
            "phi_deg": round(float(np.degrees(loop.phi)), 12),
            "mu": loop.mu,
            "confine": loop.confinement,
        }


def given_numbers(options: OfProgramme) -> dict[str, Any]:
    """Return the numbers that a programme asks for, those that were given."""
    numbers = values_of(options, "fluid_bulk_modulus", "strain_ratio")
    return {name: value for name, value in numbers.items() if value is not None}


def programme_of(options: PolygonOptions | Averaging, axis: int = 1) -> Programme:
    """Return the programme after the confinement."""
    return programme_named(options.programme, axis=axis, **given_numbers(options))


@dataclass(frozen=True)
class PolygonOptions(OfProgramme):
    """Options of `grainloops polygon`, lengths over the mean diameter, forces over `kn` times it.

    Of spheres (`contact_law` hertz) `E* = 1`, so that `kn` in units is `E* l0`. `H12 = H21 = 0` in
    all programmes. `centres` are moved by the least that makes neighbours just touch.
    """

    order: int
    orientation: Orientation = "vertex"
    kappa: float = 0.2
    phi_deg: float = 5.0
    closure: Closure = "affine"
    spins: Spins = "blocked"
    confine: float = 0.1
    programme: ProgrammeName = "drained"
    end: float | None = None
    model: ModelOption = "auto"
    radii: tuple[float, ...] | None = None
    centres: tuple[tuple[float, float], ...] | None = None
    contact_law: LawName = "linear"
    rolling: float = 0.0

    volume: ClassVar[float | None] = None
    rows: ClassVar[int] = 40
    contact_on_touch: ClassVar[OnTouch] = "ignore"

    def __post_init__(self) -> None:
        expected = f"a whole number from 3 to {LARGEST_ORDER}"
        where = "--order" if self.radii is None else "number of --radii"
        inside(where, self.order, lambda n: n % 1 == 0 and 3 <= n <= LARGEST_ORDER, expected)
        check_choice("--orientation", self.orientation, get_args(Orientation))
        check_choice("--spins", self.spins, get_args(Spins))
        check_choice("--programme", self.programme, get_args(ProgrammeName))
        programme_of(self)
        _check_shared(self)
        expected = f"a strain above that of A, {self.confine:g}, and below 1"
        inside("--end", self.end, lambda e: self.confine < e < 1.0, expected)
        check_choice("--law", self.contact_law, get_args(LawName))
        inside("--rolling", self.rolling, lambda k: k >= 0.0, "a stiffness of zero or more")
        if self.rolling > 0.0 and self.spins != "free":
            expected = "--spins free: a rolling spring acts only if grains rotate on their own"
            raise InputError("--rolling", f"spins {self.spins}", expected, "Add --spins free.")
        if self.contact_law == "hertz":
            expected = "2 (1 - nu)/(2 - nu) of spheres, from 2/3 (nu = 0.5) to below 4/3"
            inside("--kappa", self.kappa, lambda k: 2 / 3 <= k < 4 / 3, expected)
        if self.radii is not None:
            inside("--radii", self.radii, lambda r: r > 0.0, "positive numbers")
            if self.orientation != "vertex":
                received, remedy = "edge with --radii", "Leave --orientation out."
                raise InputError("--orientation", received, "grain 0 on axis 1", remedy)
            self.graph()

    @property
    def keeps_shape(self) -> bool:
        """Whether isotropic strain scales the loop."""
        return self.radii is None or self.closure == "affine"

    @property
    def last_strain(self) -> float:
        """E1 at the end of the programme."""
        if self.end is not None:
            return self.end
        return round(self.confine + PROGRAMME_SHARE * (1.0 - self.confine), 12)

    @property
    def mu(self) -> float:
        """Friction coefficient, infinite when nothing slides."""
        return float(np.tan(np.radians(self.phi_deg))) if self.phi_deg < 90.0 else float("inf")

    def graph(self, strain: Floats | float = 0.0) -> GrainGraph:
        """The loop, barely touching or under isotropic strain."""
        if self.radii is not None:
            radii = np.array(self.radii) / (2.0 * np.mean(self.radii))
            if self.centres is not None:
                return compressed_ring(self.placed[0], radii, strain, 1.0)
            return polydisperse_polygon(radii, strain=strain)
        return regular_polygon(self.order, orientation=self.orientation, strain=strain)

    @cached_property
    def placed(self) -> tuple[Floats, float]:
        """Centres whose neighbours just touch, and the largest move, over the mean diameter."""
        size, given = 2.0 * np.mean(self.radii), np.array(self.centres)  # type: ignore[arg-type]
        x, radii = (given - polygon_centroid(given)) / size, np.array(self.radii) / size
        x0 = ring_of_lengths(x, radii + np.roll(radii, -1))
        moved = float(np.abs(x0 - x).max())
        if not moved < MOST_MOVED:
            expected = "grains in order, each next to the one before, all around"
            remedy = "Order them around the loop, and give radii with which neighbours touch."
            raise InputError("--centres", f"moves of {moved:.3g} mean diameters", expected, remedy)
        return x0, moved

    def law(self) -> ContactLaw:
        """The law of the contacts, with Coulomb's friction."""
        law: ContactLaw = LinearFrictional(kn=1.0, kt=self.kappa, mu=self.mu)
        if self.contact_law == "hertz":
            nu = 2.0 * (1.0 - self.kappa) / (2.0 - self.kappa)
            law = HertzMindlin(young=2.0 * (1.0 - nu**2), poisson=nu, mu=self.mu)
        return RollingResistance(law, self.rolling) if self.rolling > 0.0 else law

    def stages(self) -> tuple[tuple[str, Stage], ...]:
        """The confinement, left out where there is none, and the programme; names and stages."""
        confining = ("confinement", Stage(programmes.isotropic_strain(), "H11", self.confine))
        loading = Stage(programme_of(self), "H11", self.last_strain)
        first = (confining,) if self.confine > 0.0 else ()
        return (*first, (self.programme, loading))

    def described(self) -> dict[str, Any]:
        """Value of every option by its name on the command line."""
        names = ("order", "orientation", "kappa", "phi_deg", "mu", "closure", "spins", "confine")
        values = values_of(self, *names, "programme", "model")
        return {**values, "end": self.last_strain, **self.special()}

    def special(self) -> dict[str, Any]:
        """Options that make the loop other than a regular one with linear springs."""
        extra: dict[str, Any] = {"law": self.contact_law, "rolling": self.rolling}
        extra |= {"radii": self.radii, "centres": self.centres}
        extra["moved"] = None if self.centres is None else self.placed[1]
        extra = {name: value for name, value in extra.items() if value not in (None, 0.0, "linear")}
        return extra | given_numbers(self)


@dataclass(frozen=True)
class LoopOptions(PolygonOptions):
    """One loop of a snapshot, followed from its state there, which is the reference.

    Lengths are over the mean diameter, stiffnesses and forces over the mean `kn` of its contacts.
    """

    snapshot: Snapshot | None = None
    loop: int = 0
    source: str = ""

    @cached_property
    def taken(self) -> tuple[GrainGraph, LinearFrictional, float]:
        """The loop in these units, its law, and the largest move of a grain to fit the forces."""
        from patterns import loop_of_snapshot

        assert self.snapshot is not None
        scene = loop_of_snapshot(self.snapshot, self.loop)
        given, law = scene.graph, scene.law
        remedy = "Follow it in Python: gl.follow(gl.loop(...))."
        law = require_linear_springs(law, "--law", remedy)
        length, kn = 2.0 * given.radii.mean(), float(np.mean(law.kn))
        law = LinearFrictional(law.kn / kn, law.kt / kn, law.mu, law.shear_increment)
        N, T = (force / (kn * length) for force in (given.normal_force, given.shear_force))
        radii, x0 = given.radii / length, (given.x - given.x.mean(axis=0)) / length
        x = ring_of_lengths(x0, radii + np.roll(radii, -1) - N / law.kn)
        graph = GrainGraph(x=x, radii=radii, contacts=given.contacts)
        # Forces of the overlaps; they agree with the file's to rounding.
        graph = graph.replace(normal_force=law.normal_force(contact_state(graph)), shear_force=T)
        return graph.replace(regime=scene.regime), law, float(np.abs(x - x0).max())

    @property
    def keeps_shape(self) -> bool:
        """False: the state is that of the snapshot, no isotropic strain leads to it."""
        return False

    @property
    def last_strain(self) -> float:
        """E1 at the end of the programme."""
        graph, law, _ = self.taken
        return self.end or float(f"{PROGRAMME_OVERLAPS * np.mean(graph.normal_force / law.kn):.3g}")

    def graph(self, strain: Floats | float = 0.0) -> GrainGraph:
        """The loop as the snapshot has it."""
        return self.taken[0]

    def law(self) -> LinearFrictional:
        """The snapshot's law."""
        return self.taken[1]

    def stages(self) -> tuple[tuple[str, Stage], ...]:
        """The programme, from the state of the snapshot on."""
        return ((self.programme, Stage(programme_of(self), "H11", self.last_strain)),)

    def described(self) -> dict[str, Any]:
        """Value of every option by its name on the command line."""
        values = values_of(self, "order", "closure", "spins", "programme", "model")
        return {**self.special(), **values, "end": self.last_strain}

    def special(self) -> dict[str, Any]:
        """The snapshot, the number of the loop, and how far its grains were moved."""
        taken = {"snapshot": self.source, "loop": self.loop, "moved": self.taken[2]}
        return taken | given_numbers(self)


def loop_options(snapshot: Snapshot, loop: int | None, source: str, **words: Any) -> LoopOptions:
    """Options of one loop of a snapshot; `InputError` if it has none of that number."""
    from patterns import loop_of_snapshot

    order, number = loop_of_snapshot(snapshot, loop).graph.grain_count, loop or 0
    taken: Any = {"snapshot": snapshot, "loop": number, "source": source, "confine": 0.0}
    return LoopOptions(order, **taken, **words)


def ring_of_lengths(x: Floats, lengths: Floats) -> Floats:
    """Centres whose branches (c, c + 1) have these lengths, with the smallest moves (Newton).

    A file that rounds positions gives overlaps that don't fit its forces.
    """
    x, c = x.copy(), np.arange(len(x))
    for _ in range(RING_NEWTON_STEPS):
        d = np.roll(x, -1, axis=0) - x
        size = np.hypot(*d.T)
        if np.abs(size - lengths).max() <= 4.0 * np.finfo(float).eps * lengths.max():
            break
        slopes, n = np.zeros((len(c), len(c), 2)), d / size[:, None]
        slopes[c, c], slopes[c, np.roll(c, -1)] = -n, n
        x += np.linalg.lstsq(slopes.reshape(len(c), -1), lengths - size)[0].reshape(-1, 2)
    return x


@dataclass(frozen=True)
class ComparisonOptions:
    """Orders to compare, and the other options of all loops; the order of `shared` is not used."""

    orders: tuple[int, ...]
    shared: PolygonOptions

    def __post_init__(self) -> None:
        count = len(self.orders)
        if not count or len(set(self.orders)) < count or count > MOST_ORDERS:
            expected = f"1 to {MOST_ORDERS} different orders"
            raise InputError("--compare", str(self.orders), expected, "Write 3-12.")
        for order in self.orders:
            self.of(order)

    def of(self, order: int) -> PolygonOptions:
        """Options of one of the loops."""
        return replace(self.shared, order=order)

    def described(self) -> dict[str, Any]:
        """Value of every option by its name on the command line."""
        described = self.shared.described()
        del described["order"]
        return {"compare": list(self.orders), **described}


def orders_of(text: str) -> tuple[int, ...]:
    """Orders written as '3-12' or '3,4,6-8', ascending, each once."""
    orders: set[int] = set()
    try:
        for part in text.split(","):
            first, _, last = part.partition("-")
            low, high = int(first), int(last or first)
            if not 0 <= high - low < 10 * MOST_ORDERS:
                raise ValueError
            orders.update(range(low, high + 1))
    except ValueError:
        raise InputError(
            "--compare", repr(text), "orders such as 3-12 or 3,4,6-8", "Write them so."
        ) from None
    return tuple(sorted(orders))


def file_notes(options: object) -> list[str]:
    """Return the notes on the file that a loop is from."""
    snapshot = getattr(options, "snapshot", None)
    return [] if snapshot is None else list(snapshot.notes)


def _check_shared(options: DiamondOptions | PolygonOptions) -> None:
    """Check the options that a diamond and a polygon share."""
    check_choice("--closure", options.closure, ("affine", "traction"))
    check_choice("--model", options.model, get_args(ModelOption))
    inside("--kappa", options.kappa, lambda k: k >= 0.0, "a ratio of zero or more")
    inside("--phi", options.phi_deg, lambda p: 0.0 <= p <= 90.0, "degrees in [0, 90]")
    inside("--confine", options.confine, lambda e: 0.0 <= e < 1.0, "a strain in [0, 1)")


def inside(
    name: str, values: float | Sequence[float] | None, holds: Callable[[float], bool], expected: str
) -> None:
    """Raise `InputError` for numbers out of their range or not finite; None is not given."""
    given = [] if values is None else np.atleast_1d(values).tolist()
    wrong = [f"{value:.17g}" for value in given if not (np.isfinite(value) and holds(value))]
    if wrong or (not given and values is not None):
        raise InputError(name, ", ".join(wrong) or "an empty list", expected, f"Correct {name}.")
