"""Run the sweep: `python -m studies.sweep --out DIR [--diamonds 100000]`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from patterns.diamond import DrainedEnd
from studies.output import provenance, result_folder, write_summary, write_table
from studies.sweep.figures import draw
from studies.sweep.methods import compare
from studies.sweep.point_b import RANGES, Floats, random_diamonds


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    diamonds: Annotated[int, typer.Option(help="Size of the sweep.")] = 100_000,
    checked: Annotated[int, typer.Option(help="Paths checked against mpmath.")] = 100,
    paths: Annotated[int, typer.Option(help="Paths given to solve_ivp.")] = 300,
    seed: Annotated[int, typer.Option(help="Seed of the draw.")] = 1,
    repeats: Annotated[int, typer.Option(help="Timed sweeps.")] = 3,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Sweep, compare, write the tables and the figure."""
    drawn = random_diamonds(diamonds, seed)
    end, rows = compare(drawn, checked, paths, seed, repeats)
    summary = {
        "diamonds": diamonds,
        "status": _counts(end.status),
        "falling_alpha": int(np.count_nonzero(end.direction < 0)),
        "methods": rows,
        "speed_ratio": {
            row["method"]: rows[0]["paths_per_second"] / row["paths_per_second"] for row in rows[1:]
        },
    }
    for row in rows:
        rate, worst = row["paths_per_second"], row["error_max"]
        typer.echo(f"{row['method']:<26} {rate:12.0f} paths/s   error up to {worst:.1e}")
    typer.echo(f"{diamonds} diamonds in {rows[0]['seconds']:.2f} s: {summary['status']}")
    with result_folder(out, force=force) as folder:
        configuration: dict[str, Any] = {"diamonds": diamonds, "seed": seed, "ranges": RANGES}
        configuration |= {"checked": checked, "paths": paths, "repeats": repeats}
        made = provenance("sweep of drained paths", configuration, "dimensionless, degrees")
        write_table(folder, "sweep", _table(drawn, end), made, csv=False)
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        write_table(folder, "methods", columns, made, csv=True)
        write_summary(folder, {**summary, "provenance": made})
        draw(rows, folder, made)


def _counts(status: NDArray[np.str_]) -> dict[str, int]:
    names, counts = np.unique(status, return_counts=True)
    return dict(zip(names.tolist(), counts.tolist(), strict=True))


def _table(diamonds: Floats, end: DrainedEnd) -> dict[str, Any]:
    alpha0, kappa, phi, confinement = diamonds.T
    measures = {name: getattr(end.state, name) for name in ("E1", "E2", "s1", "s2", "N", "T")}
    return {
        "alpha0_deg": np.degrees(alpha0),
        "kappa": kappa,
        "phi_deg": np.degrees(phi),
        "confinement": confinement,
        "status": end.status.astype(object),
        "direction": end.direction,
        "alpha_deg": np.degrees(end.state.alpha),
        **measures,
    }


if __name__ == "__main__":
    typer.run(main)
