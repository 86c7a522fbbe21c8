"""Options of each question: those of its command, of its study and of its provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from cyclopts import Group, Parameter, Token

from loops.errors import InputError

Options = TypeVar("Options")
# Everyday options come first in the help of a command, all others in this group.
FURTHER, EVERYDAY = Group("Further options", sort_key=1), "Parameters"


def parse_whole_number(kind: Any, tokens: Sequence[Token]) -> int:
    """Return the whole number of an option; the library's own converter rounds 6.5 to 6."""
    with suppress(ValueError):
        number = float(tokens[0].value)
        if number.is_integer():
            return int(number)
    raise ValueError(f"got {tokens[0].value}, expected a whole number")


def parse_turns(kind: Any, tokens: Sequence[Token]) -> float | tuple[float, ...]:
    """Return the number of an option, or several numbers between commas."""
    with suppress(ValueError):
        turns = tuple(float(part) for part in tokens[0].value.split(","))
        return turns if len(turns) > 1 else turns[0]
    raise ValueError(f"got {tokens[0].value}, expected a number, or several between commas")


Whole = Annotated[int, Parameter(converter=parse_whole_number)]
ClosureOption = Annotated[
    str, Parameter(help="Loading of the loop by its surroundings: affine or traction.")
]
Phi = Annotated[
    float | None, Parameter(name="--phi", help="Friction angle of the contacts (degrees).")
]
Instabilities = Annotated[
    Whole, Parameter(group=FURTHER, help="Number of unstable contacts at which the path stops.")
]
Damping = Annotated[float, Parameter(group=FURTHER, help="Cundall's damping of the replays.")]
AsGiven = Annotated[
    bool,
    Parameter(
        negative=(),
        group=FURTHER,
        help="Keep the order of the files. Default: by step, else by name.",
    ),
]
Regions = Annotated[str | None, Parameter(group=FURTHER, metavar="COLUMN>VALUE|FILE")]
Cells = Annotated[
    Path | None,
    Parameter(help="Table of periodic cells with columns snap, h_xx, h_xy, h_yx, h_yy."),
]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Continuing:
    """Continuation of a path past an unstable contact.

    Parameters
    ----------
    past
        Past an unstable contact: viscous or dynamic (inertial) motion, or stop.
    """

    past: Annotated[str, Parameter(group=FURTHER, metavar="NAME")] = "viscous"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Yielding(Continuing):
    """Contacts that may slide.

    Parameters
    ----------
    yield_band
        Least |T|/(mu N) of contacts that may slide in a tangent or a probe.
    candidates
        Least |T|/(mu N) of contacts that may slide in a finite increment.
    """

    yield_band: Annotated[float, Parameter(group=FURTHER)] = 0.99
    candidates: Annotated[float, Parameter(group=FURTHER)] = 0.7


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OfProgramme:
    """Numbers that some programmes ask for.

    Parameters
    ----------
    fluid_bulk_modulus
        Bulk modulus of the fluid over the porosity, for undrained (stress; for a regular loop over
        kn). Default: infinite.
    strain_ratio
        Strain across over the driven strain, for proportional-strain.
    """

    fluid_bulk_modulus: Annotated[float | None, Parameter(group=FURTHER)] = None
    strain_ratio: Annotated[float | None, Parameter(group=FURTHER)] = None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Snapshotting:
    """Options of `snapshot`.

    Parameters
    ----------
    in_packing
        Judge the loops in their packing too: the whole packing at once, blocks of it (less memory,
        larger errors), or auto (by the number of grains).
    hold
        Bring the state to rest first, at fixed cell or between its walls: a share of loops unstable
        in their packing is one of a state at rest.
    yield_band
        Least |T|/(mu N) of contacts that slide in a loop's packing at rest. Default: 0.999999,
        0.999 and 0.99.
    input_error
        Errors of the file: digits (half a unit in the last place of its numbers), or that of a
        contact's force as a share of it, and of kn and kt: 0.1,0.05. Adds which signs are certain.
    regions
        Loops inside beside all others: a threshold on a column, deviator>120, or a table of corners
        x, y of polygons by their names, region.
    quadrons
        Write quadrons.parquet: area and shape of the quadrilateral that each loop has in common
        with each of its grains.
    paraview
        Write loops.vtp for ParaView.
    """

    in_packing: Annotated[str | None, Parameter(metavar="auto|whole|blocks")] = None
    hold: bool = False
    yield_band: Annotated[float | None, Parameter(group=FURTHER)] = None
    input_error: Annotated[str | None, Parameter(metavar="digits|FORCE,...")] = None
    regions: Regions = None
    quadrons: Annotated[bool, Parameter(group=FURTHER)] = False
    paraview: Annotated[bool, Parameter(group=FURTHER, name="--vtk")] = False


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Holding:
    """Whether a state is brought to rest first, by the names of the studies.

    Parameters
    ----------
    hold
        Bring the state to rest first, at fixed cell or between its walls.
    hold_stress
        Bring the state to rest first, at fixed stress.
    """

    hold: bool = False
    hold_stress: Annotated[bool, Parameter(group=FURTHER)] = False

    @property
    def control(self) -> Literal["strain", "stress"] | None:
        """Quantity held fixed while the state comes to rest; `InputError` if both are given."""
        if self.hold and self.hold_stress:
            raise InputError("--hold, --hold-stress", "both", "one of them", "Leave one out.")
        return "strain" if self.hold else "stress" if self.hold_stress else None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Probing(Yielding):
    """Options of `probe`.

    Parameters
    ----------
    directions
        Number of directions.
    control
        Which increment is prescribed in each direction.
    subspace
        Components that change: 11 and 22 (directions on a circle), or 12 too (sphere).
    amplitude
        Size (strain) of finite probes. Default: infinitesimal probes.
    by
        How --amplitude is reached: from event to event, or in one solve.
    """

    directions: Whole = 72
    control: Annotated[str, Parameter(metavar="strain|stress")] = "strain"
    subspace: Annotated[str, Parameter(group=FURTHER, metavar="diagonal|symmetric")] = "diagonal"
    amplitude: float | None = None
    by: Annotated[str, Parameter(group=FURTHER, metavar="events|increment")] = "events"


@Parameter(name="*", group=FURTHER)
@dataclass(frozen=True, kw_only=True)
class Sustaining:
    """Options of `sustain`.

    Parameters
    ----------
    directions
        Number of directions of the stress rate.
    subspace
        Stress components that change: 11 and 22, or 12 too.
    largest
        Largest load (force/length) in each direction, added to the stress of the start. Default: a
        tenth of the mean stress.
    interval
        Strain over which the geometry is kept constant.
    large
        Least strain of a motion that is called large.
    most_snaps
        Largest number of motions below --large; a direction with more is unfinished.
    """

    directions: Annotated[Whole, Parameter(group=EVERYDAY)] = 24
    subspace: Annotated[str, Parameter(metavar="diagonal|symmetric")] = "diagonal"
    largest: Annotated[float | None, Parameter(group=EVERYDAY)] = None
    interval: float = 5e-6
    large: float = 3e-4
    most_snaps: Whole = 30


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Driving(OfProgramme, Continuing):
    """The programme that a packing is followed through.

    Parameters
    ----------
    to
        Change of the driven strain or stress, negative in extension; of a cycle 1e-4,-1e-4,0.
    programme
        drained (nominal stress across the driven axis constant), cauchy-drained or biaxial (Cauchy
        stress), isotropic, isotropic-stress, oedometric, undrained, proportional-strain,
        simple-shear.
    axis
        Driven axis, or that of simple-shear. Default: the major stress's; of simple-shear 1.
    interval
        Strain over which the geometry is kept constant; errors are proportional to it.
    """

    to: Annotated[
        float | tuple[float, ...],
        Parameter(converter=parse_turns, n_tokens=1, metavar="NUMBER,..."),
    ]
    programme: Annotated[str, Parameter(metavar="NAME")] = "drained"
    axis: Whole | None = None
    interval: Annotated[float, Parameter(group=FURTHER)] = 5e-6

    @property
    def turns(self) -> tuple[float, ...]:
        """Driven values at which a cycle turns, and at last that of the end."""
        return self.to if isinstance(self.to, tuple) else (self.to,)

    @property
    def length(self) -> float:
        """Length of the way from 0 through all turns to the end."""
        return sum(abs(end - start) for start, end in pairwise((0.0, *self.turns)))


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Evolving(Driving):
    """Options of `evolve`.

    Parameters
    ----------
    by
        Method: events (quasistatic, from event to event), replay (equations of motion), or both.
    rows
        Rows of the path's table.
    pathologies
        Tell in every row the matrix of the contacts at yield (symmetric, definite, P-matrix) and
        count the solutions.
    spread
        Follow the path again with other damping past instabilities, to tell how far stresses
        differ.
    """

    by: Annotated[str, Parameter(metavar="events|replay|both")] = "events"
    rows: Annotated[Whole, Parameter(group=FURTHER)] = 20
    instabilities: Instabilities = 20
    pathologies: Annotated[bool, Parameter(group=FURTHER)] = False
    spread: Annotated[bool, Parameter(group=FURTHER, negative="")] = False
    damping: Damping = 0.3


@Parameter(name="*", group=FURTHER)
@dataclass(frozen=True, kw_only=True)
class Replaying:
    """Options that set the rate of replays.

    Parameters
    ----------
    inertial_number
        Inertial number of the replays. Default: by the files' times and masses, or 2e-6.
    times
        Table of times, columns snap and time. Default: times of --cells, or the files.
    time_step
        Time of a step, if files are numbered by steps.
    mean_mass
        Mean mass of a grain, if the files have none.
    """

    inertial_number: float | None = None
    times: Path | None = None
    time_step: float | None = None
    mean_mass: float | None = None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Tracking(Yielding):
    """Options of `series`.

    Parameters
    ----------
    in_packing
        Predict each interval with the tangent of the whole packing (rates, the default), or also
        with its path by events and a replay (events).
    programme
        How paths and replays reach the later strain: straight, 1-first, 2-first (that axis, then
        the rest), mixed-1, mixed-2 (strain of that axis, stress across), or a table of time and
        h_xx, h_xy, h_yx, h_yy, or of time, H11, H22 (H12, H21).
    probe
        Probe each snapshot along N directions of strain.
    indicators
        Predict also by structural indicators: coordination, vibrality, D2min, ...
    skip_bad
        Leave out snapshots that can't be read.
    animation
        Animate the series, as GIF.
    regions
        Loops inside beside all others, over each interval: a threshold on a column,
        nonaffinity>2 or shear>1e-4, or a table of corners x, y of polygons by their names, region.
    """

    cells: Cells = None
    as_given: AsGiven = False
    in_packing: Annotated[str | bool, Parameter(metavar="rates|events")] = ""
    damping: Damping = 0.3
    programme: Annotated[str, Parameter(group=FURTHER, metavar="WORD|TABLE")] = "straight"
    probe: Annotated[Whole | None, Parameter(metavar="N")] = None
    indicators: Annotated[bool, Parameter(group=FURTHER)] = False
    skip_bad: Annotated[bool, Parameter(group=FURTHER)] = False
    animation: Annotated[bool, Parameter(group=FURTHER)] = False
    regions: Regions = None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Averaging(OfProgramme):
    """Options of `material`; None where the default hangs on what is averaged.

    Parameters
    ----------
    order
        Number of grains of a regular loop. Default: 6.
    alpha0_deg
        Angle of a hexagon's inclined branches (degrees).
    orientations
        Copies of the loop, turned evenly over half a turn. Default: 36.
    kappa
        Stiffness ratio kt/kn. Default: 0.5.
    phi_deg
        Friction angle of the contacts (degrees). Default: 30.
    confine
        Isotropic stress over kn before the programme. Default: 0.01.
    orders
        Orders of the snapshot's loops to average. Default: all.
    count
        Largest number of the snapshot's loops, taken at even spacing.
    closure
        How the mean strain drives a loop: affine, traction, or cell (the H-model's).
    programme
        Loading programme: drained, cauchy-drained, biaxial, isotropic, isotropic-stress,
        oedometric, undrained, proportional-strain.
    axis
        Driven axis, 1 or 2. Default: that of the major stress of a snapshot's loops, else 1.
    single
        Number in loops.parquet of the loop that is also followed alone. Default: of the median
        order, the one with the stress nearest to the mean at the start.
    end
        Driven strain at the end (isotropic-stress: stress). Default: 0.1; for a snapshot 1e-3.
    steps
        Number of steps of the programme.
    """

    order: Whole | None = None
    alpha0_deg: Annotated[float | None, Parameter(group=FURTHER, name="--alpha0")] = None
    orientations: Annotated[Whole | None, Parameter(group=FURTHER)] = None
    kappa: float | None = None
    phi_deg: Annotated[float | None, Parameter(name="--phi")] = None
    confine: Annotated[float | None, Parameter(group=FURTHER)] = None
    orders: Annotated[str | None, Parameter(group=FURTHER, metavar="N1,N2,...")] = None
    count: Annotated[Whole | None, Parameter(group=FURTHER)] = None
    closure: str = "traction"
    programme: str = "drained"
    axis: Annotated[Whole | None, Parameter(group=FURTHER)] = None
    single: Annotated[Whole | None, Parameter(group=FURTHER)] = None
    end: float | None = None
    steps: Annotated[Whole, Parameter(group=FURTHER)] = 200


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DiamondChoice:
    """Options of `diamond`; parameters left out are those of Table 1.

    Parameters
    ----------
    table
        Table 1 or 2 of the paper.
    alpha0_deg
        Branch angle of the reference (degrees).
    kappa
        Stiffness ratio kt/kn.
    confine
        Isotropic strain at state A, where the biaxial test starts.
    contact_on_touch
        When opposite grains touch: ignore it, stop, or add a contact.
    model
        auto: two degrees of freedom, as in the paper; full: all eight, to check.
    """

    table: Whole | None = None
    alpha0_deg: Annotated[float | None, Parameter(name="--alpha0")] = None
    kappa: float | None = None
    phi_deg: Phi = None
    confine: float | None = None
    closure: ClosureOption = "affine"
    contact_on_touch: Annotated[str, Parameter(group=FURTHER)] = "ignore"
    model: Annotated[str, Parameter(group=FURTHER)] = "auto"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LoopChoice(OfProgramme):
    """Options of `polygon`.

    Parameters
    ----------
    order
        Number of grains, 3 or more.
    compare
        Compare several orders, such as 3-12.
    radii
        Radii of unequal grains in order, centres on a circle.
    centres
        Table x, y, radius of the grains of any loop in order, re-entrant too.
    snapshot
        Snapshot that the loop is taken from, with --loop.
    loop
        Number of the loop in loops.parquet.
    orientation
        What points along axis 1: vertex (a grain) or edge. Default: vertex.
    kappa
        Stiffness ratio kt/kn. Default: 0.2; 0.82 with --law hertz.
    phi_deg
        Friction angle of the contacts (degrees). Default: 5.
    rolling
        Rolling stiffness over kn l0^2, with --spins free.
    spins
        Rotation of the grains: blocked, affine (with the loop) or free.
    confine
        Isotropic strain before the programme. Default: 0.1.
    programme
        drained (nominal stress across the driven axis constant), cauchy-drained or biaxial (Cauchy
        stress), isotropic, isotropic-stress, oedometric, undrained, proportional-strain.
    end
        Strain E1 at which the programme ends.
    model
        auto: the fewest degrees of freedom by symmetry; full: all of them.
    """

    order: Whole | None = None
    compare: Annotated[str | None, Parameter(metavar="ORDERS")] = None
    radii: Annotated[str | None, Parameter(group=FURTHER, metavar="R1,R2,...")] = None
    centres: Annotated[Path | None, Parameter(group=FURTHER)] = None
    snapshot: Path | None = None
    loop: Whole | None = None
    orientation: Annotated[str | None, Parameter(group=FURTHER)] = None
    kappa: float | None = None
    phi_deg: Annotated[float | None, Parameter(name="--phi")] = None
    rolling: Annotated[float | None, Parameter(group=FURTHER)] = None
    closure: ClosureOption = "affine"
    spins: str = "blocked"
    confine: Annotated[float | None, Parameter(group=FURTHER)] = None
    programme: str = "drained"
    end: Annotated[float | None, Parameter(group=FURTHER)] = None
    model: Annotated[str, Parameter(group=FURTHER)] = "auto"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DomainChoice:
    """Options of `domain`.

    Parameters
    ----------
    order
        Number of grains of a regular loop, 3 to 60.
    compare
        Compare several orders, such as 3-12.
    radii
        Radii of unequal grains in order.
    snapshot
        Snapshot that the loop is taken from, with --loop.
    loop
        Number of the loop in loops.parquet.
    closure
        Loading of the loop by its surroundings: affine or traction. Default: affine; with --compare
        both.
    spins
        Rotation of the grains: blocked, affine (with the loop) or free.
    rolling
        Rolling stiffness over kn l0^2, with --spins free.
    programmes
        What grows in proportion along a programme: strain or stress.
    alpha0
        Reference angles (degrees), separated by commas.
    kappa
        Stiffness ratios kt/kn, separated by commas.
    directions
        Number of programmes, odd. Default: 361; 61 if spins are not blocked or the law is hertz;
        181 without --order, --compare, --radii or --snapshot.
    """

    order: Whole | None = None
    compare: Annotated[str | None, Parameter(metavar="ORDERS")] = None
    radii: Annotated[str | None, Parameter(metavar="R1,R2,...")] = None
    snapshot: Path | None = None
    loop: Whole | None = None
    closure: str | None = None
    spins: str = "blocked"
    rolling: Annotated[float, Parameter(group=FURTHER)] = 0.0
    programmes: Annotated[str, Parameter(group=FURTHER)] = "strain"
    alpha0: Annotated[str | None, Parameter(group=FURTHER)] = None
    kappa: str | None = None
    phi_deg: Phi = None
    directions: Annotated[Whole | None, Parameter(group=FURTHER)] = None


def options_of(kind: type[Options], given: Mapping[str, Any]) -> Options:
    """Return options as their dataclass; `InputError` that lists them for an unknown one."""
    names = [one.name for one in fields(kind)]  # type: ignore[arg-type]
    for name, value in given.items():
        if name not in names:
            expected = f"one of {', '.join(sorted(names))}"
            raise InputError(name, repr(value), expected, "Leave it out.")
    return kind(**given)


def taken(kind: type[Options], how: dict[str, Any]) -> Options:
    """Take the options of a question out of others."""
    names = [one.name for one in fields(kind)]  # type: ignore[arg-type]
    return kind(**{name: how.pop(name) for name in names if name in how})
