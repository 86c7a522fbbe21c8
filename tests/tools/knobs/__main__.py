"""Change the numbers fixed in the code: `python -m tests.tools.knobs --out DIR --rooms FOLDER`.

Each is multiplied and divided by 3, tolerances by 100, in a fork of this process; what kernels or
other numbers have frozen is changed in the source of a copy, with compiled code of its own. Answers
in whose course nothing reads the number are not asked again.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import cyclopts
import pandas as pd
from cyclopts import Parameter

from studies.output import provenance, result_folder, write_summary, write_table
from tests.tools.knobs.answers import ANSWERS
from tests.tools.knobs.compare import moved
from tests.tools.knobs.numbers import (
    ROOMS,
    ROOT,
    Number,
    change,
    changed,
    code_called,
    edited,
    frozen,
    holders,
    numbers_of,
    reads,
)
from tests.tools.mutation.__main__ import copied

# Seconds of processor time after which an answer is given up; of a copy, which compiles, seconds.
PATIENCE = 60.0
LONGEST = 1200.0
COLUMNS = ("number", "place", "value", "factor", "answer", "entry", "size", "effect")


def main(
    out: Annotated[Path, Parameter(help="Result folder.")],
    rooms: Annotated[str, Parameter(help="Folders and files, separated by blanks.")] = " ".join(
        ROOMS
    ),
    only: Annotated[str, Parameter(help="Names of numbers, separated by commas.")] = "",
    answers: Annotated[str, Parameter(help="Answers, separated by commas.")] = ",".join(ANSWERS),
    force: Annotated[bool, Parameter(negative=(), help="Replace results.")] = False,
) -> None:
    """Change numbers one at a time, and list the answers that move by more than they state."""
    numbers = numbers_of(ROOT, rooms.split())
    if only:
        numbers = [number for number in numbers if number.name in only.split(",")]
    with result_folder(out, force=force) as folder:
        base, called = {}, {}
        for name in answers.split(","):
            ANSWERS[name]()
            base[name], called[name] = code_called(ANSWERS[name])
        rows: list[tuple[Any, ...]] = []
        for row in tried(numbers, base, called):
            rows.append(row)
            print(*row, sep="  ", flush=True)
        table = pd.DataFrame(rows, columns=list(COLUMNS))
        made = provenance("numbers fixed in the code", {"rooms": rooms, "only": only}, "")
        write_table(folder, "numbers", dict(table), made, csv=True)
        (folder / "numbers.md").write_text(as_markdown(table))
        write_summary(folder, {"numbers": len(numbers), "provenance": made})


def tried(
    numbers: list[Number], base: dict[str, Any], called: dict[str, Any]
) -> Iterator[tuple[Any, ...]]:
    """Rows of what moved; of a number that moves nothing one row that says so."""
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch)
        for number in numbers:
            names = [name for name in base if reads(number, called[name])]
            about = number.label, f"{number.file}:{number.line}", str(number.value)[:60]
            still = True
            for factor, value in changed(number) if names else ():
                new = (
                    in_copy(number, value, names, copy)
                    if frozen(number)
                    else in_fork(
                        lambda number=number, value=value, names=names: _asked(number, value, names)
                    )
                )
                for name in names:
                    for one in moved(base[name], new.get(name, {"error": ["the process died"]})):
                        still = False
                        yield *about, factor, name, *one
            if still:
                yield *about, "", " ".join(names), "", 0.0, "nothing" if names else "not read"


def _asked(number: Number, value: Any, names: list[str]) -> dict[str, Any]:
    signal.signal(signal.SIGPROF, _too_long)
    change(number, value)
    return {name: answered(name) for name in names}


def answered(name: str) -> dict[str, Any]:
    """An answer, or what was raised instead, as when it takes too long."""
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        return ANSWERS[name]()
    except Exception as error:
        return {"error": [repr(error)[:80]]}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _too_long(*_: Any) -> None:
    raise TimeoutError(f"more than {PATIENCE:g} s")


def in_fork(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What `work` answers in a child of this process."""
    out, into = os.pipe()
    child = os.fork()
    if not child:
        with os.fdopen(into, "wb") as pipe:
            pipe.write(pickle.dumps(work()))
        os._exit(0)  # nothing of the parent is to be tidied up
    os.close(into)
    with os.fdopen(out, "rb") as pipe:
        answer = pipe.read()
    os.waitpid(child, 0)
    return dict(pickle.loads(answer)) if answer else {}


def in_copy(number: Number, value: Any, names: list[str], place: Path) -> dict[str, Any]:
    """Answers of a copy of the project with the number changed in its source."""
    if not (place / number.file).exists():
        copied(place)
    source = (place / number.file).read_text()
    (place / number.file).write_text(edited(source, number, value))
    # Numba notices changes of a kernel's own file alone.
    for module in holders(number):
        (place / Path(module.__file__ or "").relative_to(ROOT)).touch()
    kernels = {"NUMBA_CACHE_DIR": str(place / "kernels"), "PYTHONPATH": str(place)}
    command = [sys.executable, "-m", "tests.tools.knobs.answers", *names]
    how: dict[str, Any] = {"env": {**os.environ, **kernels}, "timeout": LONGEST}
    try:
        done = subprocess.run(command, cwd=place, capture_output=True, check=False, **how)
    except subprocess.TimeoutExpired:
        return {name: {"error": [f"more than {LONGEST:g} s"]} for name in names}
    finally:
        (place / number.file).write_text(source)
    if done.returncode:
        said = done.stderr.decode().strip().splitlines()[-1:] or ["died"]
        return {name: {"error": said} for name in names}
    return dict(pickle.loads(done.stdout))


def as_markdown(table: pd.DataFrame) -> str:
    """A line for each number and factor with the largest effect on each answer."""
    lines = ["| number | value | factor | answer | entry | change |", "|---|---|---|---|---|---|"]
    keys = ["number", "value", "factor", "answer"]
    for key, rows in table.groupby(keys, sort=False):
        largest = rows.loc[rows["size"].fillna(float("inf")).idxmax()]
        size = f" ({largest['size']:.2g})" if largest["size"] > 0 else ""
        cells = [*key, largest["entry"], f"{largest['effect']}{size}"]
        lines.append("| " + " | ".join(str(cell).replace("|", "/") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    cyclopts.run(main)
