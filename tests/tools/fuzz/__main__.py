"""Run the fuzzer: `python -m tests.tools.fuzz --out DIR [--inputs 10000]`."""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from cyclopts import Parameter
from rich.console import Console
from rich.progress import Progress

from tests.tools.fuzz.samples import Sample, write_samples
from tests.tools.fuzz.trial import try_one, warm_up

GOOD = ("snapshot", "clear error")
# Every so many inputs the whole study runs on the damaged file.
WHOLE = 10


def main(
    out: Annotated[Path, Parameter(help="Result folder.")],
    inputs: Annotated[int, Parameter(help="Damaged snapshots of each format.")] = 1000,
    seed: Annotated[int, Parameter(help="Seed of the first.")] = 0,
    only: Annotated[str | None, Parameter(help="One format.")] = None,
) -> None:
    """Damage samples of every format and read them: a snapshot, a clear error, or bad."""
    out.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as scratch:
        samples = [one for one in write_samples(Path(scratch)) if only in (None, one.name)]
        warm_up(samples)
        counts, bad = fuzz(samples, inputs, seed)
    summary = {"formats": counts, "inputs": inputs, "seed": seed, "only": only, "bad": bad}
    (out / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    for name, found in counts.items():
        print(f"{name:<10} {found}")
    for one in bad[:20]:
        print(f"{one['format']} seed {one['seed']}: {one['outcome']}\n{one['message']}")
    print(f"{inputs * len(samples)} inputs, {len(bad)} bad")
    if bad:
        raise SystemExit(1)


def fuzz(
    samples: list[Sample], inputs: int, seed: int
) -> tuple[dict[str, dict[str, int]], list[dict[str, Any]]]:
    """Try so many damaged versions of each sample."""
    counts: dict[str, dict[str, int]] = {}
    bad: list[dict[str, Any]] = []
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("inputs", total=inputs * len(samples))
        for sample in samples:
            outcomes: Counter[str] = Counter()
            for number in range(seed, seed + inputs):
                outcome, message = try_one(sample, number, whole=number % WHOLE == 0)
                outcomes[outcome] += 1
                if outcome not in GOOD:
                    found = {"outcome": outcome, "message": message}
                    bad.append({"format": sample.name, "seed": number, **found})
                bar.advance(task)
            counts[sample.name] = dict(sorted(outcomes.items()))
    return counts, bad


if __name__ == "__main__":
    cyclopts.run(main)
