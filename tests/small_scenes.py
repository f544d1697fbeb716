"""The film and the gas of most small scenes."""

from __future__ import annotations

import gossamer_fx as gx

MATERIAL = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
WRINKLING = gx.Miyazaki(**MATERIAL)
LINEAR = gx.Linear(**MATERIAL)
AIR = gx.IdealGas(gamma=1.4, R=287.0)
