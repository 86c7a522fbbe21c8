"""`grainloops bench`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from studies.commands import common
from studies.commands.common import Force, Json, Out, out_or, report


def bench(
    out: Out = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Smaller sizes, fewer settings, nothing compiled.")
    ] = False,
    only: Annotated[
        str | None, typer.Option(metavar="NAME,...", help="Some groups, such as faces,hard-cases.")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Measure speed against error of every method with a choice, and run the hard cases."""
    from studies.bench import run_bench

    out = out_or(out, "bench")

    def say(name: str) -> None:
        if not common.quiet:
            typer.echo(f"bench: {name}", err=True)

    summary = run_bench(out, quick=quick, only=only, force=force, progress=say)
    report(summary, out, json, _bench_lines)


def _bench_lines(summary: dict[str, Any]) -> list[str]:
    lines = []
    for name, group in summary["groups"].items():
        for row in group["defaults"][:1]:
            knee = group["knee"]
            lines.append(
                f"{name:<20} {row['method']} ({row['setting']}): "
                f"{row['seconds_per_item']:.1e} s, error {row['error']:.0e}; "
                f"knee {knee['method']} ({knee['setting']}): "
                f"{knee['seconds_per_item']:.1e} s, error {knee['error']:.0e}"
            )
    hard = summary["hard_cases"]
    if hard["cases"]:
        lines.append(
            f"hard cases: {hard['cases']}, tangents {hard['tangents']}, wrong signs "
            f"{hard['wrong_signs']}, errors over their bound {hard['over_bound']}, "
            f"unexpected {len(hard['unexpected']) + len(hard['paths_missed'])}"
        )
    return lines
