"""How well the deployment of a folded tube with flat ends is determined that starts as a roll;
`demos.studies.engine.flat_tube` says what is varied."""

from __future__ import annotations

from demos.studies.engine.flat_tube import tube_study
from demos.studies.engine.spreads import Expected

STUDY = tube_study(
    "roll",
    {
        "halfway [ms]": Expected("determined", 15.2, 16.3),
        "arrived [ms]": Expected("determined", 23.1, 24.4),
        "tip speed [m/s]": Expected("not determined", 22.0, 31.0),
        "ring 1 [ms]": Expected("not determined", 2.3, 3.8),
        "mean of ring 1": Expected("not determined", 0.1, 0.23),
        "p2/p1 at 3 ms": Expected("determined", 0.91, 0.94),
        "p1 at the end [Pa]": Expected("determined", 5550.0, 5900.0),
    },
)
