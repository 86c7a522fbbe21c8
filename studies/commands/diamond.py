"""`grainloops diamond`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from studies.commands.common import Csv, Force, Json, Out, out_or, report


def diamond(
    out: Out = None,
    table: Annotated[int | None, typer.Option(help="The paper's Table 1 or 2.")] = None,
    alpha0: Annotated[float | None, typer.Option(help="Reference angle (degrees).")] = None,
    kappa: Annotated[float | None, typer.Option(help="Stiffness ratio kt/kn.")] = None,
    phi: Annotated[float | None, typer.Option(help="Contact friction angle (degrees).")] = None,
    confine: Annotated[float | None, typer.Option(help="Isotropic strain at state A.")] = None,
    closure: Annotated[str, typer.Option(help="affine or traction.")] = "affine",
    contact_on_touch: Annotated[
        str, typer.Option(help="When opposite grains meet: ignore, stop or add a contact.")
    ] = "ignore",
    model: Annotated[
        str, typer.Option(help="auto, the paper's two freedoms, or full: all of them as a check.")
    ] = "auto",
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Follow the four-grain diamond of the paper; without options, its Table 1."""
    from studies.paths import DiamondOptions, run_diamond

    own = {alpha0, kappa, phi, confine} != {None}
    out = out_or(out, "diamond" if own else f"diamond-table{table or 1}")
    # The options check the words themselves, and say what is expected.
    words: Any = (closure, contact_on_touch, model)
    options = DiamondOptions(table, alpha0, kappa, phi, confine, *words)
    summary = run_diamond(options, out, force=force, csv=csv)
    report(summary, out, json, _diamond_lines)


def _cone(cone: dict[str, Any]) -> str:
    """The cone of a state in words."""
    if cone["status"] == "empty":
        return "no unstable direction"
    if cone["status"] == "ray":
        return "on the edge: second-order work vanishes in one direction"
    return f"cone of unstable directions {cone['opening_deg']:.2f} degrees wide"


def _diamond_lines(summary: dict[str, Any]) -> list[str]:
    lines = [
        f"{event['kind']:<18} E1 = {event['E1']:.10f}  E2 = {event['E2']:.10f}  "
        f"s1 = {event['s1']:.10f}  s2 = {event['s2']:.10f}"
        for event in summary["events"]
    ]
    reached = {name: state for name, state in summary["states"].items() if state is not None}
    for name, state in reached.items():
        lines.append(
            f"state {name:<12} E1 = {state['E1']:.10f}  s1 = {state['s1']:.10f}: "
            f"{state['verdict']['status']}, {_cone(state['cone'])}"
        )
    model = summary["model"]
    lines.append(
        f"model {model['choice']}: symmetry {model['symmetry']}, freedoms {model['freedoms']}"
    )
    if model["check"] is not None:
        found = model["check"]["differences"].items()
        apart = ", ".join(f"{difference:.1e} at {name}" for name, difference in found)
        lines.append(f"all freedoms against the smallest model: {apart or 'nothing to compare'}")
    return lines + [f"note: {note}" for note in summary["notes"]]
