"""The film, the gas and the run of most small scenes."""

from __future__ import annotations

from typing import Any

import gossamer_fx as gx

MATERIAL = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
WRINKLING = gx.Miyazaki(**MATERIAL)
LINEAR = gx.Linear(**MATERIAL)
AIR = gx.IdealGas(gamma=1.4, R=287.0)
DT = 1e-3  # s


def run_scene(*items: Any, until: float = DT, **options: Any) -> gx.Simulation:
    """Run a scene of these items in steps of a millisecond; options are those of Simulation."""
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=DT), **options)
    run.run(until=until)
    return run
