"""`grainloops series`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from studies.commands.common import (
    Answer,
    Cells,
    InertialNumber,
    MeanMass,
    Past,
    PlaneReading,
    Scheduler,
    Times,
    TimeStep,
    Workers,
    Writing,
    YieldBand,
    answer,
    out_or,
    shown,
)

# So many notes are printed, and so much of the reason why a snapshot was skipped.
NOTES, LONGEST_REASON = 8, 300
# Bistable intervals that one line names at most.
SHOWN_BISTABLE = 8
PREDICTOR_WORDS = {
    "packing": "its packing's rate problem",
    "packing_path": "its packing's path by events",
    "replay": "the DEM replayed",
    "own_motion": "its grains' motion in DEM (bound)",
    "affine": "affine closure, blocked",
    "affine_free": "affine closure, free spins",
    "traction": "traction closure, blocked",
    "traction_free": "traction closure, free spins",
    "affine_lambda_min": "least eigenvalue, affine, blocked",
    "traction_lambda_min": "least eigenvalue, tract., blocked",
    "traction_free_lambda_min": "least eigenvalue, tract., free",
    "packing_lambda_min": "least eigenvalue in its packing",
    "persistence": "its work in the interval before",
    "order": "number of grains",
    "sliding": "number of sliding contacts",
    "smallest_N": "smallest normal force",
    "coordination": "coordination",
    "mobilisation": "mean mobilisation",
    "largest_mobilisation": "largest mobilisation",
    "vibrality": "vibrality",
    "spin_vibrality": "vibrality of spins",
    "soft_modes": "share in the softest modes",
    "slip_criticality": "criticality for slip",
    "opening_criticality": "criticality for opening",
    "steric_order": "steric order",
    "density": "local density",
    "chain": "force chains",
    "past_nonaffinity": "D2min of the interval before",
}
TARGET_WORDS = {
    "nonaffine": "least affine tenth",
    "contact_lost": "contact lost",
    "topology": "topology changed",
}


def _series_lines(summary: dict[str, Any]) -> list[str]:
    fates = "  ".join(f"{name}: {count}" for name, count in summary["fates"].items())
    lines = [
        f"{summary['snapshots']} snapshots, {summary['loops']} loops in all",
        f"loops in {summary['intervals']} intervals: {fates}",
    ]
    for when in ("first", "last"):
        row = summary[when]
        lines.append(
            f"{when} snapshot: {row['loops']} loops, mean order {shown(row['mean_order'])}, "
            f"mean contacts per grain {shown(row['coordination'])}"
        )
    strains = {name: summary["last"][name] for name in ("H11", "H22")}
    said = (f"{name} = {'-' if e is None else f'{e:.6f}'}" for name, e in strains.items())
    lines.append(f"strain between them: {'  '.join(said)}")
    if "packing" in summary:
        packing = summary["packing"]
        lines.insert(
            0,
            f"rate problem of the packing ({packing['boundary'] or 'none'}): solved in "
            f"{packing['solved']} of {packing['intervals']} intervals, no solution found in "
            f"{packing['intervals'] - packing['solved']}",
        )
    if "followed" in summary:
        lines[1:1] = _followed_lines(summary["followed"])
    if "skill" in summary:
        lines += _skill_lines(summary["skill"])
    if "skill_of_targets" in summary:
        lines += _target_lines(summary["skill_of_targets"])
    lines += [
        f"skipped: snapshot {one['snapshot']} ({one['name']}): {one['reason'][:LONGEST_REASON]}"
        for one in summary["skipped"]
    ]
    lines += [f"note: {note}" for note in summary["notes"][:NOTES]]
    more = len(summary["notes"]) - NOTES
    return lines + ([f"{more} more notes are in summary.json"] if more > 0 else [])


def _followed_lines(followed: dict[str, Any]) -> list[str]:
    """Rate of the replays and where it is from; how the paths ended."""
    if followed["replay_inertial_number"] is None:
        return []
    low, high = (f"{value:.2g}" for value in followed["replay_inertial_number"])
    sources = ", ".join(
        f"{source}: {count} intervals" for source, count in followed["replay_rate_from"].items()
    )
    ends = ", ".join(f"{status}: {count}" for status, count in followed["path_statuses"].items())
    lines = [
        f"replay at inertial number {low if low == high else f'{low} to {high}'} ({sources})",
        f"path by events ({ends}), {followed['path_instabilities']} instabilities passed by "
        f"{followed['past']}",
    ]
    if followed["bistable"]:
        named = ", ".join(f"{k}-{k + 1}" for k in followed["bistable"][:SHOWN_BISTABLE])
        more = len(followed["bistable"]) - SHOWN_BISTABLE
        lines.append(
            f"path and replay end in different states (bistable) between snapshots {named}"
            + (f" and in {more} more" if more > 0 else "")
        )
    return lines


def _skill_lines(skill: dict[str, Any]) -> list[str]:
    """Skill of each prediction beside the base rate and persistence."""
    base = skill["traction"]["base"]
    if base is None:
        return []
    lines = [
        f"{100 * base:.1f} % of the loops that survived and moved did negative second-order work "
        "(base rate); how well it is predicted:",
        f"  {'':<32} precision  recall    AUC   (lowest to highest)",
    ]
    for name, row in skill.items():
        values = "  ".join(f"{shown(row[key]):>7}" for key in ("precision", "recall", "auc"))
        spread = f"   ({row['auc_min']:.3f} to {row['auc_max']:.3f})" if "auc_min" in row else ""
        lines.append(f"  {PREDICTOR_WORDS.get(name, name):<32}  {values}{spread}")
    return [*lines, "  (precision: compare with the base rate; AUC: 0.5 is chance, 1 is perfect)"]


def _target_lines(targets: dict[str, Any]) -> list[str]:
    """AUC for what else is predicted, beside the base rate and persistence."""
    lines = [f"  {'AUC for':<18} base rate  packing  persistence  own motion"]
    for target, skill in targets.items():
        values = [skill["packing"]["base"]]
        values += [skill[name]["auc"] for name in ("packing", "persistence")]
        values.append(skill.get("own_motion", {}).get("auc"))
        widths = zip(values, (9, 7, 11, 10), strict=True)
        columns = "  ".join(f"{shown(value):>{width}}" for value, width in widths)
        lines.append(f"  {TARGET_WORDS[target]:<18} {columns}")
    return lines


def series(
    *paths: Annotated[
        Path,
        Parameter(
            required=True,
            help="Files of the snapshots in order of time; of a file with several snapshots, all.",
        ),
    ],
    writing: Writing | None = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    cells: Cells = None,
    in_packing: Annotated[
        str,
        Parameter(
            metavar="rates|events",
            help="Predict each interval with the tangent of the whole packing (rates, the default "
            "of the option without a value); events: also with the packing's path from event to "
            "event, and with a DEM replay.",
        ),
    ] = "",
    yield_band: YieldBand = 0.99,
    past: Past = "viscous",
    inertial_number: InertialNumber = None,
    times: Times = None,
    time_step: TimeStep = None,
    mean_mass: MeanMass = None,
    probe: Annotated[
        int | None,
        Parameter(metavar="N", help="Probe each snapshot along N directions of strain."),
    ] = None,
    indicators: Annotated[
        bool,
        Parameter(
            help="Predict each interval by structural indicators of the loops too, beside the rate "
            "problem of the packing (coordination, vibrality, soft modes, D2min, ...)."
        ),
    ] = False,
    skip_bad: Annotated[bool, Parameter(help="Leave out snapshots that can't be read.")] = False,
    figures: Annotated[
        bool,
        Parameter(
            name="--figures",
            negative="--no-figures",
            help="Draw the figures (default).",
            show_default=False,
        ),
    ] = True,
    animation: Annotated[bool, Parameter(help="Write an animation as GIF.")] = False,
    reading: PlaneReading | None = None,
) -> Answer:
    """Follow the loops through a series of snapshots; after a stop the same command continues."""
    from studies.series import run_series

    writing, reading = writing or Writing(), reading or PlaneReading()
    out = out_or(writing.out, "series", paths[0] if paths else None)
    words: Any = {"past": past}
    try:
        summary = run_series(
            paths,
            out,
            workers=workers,
            scheduler=scheduler,
            cells=cells,
            in_packing=in_packing,
            yield_band=yield_band,
            **words,
            inertial_number=inertial_number,
            times=times,
            time_step=time_step,
            mean_mass=mean_mass,
            probe=probe,
            indicators=indicators,
            skip_bad=skip_bad,
            figures=figures,
            animation=animation,
            **writing.files(),
            **reading.how(),
        )
    except KeyboardInterrupt:
        kept = "finished snapshots are kept: the same command continues"
        raise KeyboardInterrupt(kept) from None
    return answer(writing.json, out, _series_lines(summary))
