"""Continuous collision detection: whether pairs keep a least gap while their points move
straight."""

from __future__ import annotations

import numpy as np

from gossamer_fx.mechanics.contact.arrays import Array, MaskArray
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.pair_table import CandidatePairs, PairTable, pair_list
from gossamer_fx.mechanics.contact.stencils import is_boundary

# Positions on the way at which a distance is computed at most.  A sail that turns moves far while
# its layers stay near each other: with 100, every third step of such a sail was refused for
# nothing.
MAX_ADVANCES = 1000

# Part of its gap at the start, or of the activation distance if that is less, that a pair must keep
# in a step.  Layers that come nearer have all but passed through, and the next step would start
# inside.
KEPT_GAP = 0.1


def find_violations(
    candidates: CandidatePairs,
    x0: Array,
    x1: Array,
    *,
    gap: Array,
    activation_distance: Array,
    approach: Array,
    among: MaskArray,
) -> np.ndarray:
    """Return the contact pairs that do not keep a tenth of their gap from x0 to x1. `approach`: by
    how much pairs can come closer in the step (n,) [m]; `among`: mask (n,) of the pairs that are
    asked for. Returns indices (k,) of the pairs, ascending; empty if none loses its gap."""
    min_gap = KEPT_GAP * np.minimum(gap, activation_distance)
    can_come_near = approach > gap - min_gap
    rows = np.flatnonzero(can_come_near & ~is_boundary(candidates.kind) & among)
    collisions = find_collisions(
        candidates.geometry(rows),
        x0,
        x1,
        radius=candidates.radius[rows],
        gap=gap[rows],
        min_gap=min_gap[rows],
    )
    return rows[collisions]


def find_collisions(
    pairs: PairTable, x0: Array, x1: Array, radius: Array, gap: Array, min_gap: Array
) -> np.ndarray:
    """Return the contact pairs that come nearer than their least gap on the way, or may. Additive
    continuous collision detection: Li, Kaufman & Jiang, "Codimensional incremental potential
    contact", ACM Trans. Graph. 40 (2021) 170, section 4, doi:10.1145/3450626.3459767. `min_gap`: to
    be kept on the way (n,) [m]. Returns indices (k,) of the pairs; also of those for which
    `MAX_ADVANCES` evaluations could not decide."""
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    count = len(pairs)
    points = len(x0)
    motion = c.struct(
        "pair_motion",
        {
            "x0": c.array("x0", x0, "float64", (points, 3)),
            "x1": c.array("x1", x1, "float64", (points, 3)),
            "radius": c.array("radius", radius, "float64", (count,)),
            "gap": c.array("gap", gap, "float64", (count,)),
            "min_gap": c.array("min_gap", min_gap, "float64", (count,)),
            "max_advances": MAX_ADVANCES,
        },
    )
    keeps_gap = np.empty(count, dtype=np.uint8)
    c.lib.check_motion(
        pair_list(pairs).pointer,
        motion.pointer,
        c.array("keeps_gap", keeps_gap, "uint8", (count,), writable=True),
    )
    return np.flatnonzero(keeps_gap == 0)
