"""`grainloops polygon`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from loops.errors import InputError
from studies.commands.common import (
    DEFAULTS,
    Csv,
    Force,
    Json,
    Out,
    numbers,
    out_or,
    reads,
    report,
    shown,
)

# Stiffness ratio where nobody gives one; that of spheres is of nu = 0.3.
KAPPA = {"linear": 0.2, "hertz": 1.4 / 1.7}


@reads()
def polygon(
    out: Out = None,
    order: Annotated[int | None, typer.Option(help="Number of grains, 3 or more.")] = None,
    compare: Annotated[
        str | None, typer.Option(metavar="ORDERS", help="Orders side by side, such as 3-12.")
    ] = None,
    radii: Annotated[
        str | None,
        typer.Option(metavar="R1,R2,...", help="Unequal grains in order, centres on a circle."),
    ] = None,
    snapshot: Annotated[
        Path | None, typer.Option(help="Snapshot to take a loop from, with --loop.")
    ] = None,
    loop: Annotated[int | None, typer.Option(help="Number of the loop in loops.parquet.")] = None,
    orientation: Annotated[
        str | None, typer.Option(help="vertex (by default) or edge on axis 1.")
    ] = None,
    kappa: Annotated[
        float | None, typer.Option(help="Stiffness ratio kt/kn; 0.2, of spheres 0.82.")
    ] = None,
    phi: Annotated[float | None, typer.Option(help="Contact friction angle (5 degrees).")] = None,
    law: Annotated[str | None, typer.Option(help="linear (by default) or hertz.")] = None,
    rolling: Annotated[
        float | None, typer.Option(help="Rolling stiffness over kn l0^2, with free spins.")
    ] = None,
    closure: Annotated[str, typer.Option(help="affine or traction.")] = "affine",
    spins: Annotated[str, typer.Option(help="blocked, affine or free.")] = "blocked",
    confine: Annotated[
        float | None, typer.Option(help="Isotropic strain at state A; 0.1 by default.")
    ] = None,
    programme: Annotated[
        str, typer.Option(help="drained, isotropic, isotropic-stress, oedometric or undrained.")
    ] = "drained",
    end: Annotated[float | None, typer.Option(help="Strain E1 where the programme ends.")] = None,
    model: Annotated[
        str, typer.Option(help="auto, the smallest that symmetry leaves, or full.")
    ] = "auto",
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
    **how: Any,
) -> None:
    """Follow a loop: regular, of unequal grains, or of a snapshot; or compare orders."""
    from studies.paths import ComparisonOptions, PolygonOptions, run_comparison, run_polygon
    from studies.paths.options import orders_of

    kinds = {"--order": order, "--radii": radii, "--compare": compare, "--snapshot": snapshot}
    given = [name for name, value in kinds.items() if value is not None]
    if len(given) != 1:
        received = " and ".join(given) or "none"
        raise InputError(", ".join(kinds), received, "one of them", "Write --order 6.")
    own = {"orientation": orientation, "kappa": kappa, "phi_deg": phi, "confine": confine,
           "contact_law": law, "rolling": rolling}  # fmt: skip
    asked: dict[str, Any] = {name: value for name, value in own.items() if value is not None}
    # The options check the words themselves, and say what is expected.
    words: Any = {"closure": closure, "spins": spins, "programme": programme, "end": end}
    words["model"] = model
    named = f"loop-{loop}-polygon" if snapshot else f"polygon-{order or compare or 'radii'}"
    out = out_or(out, named, snapshot)
    if snapshot is not None:
        options = _of_snapshot(snapshot, loop, [*asked], words, how)
        report(run_polygon(options, out, force=force, csv=csv), out, json, _polygon_lines)
        return
    unread = [
        f"--{name.replace('_', '-')}" for name, value in how.items() if value != DEFAULTS.get(name)
    ]
    if loop is not None or unread:
        received = " ".join([*(["--loop"] if loop is not None else []), *unread])
        raise InputError(received, "given", "--snapshot with it", "Leave it out.")
    asked = {"kappa": KAPPA.get(law or "linear", 0.2)} | asked | words
    asked["radii"] = sizes = numbers("--radii", radii)
    if compare is None:
        count = order if sizes is None else len(sizes)
        options = PolygonOptions(count or 0, **asked)
        report(run_polygon(options, out, force=force, csv=csv), out, json, _polygon_lines)
        return
    listed = orders_of(compare)
    compared = ComparisonOptions(listed, PolygonOptions(listed[0], **asked))
    summary = run_comparison(compared, out, force=force, csv=csv)
    report(summary, out, json, _comparison_lines)


def _of_snapshot(
    path: Path, loop: int | None, own: list[str], words: Any, how: dict[str, Any]
) -> Any:
    """Options of one loop of a snapshot."""
    from patterns import loop_of_snapshot
    from studies.paths.options import LoopOptions
    from studies.snapshot.source import read_planar

    if own:
        given = ", ".join(f"--{name.removesuffix('_deg').removeprefix('contact_')}" for name in own)
        expected = "none of these: a loop of a snapshot has its own law and state"
        raise InputError(given, "given with --snapshot", expected, "Leave them out.")
    snapshot = read_planar(path, **how)
    if loop is None:
        remedy = "loops.parquet of grainloops snapshot has them in its column loop."
        last = len(snapshot.faces.loops) - 1
        raise InputError("--loop", "none", f"a number from 0 to {last}", remedy)
    order = loop_of_snapshot(snapshot, loop).graph.grain_count
    of_snapshot: Any = {"snapshot": snapshot, "loop": loop, "source": path.name}
    return LoopOptions(order, confine=0.0, **words, **of_snapshot)


def _polygon_lines(summary: dict[str, Any]) -> list[str]:
    from studies.paths.polygon import event_lines

    critical = "  ".join(
        f"{name}: {'none' if strain is None else f'{strain:.10f}'}"
        for name, strain in summary["critical_strain"].items()
    )
    lines = [f"critical isotropic strain  {critical}", *event_lines(summary)]
    if summary["peak"] is not None:
        peak = summary["peak"]
        lines.append(f"peak of s1 = {peak['s1']:.8f} at E1 = {peak['E1']:.8f}")
    model = summary["model"]
    lines.append(
        f"model {model['choice']}: symmetry {model['symmetry']}, freedoms {model['freedoms']}, "
        f"contacts {model['contact_orbits']}"
    )
    return lines + [f"note: {note}" for note in summary["notes"]]


def _comparison_lines(summary: dict[str, Any]) -> list[str]:
    lines = [
        "order  critical strain in 11, 22 / symmetric / full, E1 at first yield, peak s1, status"
    ]
    for loop in summary["loops"]:
        strains = [shown(strain) for strain in loop["critical_strain"].values()]
        first, peak = ((loop[name] or {}) for name in ("first_yield", "peak"))
        values = [*strains, shown(first.get("E1")), shown(peak.get("s1"))]
        columns = "  ".join(f"{value:>9}" for value in values)
        lines.append(f"{loop['order']:>5}  {columns}  {loop['status']}")
    return lines + [f"note: {note}" for note in summary["notes"]]
