"""`grainloops bench`."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import Parameter

from studies.commands.common import Answer, Force, Json, Out, answer, clock, out_or


def bench(
    *,
    out: Out = None,
    quick: Annotated[
        bool, Parameter(help="Smaller sizes, fewer settings, nothing compiled.")
    ] = False,
    only: Annotated[
        str | None,
        Parameter(metavar="NAME,...", help="Some groups only, such as faces,hard-cases."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> Answer:
    """Measure speed against error of the methods that can be chosen, and run the hard cases."""
    out = out_or(out, "bench")
    with clock("grainloops bench") as tell:
        from studies.bench import run_bench

        summary = run_bench(out, quick=quick, only=only, force=force, progress=tell)
    return answer(json, out, _bench_lines(summary))


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
