"""The table of pairs as structures of the C functions."""

from __future__ import annotations

from typing import Any

from gossamer_fx.core.forms.c_source import CStruct
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.pair_table import PairTable


def pair_list_fields(pairs: PairTable) -> dict[str, Any]:
    """Return the fields of a `pair_list`, which other structures hold, too."""
    c = library()
    count = len(pairs)
    return {
        "count": count,
        "points": c.array("points", pairs.points, "int32", (count, 4)),
        "kind": c.array("kind", pairs.kind, "uint8", (count,)),
        "shape": c.array("shape", pairs.shape, "float64", (count,)),
    }


def pair_list(pairs: PairTable) -> CStruct:
    """Return what distances of pairs need as a `pair_list`."""
    return library().struct("pair_list", pair_list_fields(pairs))
