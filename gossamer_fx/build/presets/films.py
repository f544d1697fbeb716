"""Polymer films by name: what their makers or measurements say, and the laws that follow.

    film = Membrane(mesh, KAPTON_HN.law(25e-6))

Moduli of such films differ by a tenth between directions and by a fifth between batches; measure
yours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.mechanics.materials.film import IsotropicFilm, Miyazaki


@dataclass(frozen=True)
class FilmMaterial:
    """What a film is made of, whatever its thickness.

    Args:
        name: as it is sold.
        E: Young's modulus [Pa].
        nu: Poisson's ratio.
        density: of mass [kg/m³].
        source: where each figure is from.
        yield_stress: stress at 3 % strain [Pa]; None: not known.
        strength: stress at break in a test at constant speed [Pa]; None: not known.  Both are
            limits for `gx.analysis.largest_stress`; neither is what a film bears for years.
    """

    name: str
    E: float
    nu: float
    density: float
    source: str
    yield_stress: float | None = None
    strength: float | None = None

    @check_arguments
    def law(
        self, thickness: float, kind: type[IsotropicFilm] = Miyazaki, **numbers: Any
    ) -> IsotropicFilm:
        """The law of a film of this material: its stress from its strain.

        Args:
            thickness: t [m].
            kind: class of the law: `Miyazaki`, `TensionField`, `Linear` or `Elastica`.
            numbers: further arguments of the law, e.g. `residual_stiffness=1e-4`.

        Raises:
            InputError: a thickness that is not positive, `kind` is not such a class, or what the
                law refuses.
        """
        return kind(E=self.E, nu=self.nu, density=self.density, thickness=thickness, **numbers)


# Values of the makers; batches differ by more than the digits given here.
KAPTON_HN = FilmMaterial(
    "Kapton HN",
    E=2.5e9,
    nu=0.34,
    density=1420.0,
    yield_stress=69e6,
    strength=231e6,
    source="DuPont, Kapton HN 25 µm at 23 °C: tensile modulus, stress at 3 %, ultimate tensile "
    "strength, Poisson's ratio and density; the sheet as kept at "
    "mu2e.phy.duke.edu/cw/misc/0404_kapton_properties.cfm.htm and studylib.net/doc/18360701",
)

MYLAR = FilmMaterial(
    "Mylar",
    E=4.9e9,
    nu=0.38,
    density=1390.0,
    strength=196e6,
    source="DuPont Teijin Films, Mylar: physical-thermal properties, H-37232-3, 23 µm (92 gauge): "
    "modulus 490 and 510 kgf/mm² along and across, here their mean; ultimate tensile strength 20 "
    "and 24 kgf/mm², here the smaller one; Poisson's ratio 0.38 before yield; density by ASTM D "
    "1505; "
    "studylib.net/doc/18223044",
)
