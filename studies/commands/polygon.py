"""`grainloops polygon`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from loops.errors import InputError
from studies.commands.common import Csv, Force, Json, Out, out_or, report, shown


def polygon(
    out: Out = None,
    order: Annotated[int | None, typer.Option(help="Number of grains, 3 or more.")] = None,
    compare: Annotated[
        str | None, typer.Option(metavar="ORDERS", help="Orders side by side, such as 3-12.")
    ] = None,
    orientation: Annotated[str, typer.Option(help="vertex or edge on axis 1.")] = "vertex",
    kappa: Annotated[float, typer.Option(help="Stiffness ratio kt/kn.")] = 0.2,
    phi: Annotated[float, typer.Option(help="Contact friction angle (degrees).")] = 5.0,
    closure: Annotated[str, typer.Option(help="affine or traction.")] = "affine",
    spins: Annotated[str, typer.Option(help="blocked, affine or free.")] = "blocked",
    confine: Annotated[float, typer.Option(help="Isotropic strain at state A.")] = 0.1,
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
) -> None:
    """Follow a regular loop of any order, or compare orders: confined, then loaded."""
    from studies.paths import ComparisonOptions, PolygonOptions, run_comparison, run_polygon
    from studies.paths.options import orders_of

    out = out_or(out, f"polygon-{order or compare}")
    if (order is None) == (compare is None):
        given = "neither" if order is None else "both"
        raise InputError("--order, --compare", given, "one of them", "Write --order 6.")
    # The options check the words themselves, and say what is expected.
    words: Any = (orientation, kappa, phi, closure, spins, confine, programme, end, model)
    if compare is None:
        summary = run_polygon(PolygonOptions(order or 0, *words), out, force=force, csv=csv)
        report(summary, out, json, _polygon_lines)
        return
    listed = orders_of(compare)
    options = ComparisonOptions(listed, PolygonOptions(listed[0], *words))
    summary = run_comparison(options, out, force=force, csv=csv)
    report(summary, out, json, _comparison_lines)


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
