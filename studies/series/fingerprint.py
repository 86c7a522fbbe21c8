"""Whether a snapshot's results are still those of its files: a digest of what they depend on."""

from __future__ import annotations

import hashlib
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from studies.output import as_json, code_version, provenance
from studies.snapshot import SnapshotInput

# Files of one snapshot are named alike but for what they hold and for their endings.
CONTENTS = re.compile(
    "grains|atoms?|spheres|contacts?|local|pairs?|intrs?|cell|walls?|data|fstat", re.IGNORECASE
)
ENDINGS = re.compile(r"(\.(csv|parquet|npz|h5|hdf5|json|vtu|vtp|vtk|gz))+$", re.IGNORECASE)


def fingerprints(sources: Sequence[SnapshotInput]) -> list[str]:
    """Digest of every snapshot of a series.

    Parameters
    ----------
    sources : sequence of SnapshotInput
        The snapshots in order, their paths absolute.

    Returns
    -------
    list of str
        Of the place in the series, the code, how the snapshot is read, and of each of its files
        the name, the size and the time of the last change.
    """
    folders = {folder: _by_name(folder) for folder in {source.path.parent for source in sources}}
    return [
        _digest(number, source, folders[source.path.parent].get(_common(source.path), []))
        for number, source in enumerate(sources)
    ]


def _digest(number: int, source: SnapshotInput, files: list[Path]) -> str:
    how = asdict(source) | {"path": source.path.name}
    states = [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]
    made = provenance("series", {"number": number, "source": how, "files": states}, code_version())
    return hashlib.blake2b(as_json(made).encode(), digest_size=16).hexdigest()


def _by_name(folder: Path) -> dict[str, list[Path]]:
    """Files of a folder by what the names of one snapshot's files have in common."""
    found: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(folder.iterdir()):
        if path.is_file():
            found[_common(path)].append(path)
    return found


def _common(path: Path) -> str:
    return CONTENTS.sub("", ENDINGS.sub("", path.name))
