"""How well the deployment of a folded tube with flat ends is determined that starts as a roll.

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
    "folded_roll",
    "What is determined of a folded tube with flat ends, from a roll",
    partial(deploy, start="roll"),
    vary=FACTORS,
    expected={
        "halfway [ms]": Expected("determined", 15.2, 16.3),
        "arrived [ms]": Expected("determined", 23.1, 24.4),
        "tip speed [m/s]": Expected("statistical", 23.0, 29.0),
        "ring 1 [ms]": Expected("not determined", 2.4, 3.8),
        "mean of ring 1": Expected("not determined", 0.1, 0.23),
        "p2/p1 at 3 ms": Expected("determined", 0.91, 0.94),
        "p1 at the end [Pa]": Expected("determined", 5550.0, 5900.0),
    },
    chance=["nudge"],
    quick={"nudge": [0.0, 1e-9]},
    quick_options={"until": 0.01},
    limits={"energy_error": 1e-9, "penetrations": 0},
)
