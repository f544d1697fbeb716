"""Polymer films by name: what their makers or measurements say, and the laws that follow.

    film = Membrane(mesh, KAPTON_HN.law(25e-6))

Moduli of such films differ by a tenth between directions and by a fifth between batches; measure
yours.

Their loss factor is for damping:

    gx.loads.flat_damping(film, loss_factor=KAPTON_HN.loss_factor, band=(1.0, 1e4))
    gx.Damping(film, loss_factor=KAPTON_HN.loss_factor, frequency=1e3)

Measured is that of ETFE alone.  For films of polyimide, PET and polyethylene at room temperature no
measurement was found: theirs is assumed, `ASSUMED_LOSS`, that of stiff polymers below their glass
transition; vary it within the range.
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
        loss_factor: η at room temperature, for damping; None: not known.
        loss_range: within which it was measured, or is assumed to lie.
        loss_source: where that is from.
    """

    name: str
    E: float
    nu: float
    density: float
    source: str
    yield_stress: float | None = None
    strength: float | None = None
    loss_factor: float | None = None
    loss_range: tuple[float, float] | None = None
    loss_source: str = ""

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


# Loss factor of films of which none was found, and its range, see the module.
ASSUMED_LOSS = 0.01
ASSUMED_RANGE = (0.003, 0.03)
ASSUMED_SOURCE = "assumed: no measurement of this film was found"

# Values of the makers; batches differ by more than the digits given here.
KAPTON_HN = FilmMaterial(
    "Kapton HN",
    E=2.5e9,
    nu=0.34,
    density=1420.0,
    yield_stress=69e6,
    strength=231e6,
    loss_factor=ASSUMED_LOSS,
    loss_range=ASSUMED_RANGE,
    loss_source=ASSUMED_SOURCE,
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
    loss_factor=ASSUMED_LOSS,
    loss_range=ASSUMED_RANGE,
    loss_source=ASSUMED_SOURCE,
    source="DuPont Teijin Films, Mylar: physical-thermal properties, H-37232-3, 23 µm (92 gauge): "
    "modulus 490 and 510 kgf/mm² along and across, here their mean; ultimate tensile strength 20 "
    "and 24 kgf/mm², here the smaller one; Poisson's ratio 0.38 before yield; density by ASTM D "
    "1505; "
    "studylib.net/doc/18223044",
)

# The loss factor follows from a compliance that was measured by creep and shifted in temperature:
# along the machine 0.024 to 0.027, across 0.017 to 0.024.
ETFE = FilmMaterial(
    "ETFE",
    E=1.23e9,
    nu=0.43,
    density=1750.0,
    loss_factor=0.022,
    loss_range=(0.017, 0.027),
    loss_source="A. Comitti & F. Bosi, Mechanics of Time-Dependent Materials (2024), "
    "doi:10.1007/s11043-024-09704-5: from their creep compliance at 20 °C, at 0.001 to 100 Hz, "
    "over which it is flat; the range is that of both directions and all frequencies",
    source="storage modulus at 1 Hz and 20 °C, 1.22 GPa along and 1.24 GPa across the machine, "
    "here their mean, and Poisson's ratio: A. Comitti & F. Bosi (2024), "
    "doi:10.1007/s11043-024-09704-5; density of makers' sheets, 1.70 to 1.78 g/cm³, "
    "etferoof.com/etfe-foil-general-properties",
)
