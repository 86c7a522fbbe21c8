"""`grainloops material`: averaged loops as a material."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from loops.errors import InputError
from studies.commands import (
    Answer,
    OneReading,
    Writing,
    answer,
    clock,
    driven_line,
    numbers,
    out_or,
)
from studies.questions import FURTHER, FluidBulkModulus, StrainRatio, Whole


def material_command(
    snapshot: Path | None = None,
    *,
    order: Whole | None = None,
    alpha0: Annotated[float | None, Parameter(group=FURTHER)] = None,
    orientations: Annotated[Whole | None, Parameter(group=FURTHER)] = None,
    kappa: float | None = None,
    phi: float | None = None,
    confine: Annotated[float | None, Parameter(group=FURTHER)] = None,
    orders: Annotated[str | None, Parameter(group=FURTHER, metavar="N1,N2,...")] = None,
    count: Annotated[Whole | None, Parameter(group=FURTHER)] = None,
    closure: str = "traction",
    programme: str = "drained",
    fluid_bulk_modulus: FluidBulkModulus = None,
    strain_ratio: StrainRatio = None,
    axis: Annotated[Whole | None, Parameter(group=FURTHER)] = None,
    single: Annotated[Whole | None, Parameter(group=FURTHER)] = None,
    end: float | None = None,
    steps: Annotated[Whole, Parameter(group=FURTHER)] = 200,
    writing: Writing | None = None,
    reading: OneReading | None = None,
) -> Answer:
    """Average loops as a material, and march the mean through a programme.

    Copies of one loop (--order) in all directions, or the loops of a snapshot; beside them one of
    the loops alone.

    Parameters
    ----------
    snapshot
        Snapshot whose loops are averaged, with its law and forces.
    order
        Number of grains of a regular loop. Default: 6.
    alpha0
        Angle of a hexagon's inclined branches (degrees).
    orientations
        Copies of the loop, turned evenly over half a turn. Default: 36.
    kappa
        Stiffness ratio kt/kn. Default: 0.5.
    phi
        Friction angle of the contacts (degrees). Default: 30.
    confine
        Isotropic stress over kn before the programme. Default: 0.01.
    orders
        Orders of the snapshot's loops to average. Default: all.
    count
        Largest number of the snapshot's loops, taken at even spacing.
    closure
        How the mean strain drives a loop: affine, traction, or cell (the H-model's).
    programme
        Loading programme: drained, cauchy-drained, biaxial, isotropic, isotropic-stress,
        oedometric, undrained, proportional-strain.
    axis
        Driven axis, 1 or 2. Default: that of the major stress of a snapshot's loops, else 1.
    single
        Number in loops.parquet of the loop that is also followed alone. Default: of the median
        order, the one with the stress nearest to the mean at the start.
    end
        Driven strain at the end (isotropic-stress: stress). Default: 0.1; for a snapshot 1e-3.
    steps
        Number of steps of the programme.
    """
    writing, reading = writing or Writing(), reading or OneReading()
    of_loop = {"order": order, "alpha0_deg": alpha0, "orientations": orientations,
               "kappa": kappa, "phi_deg": phi, "confine": confine}  # fmt: skip
    asked: dict[str, Any] = {name: value for name, value in of_loop.items() if value is not None}
    read = [one.name for one in fields(reading) if getattr(reading, one.name) != one.default]
    if snapshot is not None and asked:
        given = ", ".join(f"--{name.removesuffix('_deg')}" for name in asked)
        expected = "none of these: loops of a snapshot have their own law and state"
        raise InputError(given, "given with a snapshot", expected, "Leave them out.")
    if snapshot is None and (read or orders is not None or count is not None):
        given = ", ".join(
            [*(f"--{name.replace('_', '-')}" for name in read),
             *["--orders"] * (orders is not None), *["--count"] * (count is not None)]
        )  # fmt: skip
        raise InputError(given, "given without a snapshot", "a snapshot", "Name its file.")
    listed = numbers("--orders", orders)
    if listed is not None:
        asked["orders"] = tuple(int(n) if n == int(n) else n for n in listed)
    words: Any = {"closure": closure, "programme": programme, "steps": steps, "count": count}
    words |= {"fluid_bulk_modulus": fluid_bulk_modulus, "strain_ratio": strain_ratio}
    words |= {"single": single, "axis": axis}
    words["end"] = (1e-1 if snapshot is None else 1e-3) if end is None else end
    out = out_or(writing.out, "material", snapshot)
    with clock("grainloops material"):
        from studies.material import MaterialOptions, run_material

        options = MaterialOptions(**asked, **words)
        how = {} if snapshot is None else reading.how_of(snapshot)
        summary = run_material(options, out, snapshot=snapshot, **writing.files(), **how)
    many = ", ".join(f"{count} of order {n}" for n, count in summary["orders"].items())
    lines = [] if snapshot is None else [driven_line(summary)]
    lines += [f"{summary['loops']} loops ({many}), closure {closure}, {programme}, {steps} steps"]
    for name, said in (("mean", "mean of the loops"), ("single", f"loop {summary['loop']} alone")):
        told = summary[name]
        peak = "no peak"
        if told["peak_strain"] is not None:
            peak = f"peak {told['peak_stress_ratio']:.4f} at strain {told['peak_strain']:.4f}"
        lines.append(
            f"{said}: {told['status']} at strain {told['end_strain']:.4f}, stress ratio {peak}, "
            f"W2 < 0 from {_strain(told['w2_negative_strain'])}, "
            f"cone from {_strain(told['cone_strain'])}, loops lost {told['failed']:.0%}"
        )
    return answer(writing.json, out, lines, summary["notes"])


def _strain(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
