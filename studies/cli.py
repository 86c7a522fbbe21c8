"""The command line: `grainloops`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from loops.errors import InputError

app = typer.Typer(
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Stability of grain loops in two-dimensional granular media. Angles in degrees; "
    "forces, stresses and strains positive in compression.",
)

# Loop orders from this one on are printed together.
LAST_SHOWN = 7

Out = Annotated[Path, typer.Option(help="Result folder; created.", show_default=False)]
Force = Annotated[bool, typer.Option("--force", help="Replace results of the same names.")]
Csv = Annotated[bool, typer.Option("--csv", help="Write the tables as CSV too.")]
Json = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]


@app.callback()
def grainloops(context: typer.Context) -> None:
    """Show the help when no command is given."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def snapshot(
    path: Annotated[Path, typer.Argument(help="Table of grains (CSV, CSV.gz, Parquet).")],
    out: Out,
    contacts: Annotated[
        Path | None, typer.Option(help="Table of contacts; found beside PATH by its name.")
    ] = None,
    cell: Annotated[
        str | None,
        typer.Option(metavar="HXX,HXY,HYX,HYY", help="Periodic cell; columns are its vectors."),
    ] = None,
    kn: Annotated[float | None, typer.Option(help="Normal stiffness the table lacks.")] = None,
    kt: Annotated[float | None, typer.Option(help="Shear stiffness the table lacks.")] = None,
    mu: Annotated[float | None, typer.Option(help="Friction (tan) the table lacks.")] = None,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Find the loops of a DEM snapshot and judge the stability of each."""
    from studies.snapshot import SnapshotInput, run_snapshot

    source = SnapshotInput(path, contacts, _cell(cell), kn, kt, mu)
    summary = run_snapshot(source, out, force=force, csv=csv)
    _report(summary, out, json, _snapshot_lines)


@app.command()
def diamond(
    out: Out,
    table: Annotated[int | None, typer.Option(help="The paper's Table 1 or 2.")] = None,
    alpha0: Annotated[float | None, typer.Option(help="Reference angle (degrees).")] = None,
    kappa: Annotated[float | None, typer.Option(help="Stiffness ratio kt/kn.")] = None,
    phi: Annotated[float | None, typer.Option(help="Contact friction angle (degrees).")] = None,
    confine: Annotated[float | None, typer.Option(help="Isotropic strain at state A.")] = None,
    closure: Annotated[str, typer.Option(help="affine or traction.")] = "affine",
    sliding: Annotated[str, typer.Option(help="coulomb or printed.")] = "coulomb",
    contact_on_touch: Annotated[
        str, typer.Option(help="When opposite grains meet: ignore, stop or add a contact.")
    ] = "ignore",
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Follow the four-grain diamond of the paper; without options, its Table 1."""
    from studies.diamond import DiamondParameters, run_diamond

    # The parameters check the words themselves, and say what is expected.
    words: Any = (closure, sliding, contact_on_touch)
    parameters = DiamondParameters(table, alpha0, kappa, phi, confine, *words)
    summary = run_diamond(parameters, out, force=force, csv=csv)
    _report(summary, out, json, _diamond_lines)


@app.command()
def domain(
    out: Out,
    alpha0: Annotated[
        str | None, typer.Option(help="Reference angles (degrees), by commas.")
    ] = None,
    kappa: Annotated[str | None, typer.Option(help="Stiffness ratios kt/kn, by commas.")] = None,
    phi: Annotated[float | None, typer.Option(help="Contact friction angle (degrees).")] = None,
    directions: Annotated[int, typer.Option(help="Programmes of the fan, an odd number.")] = 1441,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Draw the diamond's bifurcation domain; without options, of the paper's Tables 1 and 2."""
    from studies.domain import DomainParameters, run_domain

    lists = _numbers("--alpha0", alpha0), _numbers("--kappa", kappa)
    summary = run_domain(DomainParameters(*lists, phi, directions), out, force=force, csv=csv)
    _report(summary, out, json, _domain_lines)


@app.command()
def polygon(
    out: Out,
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
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Follow a regular loop of any order, or compare orders: confined, then loaded."""
    from studies.polygon import PolygonParameters, run_polygon

    if (order is None) == (compare is None):
        given = "neither" if order is None else "both"
        raise InputError("--order, --compare", given, "one of them", "Write --order 6.")
    # The parameters check the words themselves, and say what is expected.
    words: Any = (orientation, kappa, phi, closure, spins, confine, programme, end)
    if compare is not None:
        _compare_polygons(compare, words, out, force, csv, json)
        return
    summary = run_polygon(PolygonParameters(order or 0, *words), out, force=force, csv=csv)
    _report(summary, out, json, _polygon_lines)


def _compare_polygons(
    orders: str, words: Any, out: Path, force: bool, csv: bool, json: bool
) -> None:
    from studies.polygon import ComparisonParameters, PolygonParameters, run_comparison
    from studies.polygon.comparison import orders_of

    listed = orders_of(orders)
    parameters = ComparisonParameters(listed, PolygonParameters(listed[0], *words))
    summary = run_comparison(parameters, out, force=force, csv=csv)
    _report(summary, out, json, _comparison_lines)


def _polygon_lines(summary: dict[str, Any]) -> list[str]:
    critical = "  ".join(
        f"{name}: {'none' if strain is None else f'{strain:.10f}'}"
        for name, strain in summary["critical_strain"].items()
    )
    lines = [f"critical isotropic strain  {critical}"]
    lines += [
        f"{event['kind']:<16} {event['subspace'] or '':<10} E1 = {event['E1']:.8f}  "
        f"E2 = {event['E2']:.8f}  s1 = {event['s1']:.8f}  s2 = {event['s2']:.8f}"
        for event in summary["events"]
    ]
    if summary["peak"] is not None:
        peak = summary["peak"]
        lines.append(f"peak of s1 = {peak['s1']:.8f} at E1 = {peak['E1']:.8f}")
    return lines + [f"note: {note}" for note in summary["notes"]]


def _comparison_lines(summary: dict[str, Any]) -> list[str]:
    lines = [
        "order  critical strain in 11, 22 / symmetric / full, E1 at first yield, peak s1, status"
    ]
    for loop in summary["loops"]:
        strains = [_number(strain) for strain in loop["critical_strain"].values()]
        first, peak = ((loop[name] or {}) for name in ("first_yield", "peak"))
        values = [*strains, _number(first.get("E1")), _number(peak.get("s1"))]
        shown = "  ".join(f"{value:>9}" for value in values)
        lines.append(f"{loop['order']:>5}  {shown}  {loop['status']}")
    return lines + [f"note: {note}" for note in summary["notes"]]


def _domain_lines(summary: dict[str, Any]) -> list[str]:
    return [
        f"alpha0 = {case['alpha0_deg']:g}  kappa = {case['kappa']:g}  phi = {case['phi_deg']:g}  "
        f"{contacts:<10}  {summary['directions']} programmes: {found['det_Ks_zero']} lose det Ks, "
        f"{found['det_K_zero']} det K, {found['by_yielding']} by yielding"
        for case in summary["cases"]
        for contacts, found in case["contacts"].items()
    ]


def _numbers(name: str, text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            name, repr(text), "numbers separated by commas", "Write 35,45 for example."
        ) from None


def _diamond_lines(summary: dict[str, Any]) -> list[str]:
    lines = [
        f"{event['kind']:<18} E1 = {event['E1']:.10f}  E2 = {event['E2']:.10f}  "
        f"s1 = {event['s1']:.10f}  s2 = {event['s2']:.10f}"
        for event in summary["events"]
    ]
    return lines + [f"note: {note}" for note in summary["notes"]]


def _cell(text: str | None) -> tuple[float, float, float, float] | None:
    if text is None:
        return None
    try:
        xx, xy, yx, yy = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            "--cell", repr(text), "four numbers HXX,HXY,HYX,HYY", "Separate them by commas."
        ) from None
    return xx, xy, yx, yy


def _snapshot_lines(summary: dict[str, Any]) -> list[str]:
    orders = "  ".join(f"{n}: {count:.0f}" for n, count in _grouped(summary, None).items())
    lines = [
        f"{summary['grains']} grains, {summary['contacts']} contacts, "
        f"coordination {summary['coordination']:.3f} without {summary['dangling_grains']} dangling",
        f"{summary['loops']} loops, mean order {_number(summary['mean_order'])} ({orders})",
        f"Euler's formula {'holds' if summary['euler_ok'] else 'FAILS'}; "
        f"{100 * summary['sliding_fraction']:.1f} % of the contacts slide",
    ]
    for closure, shares in summary["unstable_fraction"].items():
        unstable = _grouped(summary, shares)
        text = "  ".join(f"{n}: {100 * share:.2g} %" for n, share in unstable.items())
        lines.append(f"unstable loops by order, {closure}: {text}")
    return lines + [f"note: {note}" for note in summary["notes"]]


def _grouped(summary: dict[str, Any], shares: dict[str, float] | None) -> dict[str, float]:
    """Loops of orders 3 to 6 and beyond; with shares, their mean over the loops of each group."""
    counts: dict[str, float] = {}
    sums: dict[str, float] = {}
    for n, count in summary["orders"].items():
        group = n if int(n) < LAST_SHOWN else f"{LAST_SHOWN}+"
        counts[group] = counts.get(group, 0) + count
        sums[group] = sums.get(group, 0.0) + count * (0.0 if shares is None else shares[n])
    if shares is None:
        return counts
    return {group: sums[group] / counts[group] for group in counts}


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _report(summary: dict[str, Any], out: Path, json: bool, lines: Any) -> None:
    if json:
        from studies.output import as_json

        typer.echo(as_json(summary))
        return
    for line in [*lines(summary), f"results in {out}"]:
        typer.echo(line)


# click's UsageError, wherever typer keeps it.
UsageError: Any = typer.BadParameter.__base__


def main() -> None:
    """Run the command; bad input gives one line on stderr and exit status 2."""
    try:
        status = app(standalone_mode=False)
    except InputError as error:
        _fail(str(error))
    except UsageError as error:
        _fail(f"{error.format_message().rstrip('.')}. Try 'grainloops --help'.")
    except (typer.Abort, KeyboardInterrupt):
        typer.echo("grainloops: interrupted; nothing was written.", err=True)
        sys.exit(130)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(message: str) -> None:
    typer.echo(f"grainloops: {' '.join(message.split())}", err=True)
    sys.exit(2)


if __name__ == "__main__":
    main()
