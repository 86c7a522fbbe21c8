"""`grainloops probe`, `sustain` and `evolve`: the response of a snapshot's packing."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from studies.commands import (
    Answer,
    Candidates,
    Cells,
    FluidBulkModulus,
    Hold,
    HoldStress,
    NoFigures,
    OneReading,
    PastOption,
    PlaneReading,
    Replaying,
    Scheduler,
    StrainRatio,
    Whole,
    Workers,
    Writing,
    YieldBand,
    answer,
    clock,
    out_or,
    shown,
)

STATUS_WORDS = {
    "unique": "one solution (proved)",
    "one found": "one solution found",
    "several": "several solutions",
    "family": "a line of solutions or more",
    "none": "no solution (proved)",
    "none found": "no solution found",
    "not converged": "not converged",
    "nearest": "nearest regimes (contacts that soften are kept from sliding)",
}
# How the path went on past an instability.
PASSED_WORDS = {
    "dragged": "continued with viscous damping",
    "held": "continued with the contact held",
    "replayed": "continued by the equations of motion",
    "stopped": "ended the path",
    "lost": "where the path ends without a solution",
    "other": "of another kind",
}


FORECAST_WORDS = {"events": "path by events", "replay": "replay"}

WAYS = {"events": "followed from event to event", "increment": "each in one solve"}

# Folds that one line names at most.
SHOWN_FOLDS = 8


def _probe_lines(summary: dict[str, Any]) -> list[str]:
    statuses = ", ".join(
        f"{STATUS_WORDS.get(name, name)}: {count}" for name, count in summary["statuses"].items()
    )
    driven = "H'" if summary["control"] == "strain" else "P'"
    how = (
        f"{WAYS[summary['by']]} up to {summary['amplitude']:g}; numbers are increments over "
        f"it; boundary: {summary['boundary']}"
        if summary["amplitude"] is not None
        else f"{summary['candidates']} contacts are allowed to slide (yield band "
        f"{summary['yield_band']:g}), {summary['pieces']} different sets of sliding contacts; "
        f"boundary: {summary['boundary']}"
    )
    lines = [
        f"{summary['directions']} directions of {driven} ({summary['subspace']}): {statuses}",
        how,
    ]
    if summary["undetermined"]:
        lines.insert(0, _unanswered(summary))
    if summary["smallest_w2"] is not None:
        lines.append(
            f"smallest w2 {summary['smallest_w2']:.4f} at {summary['softest_theta_deg']:.1f} "
            f"degrees; W2 < 0 in {100 * summary['unstable_fraction']:.2f} % of directions"
        )
    least = summary["solutions_smallest_w2"]
    if least is not None and least < summary["smallest_w2"] - 1e-9:
        lines.append(
            f"of all {summary['solutions']} solutions the smallest w2 is {least:.4f} at "
            f"{summary['solutions_softest_theta_deg']:.1f} degrees; W2 < 0 in one at least of "
            f"{summary['solutions_unstable_directions']} directions"
        )
    if len(summary["folds_deg"]) and {"none", "none found"} & set(summary["statuses"]):
        folds = ", ".join(f"{angle:.2f}" for angle in summary["folds_deg"][:SHOWN_FOLDS])
        more = len(summary["folds_deg"]) - SHOWN_FOLDS
        lines.append(
            f"solutions turn back at {folds}"
            + (f" and {more} more" if more > 0 else "")
            + " degrees"
        )
    lines += [
        f"cone from {cone['begin_deg']:.2f} to {cone['end_deg']:.2f} degrees"
        + ("" if all(cone["refined"]) else " (one end is known only to the next direction)")
        for cone in summary["cones"]
    ]
    control = summary["destabilising"]
    if control["status"] == "found":
        held = ", ".join(f"{value:.4f}" for value in control["held"])
        lines.append(
            f"the sample loses its strength if this combination of strains is held constant: {held}"
        )
    if summary["orders"]:
        lines.append(
            "softest direction, by order of the loops: share of W2, share of its negative part"
        )
        lines += [
            f"  {order:>3}  {shown(row['W2_share']):>7}  {shown(row['negative_share']):>7}"
            for order, row in summary["orders"].items()
            if row["loops"]
        ]
    return lines + [f"note: {note}" for note in summary["notes"]]


def _unanswered(summary: dict[str, Any]) -> str:
    """Headline where directions have no answer, with what can be done."""
    count, of = summary["undetermined"], summary["directions"]
    if summary["ended"]:
        nearest = min(summary["ended"], key=lambda one: one["reached"])
        return (
            f"{count} of {of} directions ended before {summary['amplitude']:g}: shares are of the "
            f"others; the first is direction {nearest['direction']}, {nearest['status']} at "
            f"{nearest['reached']:.4g}: {nearest['message']}"
        )
    moves = any("the state moves" in note for note in summary["notes"])
    remedy = (
        "bring the state to rest first with --hold"
        if moves
        else "try another --yield-band, or take a snapshot farther from failure"
    )
    if summary["statuses"].get("none", 0) == count:
        return f"{count} of {of} directions have no solution, proved: shares are of the others"
    if count == of:
        return f"no solution found in any of {of} directions; {remedy}"
    return f"no solution found in {count} of {of} directions: shares are of the others; {remedy}"


def probe_command(
    path: Annotated[Path, Parameter(help="File of the snapshot, or of its grains.")],
    /,
    *,
    writing: Writing | None = None,
    directions: Annotated[Whole, Parameter(help="Number of directions.")] = 72,
    control: Annotated[
        str,
        Parameter(metavar="strain|stress", help="Which increment is prescribed in each direction."),
    ] = "strain",
    subspace: Annotated[
        str,
        Parameter(
            metavar="diagonal|symmetric",
            help="Directions (11, 22) on a circle, or with shear on a sphere.",
        ),
    ] = "diagonal",
    yield_band: YieldBand = 0.99,
    amplitude: Annotated[
        float | None,
        Parameter(help="Finite probe to this strain. Default: infinitesimal."),
    ] = None,
    by: Annotated[
        str,
        Parameter(
            metavar="events|increment",
            help="Way to the amplitude: from event to event, or in one solve.",
        ),
    ] = "events",
    candidates: Candidates = 0.7,
    past: PastOption = "viscous",
    hold: Hold = False,
    hold_stress: HoldStress = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    no_figures: NoFigures = False,
    reading: OneReading | None = None,
) -> Answer:
    """Probe a DEM snapshot in many directions: response envelope, cones, unstable loops.

    Status of a direction. unique: one solution, proved. one found: one solution, others are
    possible. several: at least two solutions. family: solutions in unbroken rows. none: no solution
    exists, proved. none found: no solution was found. not converged: a mechanism moves. Column
    proof says what each stands on.
    """
    writing, reading = writing or Writing(), reading or OneReading()
    out = out_or(writing.out, "probe", path)
    words: Any = {"control": control, "subspace": subspace, "past": past, "by": by}
    with clock("grainloops probe") as tell:
        from studies.probe import run_probe

        summary = run_probe(
            path,
            out,
            directions=directions,
            **words,
            yield_band=yield_band,
            amplitude=amplitude,
            candidates=candidates,
            hold=hold,
            hold_stress=hold_stress,
            workers=workers,
            scheduler=scheduler,
            figures=not no_figures,
            progress=lambda done: tell(f"{done} of {directions} directions"),
            **writing.files(),
            **reading.how_of(path),
        )
    said = answer(writing.json, out, _probe_lines(summary))
    # The question found no answer at all.
    return replace(said, status=int(summary["undetermined"] == summary["directions"]))


def _sustain_lines(summary: dict[str, Any]) -> list[str]:
    statuses = ", ".join(f"{count} {name}" for name, count in summary["statuses"].items())
    lines = [
        f"{summary['directions']} directions of the stress rate ({summary['subspace']}), load up "
        f"to {summary['largest']:.4g}: {statuses}"
    ]
    weakest = summary["weakest"]
    if weakest is None:
        lines.append("the equilibrium was lost in no direction")
    elif weakest["first_large_load"] is not None:
        lines.append(
            f"first large motion: under {weakest['first_large_load']:.4g}, by a strain of "
            f"{weakest['first_large_strain']:.2g}, at {weakest['theta_deg']:.1f} degrees"
            f"{_within(weakest['first_large_spread'])}"
        )
        lines.append(
            f"first loss of equilibrium in this direction: {weakest['limit']:.4g}"
            f"{_within(weakest['limit_spread'], weakest['limit_converged'])}"
        )
    else:
        lines.append(
            "no large motion; the smallest load at which the equilibrium was lost: "
            f"{weakest['limit']:.4g}, at {weakest['theta_deg']:.1f} degrees"
            f"{_within(weakest['limit_spread'], weakest['limit_converged'])}"
        )
    own, more = (summary[key] / summary["directions"] for key in ("seconds", "spread_seconds"))
    lines.append(f"processor time a direction: {own:.2g} s, {more:.2g} s more for its spreads")
    return lines + [f"note: {note}" for note in summary["notes"]]


def _within(spread: float | None, converged: bool = True) -> str:
    """A spread in words."""
    if not converged:
        return " (not converged)"
    return "" if spread is None else f" (spread {100 * spread:.1g} %)"


def sustain_command(
    path: Annotated[Path, Parameter(help="Snapshot with forces, periodic or between known walls.")],
    /,
    *,
    writing: Writing | None = None,
    directions: Annotated[Whole, Parameter(help="Number of directions of the stress rate.")] = 24,
    subspace: Annotated[
        str,
        Parameter(
            metavar="diagonal|symmetric",
            help="Stress components that change: 11 and 22, or also the shear stress.",
        ),
    ] = "diagonal",
    largest: Annotated[
        float | None,
        Parameter(
            help="Largest load (force/length) in each direction, added to the stress of the start. "
            "Default: a tenth of the mean stress."
        ),
    ] = None,
    interval: Annotated[float, Parameter(help="Strain over which the geometry is kept.")] = 5e-6,
    large: Annotated[float, Parameter(help="Strain from which on a motion is large.")] = 3e-4,
    most_snaps: Annotated[
        Whole,
        Parameter(help="Largest number of smaller motions; a direction with more is unfinished."),
    ] = 30,
    no_spread: Annotated[
        bool,
        Parameter(
            negative="",
            help="Don't load again with other numberings and less damping to tell the spread.",
        ),
    ] = False,
    hold_stress: Annotated[
        bool,
        Parameter(help="Bring the sample to rest at fixed stress first. Default: at fixed cell."),
    ] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    no_figures: NoFigures = False,
    reading: OneReading | None = None,
) -> Answer:
    """Find the load of the first large motion of a DEM snapshot in each direction of stress."""
    writing, reading = writing or Writing(), reading or OneReading()
    out = out_or(writing.out, "sustain", path)
    words: Any = {"subspace": subspace}
    with clock("grainloops sustain"):
        from studies.sustain import run_sustain

        try:
            summary = run_sustain(
                path,
                out,
                directions=directions,
                **words,
                largest=largest,
                interval=interval,
                large=large,
                most_snaps=most_snaps,
                spread=not no_spread,
                hold_stress=hold_stress,
                workers=workers,
                scheduler=scheduler,
                figures=not no_figures,
                **writing.files(),
                **reading.how_of(path),
            )
        except KeyboardInterrupt:
            kept = "finished directions are kept; the same command computes the others"
            raise KeyboardInterrupt(kept) from None
    return answer(writing.json, out, _sustain_lines(summary))


def _evolve_lines(summary: dict[str, Any]) -> list[str]:
    counts = ", ".join(f"{count} {kind}" for kind, count in summary["events"].items())
    lines = [
        f"{summary['status']} at {summary['driven']} = {summary['reached']:.4g} of "
        f"{summary['to']:g}: {summary['message']}",
        f"{summary['intervals']} intervals, events: {counts or 'none'}",
    ]
    if summary["limit"] is not None:
        told = _within(summary["limit_spread"], summary["limit_spread"] is not None)
        lines.append(f"limit at {summary['driven']} = {summary['limit']:.4g}{told}")
    if summary["unstable_contacts"]:
        ways = ", ".join(
            f"{count} {PASSED_WORDS.get(name, name)}" for name, count in summary["passed"].items()
        )
        told = "ask for it by --spread"
        if summary["stress_spread"] is not None:
            told = f"{100 * summary['stress_spread']:.2g} % of its change"
        lines.append(
            f"{summary['unstable_contacts']} unstable contacts; instabilities: {ways}; spread of "
            f"the stress behind the first: {told}"
        )
    if summary["replay"] is not None:
        rate = summary["replay"]
        lines.append(f"replay at inertial number {rate['inertial_number']:.2g} ({rate['source']})")
    lines.append(f"end: {_values(summary['end'])}")
    beside = summary["replay"] or {}
    if "end" in beside:
        share, apart = beside["negative_loops"], beside["path_from_replay"]
        lines.append(
            f"end of the replay: {_values(beside['end'])}"
            + ("" if share is None else f"; W2 < 0 in {100 * share:.1f} % of loops")
            + (
                ""
                if apart is None
                else f"; forces of path and replay differ by {apart:.2g} of what the replay changes"
            )
        )
    lines += [
        f"{FORECAST_WORDS[name]}: error of the driven stress {row['error']:.4g}, of the stress of "
        f"the start {row['persistence_error']:.4g}, over {row['snapshots']} snapshots; below half "
        f"of it up to {row['holds_to']:.3g}; drops of stress: {row['drops_predicted']} of "
        f"{row['drops']} predicted, {row['drops_false']} false"
        for name, row in (summary["forecast"] or {}).items()
        if row["error"] is not None
    ]
    if summary["negative_loops"] is not None:
        lines.append(
            f"W2 < 0 in {100 * summary['negative_loops']:.1f} % of {summary['loops']} loops"
        )
    return lines + [f"note: {note}" for note in summary["notes"]]


def _values(row: dict[str, float]) -> str:
    return "  ".join(f"{name} = {value:.6g}" for name, value in row.items())


def evolve_command(
    *paths: Annotated[
        Path,
        Parameter(
            required=True,
            help="Snapshot to start from; further snapshots are plotted for comparison.",
        ),
    ],
    writing: Writing | None = None,
    to: Annotated[
        float,
        Parameter(help="Change of the driven strain or stress, negative in extension; say 1e-4."),
    ],
    programme: Annotated[
        str,
        Parameter(
            metavar="NAME",
            help="Loading programme: drained (nominal stress across it constant), cauchy-drained "
            "or biaxial (Cauchy stress), isotropic, isotropic-stress, oedometric, undrained, "
            "proportional-strain, simple-shear.",
        ),
    ] = "drained",
    fluid_bulk_modulus: FluidBulkModulus = None,
    strain_ratio: StrainRatio = None,
    axis: Annotated[
        Whole,
        Parameter(help="Driven axis: 1 or 2; of simple-shear the axis along which it slides."),
    ] = 1,
    rows: Annotated[Whole, Parameter(help="Rows of the path, evenly spaced.")] = 20,
    interval: Annotated[
        float,
        Parameter(help="Strain over which the geometry is kept; the error is proportional to it."),
    ] = 5e-6,
    instabilities: Annotated[Whole, Parameter(help="Stop after this many unstable contacts.")] = 20,
    past: PastOption = "viscous",
    pathologies: Annotated[
        bool,
        Parameter(
            help="Tell at every row whether the matrix of the contacts at yield is symmetric, "
            "positive definite, a P-matrix, and how many solutions the rate problem has."
        ),
    ] = False,
    by: Annotated[
        str,
        Parameter(
            metavar="events|replay|both",
            help="Follow from event to event, or replay by the equations of motion, or both; "
            "tables and map are those of the first, of both the replay has tables of its own.",
        ),
    ] = "events",
    spread: Annotated[
        bool,
        Parameter(
            negative="",
            help="Follow it a second time if it meets an instability, with stiffer springs or less "
            "damping there, and say how far the stresses part.",
        ),
    ] = False,
    replaying: Replaying | None = None,
    hold: Hold = False,
    hold_stress: HoldStress = False,
    cells: Cells = None,
    no_figures: NoFigures = False,
    animation: Annotated[
        bool, Parameter(help="Draw the second-order work of the loops row by row, as GIF.")
    ] = False,
    reading: PlaneReading | None = None,
) -> Answer:
    """Follow a DEM snapshot by events or by a replay: stresses, events, W2 of the loops."""
    writing, reading = writing or Writing(), reading or PlaneReading()
    out = out_or(writing.out, "evolve", paths[0])
    words: Any = {"programme": programme, "past": past, "by": by}
    with clock("grainloops evolve") as tell:
        from studies.evolve import run_evolve

        summary = run_evolve(
            paths,
            out,
            to=to,
            **words,
            axis=axis,
            fluid_bulk_modulus=fluid_bulk_modulus,
            strain_ratio=strain_ratio,
            rows=rows,
            interval=interval,
            instabilities=instabilities,
            spread=spread,
            pathologies=pathologies,
            **asdict(replaying or Replaying()),
            hold=hold,
            hold_stress=hold_stress,
            cells=cells,
            figures=not no_figures,
            animation=animation,
            progress=lambda reached: tell(f"{reached:.3g} of {abs(to):g}"),
            **writing.files(),
            **reading.how(),
        )
    return answer(writing.json, out, _evolve_lines(summary))
