"""Gases by name: calorically perfect near room temperature, and by NASA polynomials to 6000 K.

R is the molar gas constant 8.314462618 J/(mol K), exact since 2019 (CODATA 2018), over the molar
mass.  gamma is that of kinetic theory, 7/5 for two atoms and 5/3 for one; vibrations, which lower
it when a gas is hot, are left out.  Coefficients of polynomials, their
H(298.15 K) - H(0) [J/mol] and molar masses: McBride, Zehe and Gordon, NASA/TP-2002-211556.
"""

from __future__ import annotations

from gossamer_fx.mechanics.gas.ideal_gas import IdealGas, PolynomialGas

MOLAR = 8.314462618  # J/(mol K)

# Dry; molar mass: U.S. Standard Atmosphere (1976), table 3
AIR = IdealGas(gamma=1.4, R=MOLAR / 28.9644e-3, name="air")
# Molar masses of the next four: IUPAC standard atomic weights 2021, abridged
NITROGEN = IdealGas(gamma=1.4, R=MOLAR / 28.014e-3, name="nitrogen")
HELIUM = IdealGas(gamma=5 / 3, R=MOLAR / 4.0026e-3, name="helium")
ARGON = IdealGas(gamma=5 / 3, R=MOLAR / 39.95e-3, name="argon")
XENON = IdealGas(gamma=5 / 3, R=MOLAR / 131.29e-3, name="xenon")

# Ends of the ranges of the polynomials [K]
RANGES = (200.0, 1000.0, 6000.0)

HOT_NITROGEN = PolynomialGas(
    R=MOLAR / 28.0134e-3,
    temperatures=RANGES,
    coefficients=(
        (
            2.210371497e4,
            -3.818461820e2,
            6.082738360,
            -8.530914410e-3,
            1.384646189e-5,
            -9.625793620e-9,
            2.519705809e-12,
        ),
        (
            5.877124060e5,
            -2.239249073e3,
            6.066949220,
            -6.139685500e-4,
            1.491806679e-7,
            -1.923105485e-11,
            1.061954386e-15,
        ),
    ),
    enthalpy_298=8670.104 / 28.0134e-3,
    name="hot nitrogen",
)
CARBON_DIOXIDE = PolynomialGas(
    R=MOLAR / 44.0095e-3,
    temperatures=RANGES,
    coefficients=(
        (
            4.943650540e4,
            -6.264116010e2,
            5.301725240,
            2.503813816e-3,
            -2.127308728e-7,
            -7.689988780e-10,
            2.849677801e-13,
        ),
        (
            1.176962419e5,
            -1.788791477e3,
            8.291523190,
            -9.223156780e-5,
            4.863676880e-9,
            -1.891053312e-12,
            6.330036590e-16,
        ),
    ),
    enthalpy_298=9365.469 / 44.0095e-3,
    name="carbon dioxide",
)
