"""`grainloops diamond`, `polygon`, `domain` and `bench`: loops without a packing."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from loops.errors import InputError
from studies.commands import (
    Answer,
    Force,
    Json,
    OneReading,
    Out,
    Writing,
    answer,
    clock,
    flags,
    numbers,
    out_or,
)
from studies.commands.printed import printed
from studies.questions import FURTHER, FluidBulkModulus, StrainRatio, Whole

if TYPE_CHECKING:
    from studies.output import Summary

# Default stiffness ratio kt/kn; that of spheres is for Poisson's ratio 0.3.
KAPPA = {"linear": 0.2, "hertz": 1.4 / 1.7}
ClosureOption = Annotated[
    str, Parameter(help="Loading of the loop by its surroundings: affine or traction.")
]
Phi = Annotated[float | None, Parameter(help="Friction angle of the contacts (degrees).")]


def diamond_command(
    *,
    table: Whole | None = None,
    alpha0: float | None = None,
    kappa: float | None = None,
    phi: Phi = None,
    confine: float | None = None,
    closure: ClosureOption = "affine",
    contact_on_touch: Annotated[str, Parameter(group=FURTHER)] = "ignore",
    model: Annotated[str, Parameter(group=FURTHER)] = "auto",
    writing: Writing | None = None,
) -> Answer:
    """Follow the four-grain diamond of the paper; without options, its Table 1.

    Figures of the paper: with --table 1 path_dependence (Fig. 4),
    axial_stress (6), determinant (7); with --table 2 axial_stress (8),
    determinant (9), eigenvalues (10), polar (11), cone (12).

    Parameters
    ----------
    table
        Table 1 or 2 of the paper.
    alpha0
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
    writing = writing or Writing()
    own = {alpha0, kappa, phi, confine} != {None}
    out = out_or(writing.out, "diamond" if own else f"diamond-table{table or 1}")
    # The options check the words themselves, and say what is expected.
    words: Any = (closure, contact_on_touch, model)
    with clock("grainloops diamond"):
        from studies.paths.followed import area_line, state_lines
        from studies.paths.options import DiamondOptions
        from studies.paths.polygon import event_words
        from studies.paths.run import run_diamond

        options = DiamondOptions(table, alpha0, kappa, phi, confine, *words)
        summary = run_diamond(options, out, **writing.files())
    check = summary["model"]["check"]
    apart = None
    if check is not None:
        found = check["differences"].items()
        apart = ", ".join(f"{difference:.1e} at {name}" for name, difference in found)
        apart = apart or "nothing to compare"
    events = [event | {"words": event_words(event["kind"])} for event in summary["events"]]
    more = [*state_lines(summary), area_line(summary)]
    lines = printed("diamond", summary, events=events, more=more, apart=apart)
    return answer(writing.json, out, lines, summary["notes"])


def polygon_command(
    *,
    order: Whole | None = None,
    compare: Annotated[str | None, Parameter(metavar="ORDERS")] = None,
    radii: Annotated[str | None, Parameter(group=FURTHER, metavar="R1,R2,...")] = None,
    centres: Annotated[Path | None, Parameter(group=FURTHER)] = None,
    snapshot: Path | None = None,
    loop: Whole | None = None,
    orientation: Annotated[str | None, Parameter(group=FURTHER)] = None,
    kappa: float | None = None,
    phi: float | None = None,
    rolling: Annotated[float | None, Parameter(group=FURTHER)] = None,
    closure: ClosureOption = "affine",
    spins: str = "blocked",
    confine: Annotated[float | None, Parameter(group=FURTHER)] = None,
    programme: str = "drained",
    fluid_bulk_modulus: FluidBulkModulus = None,
    strain_ratio: StrainRatio = None,
    end: Annotated[float | None, Parameter(group=FURTHER)] = None,
    model: Annotated[str, Parameter(group=FURTHER)] = "auto",
    writing: Writing | None = None,
    reading: OneReading | None = None,
) -> Answer:
    """Follow a loop: regular, of unequal grains, or of a snapshot; or compare orders.

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
    phi
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
    writing, reading = writing or Writing(), reading or OneReading()
    kinds = {"--order": order, "--radii": radii, "--compare": compare, "--snapshot": snapshot}
    _which_loop(kinds | {"--centres": centres}, needed=True)
    own = {"orientation": orientation, "kappa": kappa, "phi_deg": phi, "confine": confine,
           "rolling": rolling}  # fmt: skip
    asked: dict[str, Any] = {name: value for name, value in own.items() if value is not None}
    # The options check the words themselves, and say what is expected.
    words: Any = {"closure": closure, "spins": spins, "programme": programme, "end": end}
    words |= {"model": model, "fluid_bulk_modulus": fluid_bulk_modulus}
    words["strain_ratio"] = strain_ratio
    named = f"loop-{loop}-polygon" if snapshot else f"polygon-{order or compare or 'grains'}"
    out = out_or(writing.out, named, snapshot)
    with clock("grainloops polygon"):
        from studies.paths.options import ComparisonOptions, PolygonOptions, orders_of
        from studies.paths.run import run_comparison, run_polygon

        if snapshot is not None:
            options = _of_snapshot(snapshot, loop, [*asked], words, reading.how_of(snapshot))
        else:
            law, sizes = _refuse_reading(loop, reading), numbers("--radii", radii)
            asked = {"kappa": KAPPA.get(law, 0.2), "contact_law": law} | asked | words
            if centres is not None:
                asked["centres"], sizes = _ring_of(centres)
            orders = (order or len(sizes or ()),) if compare is None else orders_of(compare)
            options = PolygonOptions(orders[0], radii=sizes, **asked)
        if compare is None:
            summary = run_polygon(options, out, **writing.files())
        else:
            summary = run_comparison(ComparisonOptions(orders, options), out, **writing.files())
    lines = _polygon_lines(summary) if compare is None else printed("compare", summary)
    return answer(writing.json, out, lines, summary["notes"])


def _ring_of(path: Path) -> tuple[Any, Any]:
    """Centres and radii of a table, counter-clockwise."""
    import pandas as pd

    from loops import polygon_area

    try:
        table = pd.read_csv(path, comment="#")[["x", "y", "radius"]].astype(float)
    except (OSError, KeyError, ValueError) as error:
        expected = "a table with the columns x, y and radius, a row a grain, in order"
        raise InputError(f"--centres {path}", str(error), expected, "Correct it.") from None
    x = table[["x", "y"]].to_numpy()
    sense = -1 if len(x) > 2 and polygon_area(x) < 0.0 else 1
    return tuple(map(tuple, x[::sense].tolist())), tuple(table["radius"].tolist()[::sense])


def _which_loop(kinds: dict[str, Any], *, needed: bool) -> str:
    """Return the option that says which loop; `InputError` for several, and for none if needed."""
    given = [name for name, value in kinds.items() if value is not None]
    if len(given) > 1 or (needed and not given):
        received = " and ".join(given) or "none"
        raise InputError(", ".join(kinds), received, "one of them", "Write --order 6.")
    return given[0] if given else ""


def _refuse_reading(loop: int | None, reading: OneReading) -> str:
    """Return the law of loops that are made; `InputError` for other options of a snapshot."""
    given = [name for name in reading.given() if name != "law"]
    if loop is not None or given:
        received = flags([*["loop"] * (loop is not None), *given], " ")
        raise InputError(received, "given", "--snapshot with it", "Leave it out.")
    return reading.law or "linear"


def _of_snapshot(
    path: Path, loop: int | None, own: list[str], words: Any, how: dict[str, Any]
) -> Any:
    """Options of one loop of a snapshot."""
    from patterns import loop_of_snapshot
    from studies.paths.options import LoopOptions
    from studies.reading import read_planar

    if own:
        expected = "none of these: a loop of a snapshot has its own law and state"
        raise InputError(flags(own), "given with --snapshot", expected, "Leave them out.")
    snapshot = read_planar(path, **how)
    if loop is None:
        remedy = "loops.parquet of grainloops snapshot has them in its column loop."
        last = len(snapshot.faces.loops) - 1
        raise InputError("--loop", "none", f"a number from 0 to {last}", remedy)
    order = loop_of_snapshot(snapshot, loop).graph.grain_count
    of_snapshot: Any = {"snapshot": snapshot, "loop": loop, "source": path.name}
    return LoopOptions(order, confine=0.0, **words, **of_snapshot)


def _polygon_lines(summary: Summary) -> list[str]:
    from studies.paths.followed import area_line, state_lines
    from studies.paths.polygon import event_lines

    critical = "  ".join(
        f"{name}: {'none' if strain is None else f'{strain:.10f}'}"
        for name, strain in summary["critical_strain"].items()
    )
    more = [*state_lines(summary), area_line(summary)]
    told = {"critical": critical, "listed": event_lines(summary), "more": more}
    return printed("polygon", summary | told)


def loop_command(
    path: Path,
    /,
    *,
    id: Whole,
    closure: ClosureOption = "traction",
    programme: str = "drained",
    end: Annotated[float | None, Parameter(group=FURTHER)] = None,
    no_packing: Annotated[bool, Parameter(group=FURTHER)] = False,
    writing: Writing | None = None,
    reading: OneReading | None = None,
) -> Answer:
    """Study one loop of a snapshot: its closures, its path and its domain on one page.

    Parameters
    ----------
    path
        File of the snapshot, or of its grains.
    id
        Number of the loop in loops.parquet.
    programme
        What is followed: a name of grainloops polygon --programme.
    end
        Strain E1 at which the programme ends. Default: five mean overlaps.
    no_packing
        Leave out the loop in its packing, which takes longest in large samples.
    """
    writing, reading = writing or Writing(), reading or OneReading()
    out = out_or(writing.out, f"loop-{id}", path)
    with clock("grainloops loop") as tell:
        from studies.one_loop import run_loop

        words = {"closure": closure, "programme": programme, "end": end}
        options = _of_snapshot(path, id, [], words, reading.how_of(path))
        place = not no_packing
        found = run_loop(options, out, in_packing=place, progress=tell, **writing.files())
    summary = found.summary
    lines = [*printed("loop", summary), *_polygon_lines(summary)]
    return answer(writing.json, out, lines, summary["notes"])


def domain_command(
    *,
    order: Whole | None = None,
    compare: Annotated[str | None, Parameter(metavar="ORDERS")] = None,
    radii: Annotated[str | None, Parameter(metavar="R1,R2,...")] = None,
    snapshot: Path | None = None,
    loop: Whole | None = None,
    closure: str | None = None,
    spins: str = "blocked",
    rolling: Annotated[float, Parameter(group=FURTHER)] = 0.0,
    programmes: Annotated[str, Parameter(group=FURTHER)] = "strain",
    alpha0: Annotated[str | None, Parameter(group=FURTHER)] = None,
    kappa: str | None = None,
    phi: Phi = None,
    directions: Annotated[Whole | None, Parameter(group=FURTHER)] = None,
    writing: Writing | None = None,
    reading: OneReading | None = None,
) -> Answer:
    """Draw bifurcation domains: of the diamond, a loop of any order, or one of a snapshot.

    Without options those of the paper's Tables 1 and 2.

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
        1441 without --order, --compare, --radii or --snapshot.
    """
    writing, reading = writing or Writing(), reading or OneReading()
    kinds = {"--order": order, "--compare": compare, "--radii": radii, "--snapshot": snapshot}
    given = _which_loop(kinds, needed=False)
    out = out_or(writing.out, "domain" if not snapshot else f"loop-{loop}-domain", snapshot)
    ratios = numbers("--kappa", kappa)
    with clock("grainloops domain"):
        from studies.domain import DomainParameters, run_domain
        from studies.loop_domain import LoopDomainParameters, run_loop_domains
        from studies.present_domain import programmes_of

        if not given:
            plain = (None, "blocked", None, 0.0, "strain")
            if (closure, spins, reading.law, rolling, programmes) != plain:
                received = "given without a loop"
                expected = "--order, --compare, --radii or --snapshot with them"
                remedy = "Write --order 4 for the square diamond."
                where = "--closure, --spins, --law, --rolling, --programmes"
                raise InputError(where, received, expected, remedy)
            _refuse_reading(loop, reading)
            parameters = DomainParameters(
                numbers("--alpha0", alpha0), ratios, phi, 1441 if directions is None else directions
            )
            summary = run_domain(parameters, out, **writing.files())
            return answer(writing.json, out, _domain_lines(summary))
        from studies.paths.options import PolygonOptions, orders_of

        if alpha0 is not None:
            raise InputError("--alpha0", f"given with {given}", "diamonds alone", "Leave it out.")
        words: Any = {"spins": spins}
        closures: tuple[Any, ...] = (closure or "affine",)
        if snapshot is not None:
            asked = {"kappa": kappa, "phi_deg": phi, "rolling": rolling or None}
            own = [name for name, value in asked.items() if value is not None]
            words |= {"closure": closures[0]}
            loops = [_of_snapshot(snapshot, loop, own, words, reading.how_of(snapshot))]
        else:
            law = _refuse_reading(loop, reading)
            sizes = numbers("--radii", radii)
            if compare is not None:
                closures = (closure,) if closure else ("affine", "traction")
            orders = orders_of(compare) if compare else (order or len(sizes or ()),)
            _require_orders(orders, "number of --radii" if sizes else given, each=bool(compare))
            angle: Any = {} if phi is None else {"phi_deg": phi}
            words |= {"radii": sizes, "contact_law": law, "rolling": rolling, **angle}
            loops = [
                PolygonOptions(n, kappa=k, closure=c, **words)
                for k in ratios or (KAPPA.get(law, 0.2),) for c in closures for n in orders
            ]  # fmt: skip
        control: Any = programmes
        if directions is None:
            linear = all(one.contact_law == "linear" for one in loops)
            directions = programmes_of(loops[0].spins, linear=linear)
        wanted = LoopDomainParameters(tuple(loops), control, directions)
        summary = run_loop_domains(wanted, out, **writing.files())
    return answer(writing.json, out, _loop_domain_lines(summary), summary["notes"])


def _require_orders(orders: Sequence[int], where: str, *, each: bool) -> None:
    """Raise `InputError` for an order of which no domain is drawn; `each`: there are several."""
    from studies.loop_domain import LONGEST

    for n in orders:
        if not 3 <= n <= LONGEST:
            expected = f"a whole number from 3 to {LONGEST}{' for each order' if each else ''}"
            raise InputError(where, str(n), expected, "Correct it.")


def _loop_domain_lines(summary: Summary) -> list[str]:
    lines = []
    for row in summary["loops"]:
        limits = ", ".join(f"{kind} on {count}" for kind, count in row["limits"].items())
        if "present_state" in row:
            ends = ", ".join(f"{count} {kind}" for kind, count in row["ended_by"].items())
            limits += f"; present state {row['present_state']}, programmes ended by: {ends}"
            if row["present_state"] == "unstable":
                share = row["negative_share"]
                limits = "none followed; the present state is unstable, with negative second-order"
                limits += f" work along {100 * share:.0f} % of them"
        if "unstable_share" in row:
            limits += f"; unstable share of strains {row['unstable_share']:.3f}"
        lines.append(
            f"n = {row['order']}  {row['closure']}  kappa = {row['kappa']:g}  {row['contacts']:<10}"
            f"  of {summary['directions']} programmes: {limits or 'no limit'}"
        )
    return lines


def _domain_lines(summary: Summary) -> list[str]:
    rows = [
        case | found | {"contacts": contacts}
        for case in summary["cases"]
        for contacts, found in case["contacts"].items()
    ]
    return printed("domain", summary, rows=rows)


def _benchmarks() -> Any:
    """Load what measures: it stands among the tests of a checkout, outside the package."""
    root = Path(__file__).parents[2]
    if not (root / "tests" / "benchmarks").is_dir():
        raise InputError(
            "bench",
            "an installed package",
            "a checkout of the project: what measures stands there, in tests/benchmarks",
            "Install the checkout (pip install -e '.[test]') and call the command again.",
        )
    if str(root) not in sys.path:
        sys.path.insert(0, str(root))
    return import_module("tests.benchmarks.run")


def bench_command(
    *,
    out: Out = None,
    quick: bool = False,
    only: Annotated[str | None, Parameter(metavar="NAME,...")] = None,
    force: Force = False,
    json: Json = False,
) -> Answer:
    """Measure speed against error of the methods that can be chosen, and run the hard cases.

    Runs in a checkout of the project, where the measuring code is.

    Parameters
    ----------
    quick
        Smaller sizes, fewer settings, no compiled code.
    only
        Only these groups, such as faces,hard-cases.
    """
    out = out_or(out, "bench")
    run_bench = _benchmarks().run_bench
    with clock("grainloops bench") as tell:
        summary = run_bench(out, quick=quick, only=only, force=force, progress=tell)
    defaults = [
        row | {"name": name, "knee": group["knee"]}
        for name, group in summary["groups"].items()
        for row in group["defaults"][:1]
    ]
    hard = summary["hard_cases"]
    unexpected = len(hard["unexpected"]) + len(hard["paths_missed"]) if hard["cases"] else None
    lines = printed("bench", summary, defaults=defaults, unexpected=unexpected)
    return answer(json, out, lines)
