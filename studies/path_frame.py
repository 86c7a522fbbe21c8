"""A path as a pandas table."""

from __future__ import annotations

import pandas as pd

from stability import Path


def path_frame(path: Path) -> pd.DataFrame:
    """Every row of a path as a table; the events in `attrs["events"]`.

    Parameters
    ----------
    path : Path
        From `stability.follow`.

    Returns
    -------
    DataFrame
        The columns of `Path.columns`: strains `H11..H22`, stresses `P11..P22` (compression
        positive), forces `N_c, T_c` and regimes by contact, the tangent, determinants,
        eigenvalues, work and energy. `attrs` holds status, message, subspace, reference volume
        and the events, so that a row can be looked up by `event["index"]`.

    Examples
    --------
    >>> from loops import LinearFrictional
    >>> from patterns import diamond
    >>> from stability import Stage, follow, programmes
    >>> from studies.path_frame import path_frame
    >>> import numpy as np
    >>> stage = Stage(programmes.isotropic_strain(), "H11", 0.2)
    >>> frame = path_frame(follow(diamond(np.pi / 4), LinearFrictional(1.0, 0.2), [stage]))
    >>> float(frame["H11"].iloc[-1]), frame.attrs["status"]
    (0.2, 'finished')
    >>> [event["kind"] for event in frame.attrs["events"]]
    ['det_Ks_zero', 'det_K_zero']
    """
    frame = pd.DataFrame(path.columns())
    frame.attrs = {
        "status": path.status,
        "message": path.message,
        "subspace": path.subspace,
        "volume": float(path.volume),
        "events": [
            {
                "kind": event.kind,
                "parameter": float(event.parameter),
                "stage": int(event.stage),
                "index": int(event.index),
                "contacts": [int(contact) for contact in event.contacts],
                "detail": event.detail,
            }
            for event in path.events
        ],
    }
    return frame
