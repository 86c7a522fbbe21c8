"""What moved between two sets of answers by more than they state."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

# Share of the largest value that an answer without a stated error may move.
UNSTATED = 1e-6


class Moved(NamedTuple):
    """An entry that moved: its change over the largest value, nan for words; both in words."""

    entry: str
    size: float
    effect: str


def moved(base: dict[str, Any], new: dict[str, Any]) -> list[Moved]:
    """Entries that moved by more than the errors stated in both."""
    if "error" in new.keys() - base.keys():
        return [Moved("error", np.nan, str(new["error"][0]))]
    other = sorted(key for key in base.keys() ^ new.keys() if not key.endswith("~"))
    found = [Moved(key, np.nan, "appears" if key in new else "is gone") for key in other]
    for key in [key for key in base if key in new and not key.endswith("~")]:
        one, two = np.asarray(base[key]), np.asarray(new[key])
        if one.shape != two.shape:
            found.append(Moved(key, np.nan, f"{one.size} entries, then {two.size}"))
        elif one.dtype.kind not in "fiub" or two.dtype.kind not in "fiub":
            if (unlike := np.flatnonzero((one != two).ravel())).size:
                first = one.ravel()[unlike[0]], two.ravel()[unlike[0]]
                words = " -> ".join(str(word)[:60] for word in first)
                found.append(Moved(key, np.nan, f"{unlike.size} of {one.size}: {words}"))
        else:
            one, two = one.astype(float), two.astype(float)
            known = np.isfinite(one) & np.isfinite(two)
            if (np.isfinite(one) != np.isfinite(two)).any():
                gone = int(np.count_nonzero(np.isfinite(one) != np.isfinite(two)))
                found.append(Moved(key, np.nan, f"{gone} of {one.size} with a number in one alone"))
            if not known.any():
                continue
            largest = max(np.abs(one[known]).max(), 1e-300)
            stated = UNSTATED * largest + sum(_stated(each, key, one) for each in (base, new))
            beyond = (known & ~(np.abs(two - one) <= stated)).ravel()
            if beyond.any():
                off = np.where(beyond, np.abs(two - one).ravel(), 0.0)
                k = int(np.argmax(off))
                words = f"{one.ravel()[k]:.5g} -> {two.ravel()[k]:.5g}"
                effect = words if one.size == 1 else f"{beyond.sum()} of {one.size}: {words}"
                found.append(Moved(key, float(off[k] / largest), effect))
    return found


def _stated(answers: dict[str, Any], key: str, like: Any) -> Any:
    """Stated error of an entry, broadcast over the axes behind its own; 0 where none is stated."""
    error = np.nan_to_num(np.asarray(answers.get(f"{key}~", 0.0), dtype=float), posinf=np.inf)
    return np.broadcast_to(error.reshape(error.shape + (1,) * (like.ndim - error.ndim)), like.shape)
