"""How well the deployment of a folded tube with flat ends is determined that starts as a zigzag.

One factor at a time is changed, see demos/common/flat_rooted_tube.py:

    cells      4, 6, 8 across the flat tube
    dt         first step [s]; the largest is twice as long
    nudge      relative change of the pressure of the tank, far below any accuracy
    damping    of the film: a loss factor, or a damping time
    contact    activation distance [m]
    residual_stiffness   compressive over tensile stiffness of the film
"""

from __future__ import annotations

from functools import partial

from demos.studies.engine.flat_tube import FACTORS, deploy
from demos.studies.engine.spreads import Expected, SpreadStudy

STUDY = SpreadStudy(
    "folded_zigzag",
    "What is determined of a folded tube with flat ends, from a zigzag",
    partial(deploy, start="zigzag"),
    vary=FACTORS,
    expected={
        "halfway [ms]": Expected("determined", 10.2, 11.5),
        "arrived [ms]": Expected("determined", 21.2, 23.6),
        "tip speed [m/s]": Expected("not determined", 19.0, 30.0),
        "ring 1 [ms]": Expected("not determined", 4.5, 14.0),
        "mean of ring 1": Expected("not determined", 0.01, 0.1),
        "p2/p1 at 3 ms": Expected("not determined", 0.3, 0.62),
        "p1 at the end [Pa]": Expected("determined", 5550.0, 5900.0),
    },
    chance=["nudge"],
    quick={"nudge": [0.0, 1e-9]},
    quick_options={"until": 0.01},
    limits={"energy_error": 1e-9, "penetrations": 0},
)
