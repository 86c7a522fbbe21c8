"""`grainloops diamond`, `polygon`, `domain` and `bench`: loops without a packing."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from loops.errors import InputError, counted
from studies.clock import clock, of_parts
from studies.commands import (
    Answer,
    OneReading,
    Writing,
    answer,
    flags,
    numbers,
    out_or,
    printed,
)
from studies.questions import (
    FURTHER,
    ClosureOption,
    DiamondChoice,
    DomainChoice,
    LoopChoice,
    Whole,
)

if TYPE_CHECKING:
    from studies.output import Summary

# Default stiffness ratio kt/kn; that of spheres is for Poisson's ratio 0.3.
KAPPA = {"linear": 0.2, "hertz": 1.4 / 1.7}
# Options that say which loop, and those of a loop that is made.
OF_POLYGON = ("order", "radii", "compare", "snapshot", "centres")
OF_DOMAIN = ("order", "compare", "radii", "snapshot")
OWN = ("orientation", "kappa", "phi_deg", "confine", "rolling")
CONES = {
    "empty": "no unstable direction there",
    "ray": "second-order work vanishes in one direction",
}
# Values printed of an event.
EVENT_VALUES = ("E1", "E2", "s1", "s2")
# Lines of events, at most; beyond, one line for each kind.
MOST_LINES = 40
EVENT_WORDS = {
    "det_K_zero": "det K = 0",
    "det_Ks_zero": "det Ks = 0",
    "opposite_contact": "opposite grains touch",
    "programme_change": "next stage",
    "control_limit": "limit of the control",
}
# Subspaces besides (11, 22), named where their verdict differs.
WIDER = {"symmetric": "(11, 22, 12 + 21)", "full": "all four strain components"}


def diamond_command(
    *, choice: DiamondChoice = DiamondChoice(), writing: Writing = Writing()
) -> Answer:
    """Follow the four-grain diamond of the paper; without options, its Table 1.

    Figures of the paper: with --table 1 path_dependence (Fig. 4),
    axial_stress (6), determinant (7); with --table 2 axial_stress (8),
    determinant (9), eigenvalues (10), polar (11), cone (12).
    """
    chosen = {choice.alpha0_deg, choice.kappa, choice.phi_deg, choice.confine} != {None}
    out = out_or(writing.out, "diamond" if chosen else f"diamond-table{choice.table or 1}")
    with clock("grainloops diamond"):
        from studies.paths.options import DiamondOptions
        from studies.paths.run import run_paths

        summary = run_paths(DiamondOptions(**asdict(choice)), out, **writing.files())
    check = summary["model"]["check"]
    apart = None
    if check is not None:
        differences = check["differences"].items()
        apart = ", ".join(f"{difference:.1e} at {name}" for name, difference in differences)
        apart = apart or "nothing to compare"
    events = [event | {"words": event_words(event["kind"])} for event in summary["events"]]
    more = state_lines(summary)
    lines = printed("diamond", summary, events=events, more=more, apart=apart)
    return answer(writing.json, out, lines, summary["notes"])


def polygon_command(
    *,
    choice: LoopChoice = LoopChoice(),
    writing: Writing = Writing(),
    reading: OneReading = OneReading(),
) -> Answer:
    """Follow a loop: regular, of unequal grains, or of a snapshot; or compare orders."""
    _which_loop(choice, OF_POLYGON, needed=True)
    compare, named = choice.compare, f"polygon-{choice.order or choice.compare or 'grains'}"
    named = "polygon" if choice.centres else named
    named = f"loop-{choice.loop}-polygon" if choice.snapshot else named
    out = out_or(writing.out, named, choice.snapshot or choice.centres)
    with clock("grainloops polygon"):
        from studies.paths.options import ComparisonOptions
        from studies.paths.run import run_paths

        ratios = None if choice.kappa is None else (choice.kappa,)
        orders, (loop, *_) = _loops_of(choice, reading, (choice.closure,), ratios)
        options = loop if compare is None else ComparisonOptions(orders, loop)
        summary = run_paths(options, out, **writing.files())
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


def _which_loop(
    choice: LoopChoice | DomainChoice, names: Sequence[str], *, needed: bool = False
) -> str:
    """Return the option that says which loop; `InputError` for several, and for none if needed."""
    given = [f"--{name}" for name in names if getattr(choice, name) is not None]
    if len(given) > 1 or (needed and not given):
        received = " and ".join(given) or "none"
        where = ", ".join(f"--{name}" for name in names)
        raise InputError(where, received, "one of them", "Write --order 6.")
    return given[0] if given else ""


def _loops_of(
    choice: LoopChoice | DomainChoice,
    reading: OneReading,
    closures: Sequence[str],
    ratios: Sequence[float] | None,
    given: str = "",
) -> tuple[tuple[int, ...], list[Any]]:
    """Orders and options of the loops that are asked for: of a snapshot, unequal, or regular.

    Those of a domain are `given` by an option, and their orders are checked.
    """
    from studies.paths.options import LONGEST, PolygonOptions, loop_options, orders_of
    from studies.reading import read_planar

    known = {f.name for f in fields(PolygonOptions)} - {"order", "radii", "centres", "kappa"}
    named = asdict(choice).items()
    words: Any = {name: value for name, value in named if name in known and value is not None}
    if choice.snapshot is not None:
        plain = type(choice)()
        differ = [name for name in OWN if getattr(choice, name, None) != getattr(plain, name, None)]
        if wrong := flags(differ):
            expected = "none of these: a loop of a snapshot has its own law and state"
            raise InputError(wrong, "given with --snapshot", expected, "Leave them out.")
        words = {name: value for name, value in words.items() if name not in OWN}
        words |= {"closure": closures[0]}
        path = choice.snapshot
        snapshot = read_planar(path, **reading.how_of(path))
        loop = loop_options(snapshot, choice.loop, path.name, **words)
        return (loop.order,), [loop]
    words["contact_law"] = law = _refuse_reading(choice.loop, reading)
    words["radii"] = numbers("--radii", choice.radii)
    if (centres := getattr(choice, "centres", None)) is not None:
        words["centres"], words["radii"] = _ring_of(centres)
    sizes, every = words["radii"], orders_of(choice.compare) if choice.compare else ()
    orders = every or (choice.order or len(sizes or ()),)
    beyond = [n for n in orders if given and not 3 <= n <= LONGEST]
    if beyond:
        expected = f"a whole number from 3 to {LONGEST}{' for each order' if every else ''}"
        where = "number of --radii" if sizes else given
        raise InputError(where, str(beyond[0]), expected, "Correct it.")
    return orders, [
        PolygonOptions(n, **words | {"kappa": kappa, "closure": closure})
        for kappa in ratios or (KAPPA.get(law, 0.2),)
        for closure in closures
        for n in (orders if given else orders[:1])
    ]


def _refuse_reading(loop: int | None, reading: OneReading) -> str:
    """Return the law of loops that are made; `InputError` for other options of a snapshot."""
    given = [name for name in reading.given() if name != "law"]
    if loop is not None or given:
        received = flags([*["loop"] * (loop is not None), *given], " ")
        raise InputError(received, "given", "--snapshot with it", "Leave it out.")
    return reading.law or "linear"


def _polygon_lines(summary: Summary) -> list[str]:
    if not any(summary["states"].values()):
        return printed("no_path", summary)
    critical = "  ".join(
        f"{name}: {'none' if strain is None else f'{strain:.10f}'}"
        for name, strain in summary["critical_strain"].items()
    )
    values = {
        "critical": critical,
        "listed": event_lines(summary["events"]),
        "more": state_lines(summary),
    }
    return printed("polygon", summary | values)


def event_lines(events: Sequence[dict[str, Any]]) -> list[str]:
    """One line for the events of a kind at one state; beyond `MOST_LINES` one for each kind.

    The loss of stability names its subspace; contacts, or pairs of grains that touch, are counted.
    """
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for event in events:
        place = (f"{event[key]:.8f}" for key in EVENT_VALUES)
        groups.setdefault((event["kind"], event["subspace"] or "", *place), []).append(event)
    if len(groups) > MOST_LINES:
        places, groups = groups, {}
        for (kind, subspace, *_), group in places.items():
            groups.setdefault((kind, subspace), []).extend(group)
    lines = []
    for (kind, subspace, *_), group in groups.items():
        pairs = kind == "opposite_contact"
        count = len(group) if pairs else sum(len(event["contacts"]) for event in group)
        values = []
        for key in EVENT_VALUES:
            start, end = (f"{event[key]:.8f}" for event in (group[0], group[-1]))
            values.append(f"{key} = {start}" + (f" to {end}" if end != start else ""))
        counts = f"  {counted(count, 'pair' if pairs else 'contact')}" if count else ""
        lines.append(f"{event_words(kind):<22} {subspace:<10} {'  '.join(values)}{counts}")
    return lines


def event_words(kind: str) -> str:
    """Words for a kind of event."""
    return EVENT_WORDS.get(kind, kind.replace("_", " "))


def state_lines(summary: Summary) -> list[str]:
    """Lines of the named states, with both sides of an event at which contacts start to slide.

    The last one says which area stresses are over.
    """
    states: Summary = {}
    for name, state in ((name, one) for name, one in summary["states"].items() if one):
        beyond, slides = state.get("beyond"), "sliding" in state["regime"]
        states[name] = state | {
            "stability": _stability(state),
            "going_on": _stability(beyond) if beyond else None,
            "activated": bool(state["directions"] and (beyond or slides)),
        }
    return "\n".join(printed("states", summary, states=states)).split("\n")


def _stability(operators: dict[str, Any]) -> str:
    """Verdict and cone of one operator in (11, 22), and verdicts of wider subspaces that differ."""
    cone, verdict = operators["cone"], operators["verdict"]
    status = verdict.get("diagonal", verdict)["status"]
    wide = f"double cone of unstable directions {cone['opening_deg']:.2f} degrees wide"
    verdicts = [f"{status} in the normal strains (11, 22), {CONES.get(cone['status'], wide)}"]
    others = {name: verdict[name]["status"] for name in WIDER if name in verdict}
    verdicts += [f"{wide} in {WIDER[name]}" for name, wide in others.items() if wide != status]
    return "; ".join(verdicts)


def loop_command(
    path: Path,
    /,
    *,
    id: Whole,
    closure: ClosureOption = "traction",
    programme: str = "drained",
    end: Annotated[float | None, Parameter(group=FURTHER)] = None,
    no_packing: Annotated[bool, Parameter(group=FURTHER)] = False,
    writing: Writing = Writing(),
    reading: OneReading = OneReading(),
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
    out = out_or(writing.out, f"loop-{id}", path)
    with clock("grainloops loop") as tell:
        from studies.one_loop import study
        from studies.reading import read_planar

        how: Any = {"closure": closure, "programme": programme, "end": end, "progress": tell}
        how |= {"in_packing": not no_packing, "named": path.name, **writing.files()}
        loop = study(read_planar(path, **reading.how_of(path)), id, out, **how)
    summary = loop.summary
    lines = printed("loop", summary) + ([] if loop.path is None else _polygon_lines(summary))
    return answer(writing.json, out, lines, summary["notes"])


def domain_command(
    *,
    choice: DomainChoice = DomainChoice(),
    writing: Writing = Writing(),
    reading: OneReading = OneReading(),
) -> Answer:
    """Draw bifurcation domains: of the diamond, a loop of any order, or one of a snapshot.

    Without options those of the paper's Tables 1 and 2.
    """
    given, loop, path = _which_loop(choice, OF_DOMAIN), choice.loop, choice.snapshot
    out = out_or(writing.out, f"loop-{loop}-domain" if path else "domain", path)
    ratios, directions = numbers("--kappa", choice.kappa), choice.directions
    with clock("grainloops domain") as tell:
        from studies import domain

        if not given:
            plain = (None, "blocked", None, 0.0, "strain")
            others = choice.closure, choice.spins, reading.law, choice.rolling, choice.programmes
            if others != plain:
                received = "given without a loop"
                expected = "--order, --compare, --radii or --snapshot with them"
                remedy = "Write --order 4 for the square diamond."
                where = "--closure, --spins, --law, --rolling, --programmes"
                raise InputError(where, received, expected, remedy)
            _refuse_reading(loop, reading)
            angles = numbers("--alpha0", choice.alpha0)
            count = domain.PROGRAMMES if directions is None else directions
            wanted: Any = domain.DomainParameters(angles, ratios, choice.phi_deg, count)
        elif choice.alpha0 is not None:
            raise InputError("--alpha0", f"given with {given}", "diamonds alone", "Leave it out.")
        else:
            both = choice.compare is not None and not choice.closure
            closures = ("affine", "traction") if both else (choice.closure or "affine",)
            _, loops = _loops_of(choice, reading, closures, ratios, given)
            if directions is None:
                linear = all(options.contact_law == "linear" for options in loops)
                directions = domain.programmes_of(loops[0].spins, linear=linear)
            control: Any = choice.programmes
            wanted = domain.LoopDomainParameters(tuple(loops), control, directions)
        progress = of_parts(tell, "programmes")
        summary = domain.run_domain(wanted, out, progress, **writing.files())
    lines = _loop_domain_lines(summary) if given else _domain_lines(summary)
    return answer(writing.json, out, lines, summary.get("notes", ()))


def _loop_domain_lines(summary: Summary) -> list[str]:
    rows = []
    for row in summary["loops"]:
        unstable = row.get("present_state") == "unstable"
        stable = {"followed": not unstable, "unlimited": not (unstable or row["limits"])}
        rows.append(row | {"unstable": unstable, **stable})
    return printed("loop_domains", summary, loops=rows)


def _domain_lines(summary: Summary) -> list[str]:
    rows = [
        case | counts | {"contacts": contacts}
        for case in summary["cases"]
        for contacts, counts in case["contacts"].items()
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
    quick: bool = False,
    only: Annotated[str | None, Parameter(metavar="NAME,...")] = None,
    writing: Writing = Writing(),
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
    out = out_or(writing.out, "bench")
    run_bench = _benchmarks().run_bench
    with clock("grainloops bench") as tell:

        def progress(line: str) -> None:
            if quick or os.environ.get("TTY_COMPATIBLE") == "0":
                tell(line)
            else:
                print(f"grainloops bench: {line}", file=sys.stderr, flush=True)

        summary = run_bench(out, quick=quick, only=only, progress=progress, **writing.files())
    defaults = [
        row | {"name": name, "knee": group["knee"]}
        for name, group in summary["groups"].items()
        for row in group["defaults"][:1]
    ]
    hard = summary["hard_cases"]
    unexpected = len(hard["unexpected"]) + len(hard["paths_missed"]) if hard["cases"] else None
    lines = printed("bench", summary, defaults=defaults, unexpected=unexpected)
    return answer(writing.json, out, lines)
