"""`grainloops material`: averaged loops as a material."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from loops.errors import InputError
from studies.commands import (
    Answer,
    OneReading,
    Writing,
    answer,
    clock,
    driven_line,
    flags,
    numbers,
    out_or,
)
from studies.commands.printed import printed
from studies.questions import Averaging

# Options of a loop that is made, and of a snapshot's.
OF_LOOP = ("order", "alpha0_deg", "orientations", "kappa", "phi_deg", "confine")
OF_SNAPSHOT = ("orders", "count")


def material_command(
    snapshot: Path | None = None,
    *,
    asked: Averaging = Averaging(),
    writing: Writing = Writing(),
    reading: OneReading = OneReading(),
) -> Answer:
    """Average loops as a material, and march the mean through a programme.

    Copies of one loop (--order) in all directions, or the loops of a snapshot; beside them one of
    the loops alone.

    Parameters
    ----------
    snapshot
        Snapshot whose loops are averaged, with its law and forces.
    """
    given = {name: value for name, value in asdict(asked).items() if value is not None}
    of_loop, of_snapshot = ([n for n in names if n in given] for names in (OF_LOOP, OF_SNAPSHOT))
    if snapshot is not None and of_loop:
        expected = "none of these: loops of a snapshot have their own law and state"
        raise InputError(flags(of_loop), "given with a snapshot", expected, "Leave them out.")
    if snapshot is None and (read := flags([*reading.given(), *of_snapshot])):
        raise InputError(read, "given without a snapshot", "a snapshot", "Name its file.")
    listed = numbers("--orders", given.pop("orders", None))
    if listed is not None:
        given["orders"] = tuple(int(n) if n == int(n) else n for n in listed)
    given.setdefault("end", 1e-1 if snapshot is None else 1e-3)
    out = out_or(writing.out, "material", snapshot)
    with clock("grainloops material"):
        from studies.material import MaterialOptions, run_material

        how = {} if snapshot is None else reading.how_of(snapshot)
        options = MaterialOptions(**given)
        summary = run_material(options, out, snapshot=snapshot, **writing.files(), **how)
    sets = {"mean of the loops": summary["mean"]}
    sets[f"loop {summary['loop']} alone"] = summary["single"]
    driven = None if snapshot is None else driven_line(summary)
    lines = printed("material", summary, driven_line=driven, sets=sets)
    return answer(writing.json, out, lines, summary["notes"])
