"""The study behind `grainloops diamond` and `polygon`: follow, tables, summary, figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from loops.lazy import named
from studies.output import Summary
from studies.paths.diamond import follow_diamond
from studies.paths.followed import follow_loop
from studies.paths.options import ComparisonOptions, DiamondOptions, LoopOptions, PolygonOptions
from studies.paths.orders import compare_orders
from studies.study import study

# Command, title, what follows its loops, and figures, by the kind of options.
QUESTIONS: dict[type, tuple[str, str, Any, str]] = {
    DiamondOptions: ("diamond", "Diamond", follow_diamond, "diamond"),
    PolygonOptions: ("polygon", "Loop of {.order} grains", follow_loop, "polygon"),
    LoopOptions: ("polygon", "Loop of {.order} grains", follow_loop, "polygon"),
    ComparisonOptions: ("polygon --compare", "Loops by order", compare_orders, "comparison"),
}


def run_paths(
    options: DiamondOptions | PolygonOptions | ComparisonOptions, out: Path, **how: Any
) -> Summary:
    """Follow a diamond, a loop or several orders; write `summary.json`, tables and figures."""
    command, title, follow_all, figures = QUESTIONS[type(options)]
    with study(command, out, options.described(), **how) as results:
        followed = follow_all(options)
        tables, summary, title = followed.tables(), followed.summary(), title.format(options)
        # matplotlib is loaded only if something is drawn.
        drawn = (
            named(f"studies.paths.figures.{figures}_figures")(followed) if results.figures else ()
        )
        return results.write_results(tables, summary, drawn, title)
