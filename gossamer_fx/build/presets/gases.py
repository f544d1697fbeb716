"""Gases by name, as calorically perfect ideal gases near room temperature.

R is the molar gas constant 8.314462618 J/(mol K), exact since 2019 (CODATA 2018), over the molar
mass.  gamma is that of kinetic theory, 7/5 for two atoms and 5/3 for one; vibrations, which lower
it when a gas is hot, are left out.
"""

from __future__ import annotations

from gossamer_fx.mechanics.gas.ideal_gas import IdealGas

MOLAR = 8.314462618  # J/(mol K)

AIR = IdealGas(
    gamma=1.4, R=MOLAR / 28.9644e-3, name="air"
)  # dry; molar mass: U.S. Standard Atmosphere (1976), table 3
NITROGEN = IdealGas(
    gamma=1.4, R=MOLAR / 28.014e-3, name="nitrogen"
)  # molar masses below: IUPAC standard atomic weights 2021, abridged
HELIUM = IdealGas(gamma=5 / 3, R=MOLAR / 4.0026e-3, name="helium")
ARGON = IdealGas(gamma=5 / 3, R=MOLAR / 39.95e-3, name="argon")
XENON = IdealGas(gamma=5 / 3, R=MOLAR / 131.29e-3, name="xenon")
