"""How well the deployment of a folded tube with flat ends is determined that starts as a zigzag;
`demos.studies.engine.flat_tube` says what is varied."""

from __future__ import annotations

from demos.studies.engine.flat_tube import tube_study
from demos.studies.engine.spreads import Expected

STUDY = tube_study(
    "zigzag",
    {
        "halfway [ms]": Expected("determined", 10.0, 11.6),
        "arrived [ms]": Expected("determined", 21.0, 24.0),
        "tip speed [m/s]": Expected("not determined", 19.0, 30.0),
        "ring 1 [ms]": Expected("not determined", 4.5, 14.0),
        "mean of ring 1": Expected("not determined", 0.01, 0.1),
        "p2/p1 at 3 ms": Expected("not determined", 0.3, 0.62),
        "p1 at the end [Pa]": Expected("determined", 5550.0, 5900.0),
    },
)
