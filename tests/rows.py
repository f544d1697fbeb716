"""Laws of rows without a scene: what they return between given measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.rows import LawOfRows, RowLaw


@dataclass(frozen=True)
class Step:
    """Stresses S (n, m), dS/de1 (n, m, m), and (n,) of the other results of n rows."""

    S: Array
    dS: Array
    energy: Array
    loss: Array
    history: Array


def step_of(
    law: RowLaw,
    e0: Array,
    e1: Array,
    numbers: Mapping[str, Any],
    z0: Any = None,
    h: float = 1.0,
) -> Step:
    """The compiled law between measures e0 and e1 (n, m), with history variables z0 (n,)."""
    n, m = e0.shape
    sizes = {name: np.shape(v)[1] if np.ndim(v) == 2 else None for name, v in numbers.items()}
    compiled = LawOfRows(law, m, sizes, MPI.COMM_SELF, variables=0 if z0 is None else 1)
    columns = [np.full((n, 1), h)]
    for value in numbers.values():
        column = np.asarray(value, dtype=float)
        if column.ndim < 2:
            column = np.broadcast_to(column, n)[:, None]
        columns.append(np.broadcast_to(column, (n, column.shape[1])))
    start = [e0, e1]
    if z0 is not None:
        start.append(np.broadcast_to(z0, n)[:, None])
    outputs, slopes = compiled(np.hstack([*start, *columns]), slopes=True)
    return Step(
        S=outputs[:, :m],
        dS=slopes[:, :m],
        energy=outputs[:, compiled.energy],
        loss=outputs[:, compiled.loss],
        history=outputs[:, compiled.next_history],
    )
