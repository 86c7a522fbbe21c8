"""`grainloops domain`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from studies.commands.common import Csv, Force, Json, Out, numbers, out_or, report


def domain(
    out: Out = None,
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

    out = out_or(out, "domain")
    lists = numbers("--alpha0", alpha0), numbers("--kappa", kappa)
    summary = run_domain(DomainParameters(*lists, phi, directions), out, force=force, csv=csv)
    report(summary, out, json, _domain_lines)


def _domain_lines(summary: dict[str, Any]) -> list[str]:
    return [
        f"alpha0 = {case['alpha0_deg']:g}  kappa = {case['kappa']:g}  phi = {case['phi_deg']:g}  "
        f"{contacts:<10}  {summary['directions']} programmes: {found['det_Ks_zero']} lose det Ks, "
        f"{found['det_K_zero']} det K, {found['by_yielding']} by yielding"
        for case in summary["cases"]
        for contacts, found in case["contacts"].items()
    ]
