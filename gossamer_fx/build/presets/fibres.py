"""Fibres of cables, tendons and sewing yarns by name: what their makers say, and the laws that
follow.

    tendon = Cable(mesh, VECTRAN_HT.law(linear_density=330e-6))

A rope or a braid of a fibre is less stiff than the fibre itself, by a tenth to a half: the yarns
are not straight. Measure yours, and give `TabulatedCable` what you measure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.mechanics.bodies.cable import CableLaw

# Pa in a modulus of one cN/dtex, the makers' unit, of a fibre of one g/cm³.
_PA_PER_CN_DTEX = 1e8


@dataclass(frozen=True)
class Fibre:
    """What a cable is made of, whatever its size.

    Args:
        name: as it is sold.
        E: tensile modulus along the fibre [Pa].
        density: of mass [kg/m³].
        source: where each figure is from.

    Example:
        >>> from gossamer_fx.presets.fibres import VECTRAN_HT
        >>> law = VECTRAN_HT.law(linear_density=1e-3)
        >>> f"{law.EA / 1e3:.1f} kN"
        '52.9 kN'
    """

    name: str
    E: float
    density: float
    source: str

    @check_arguments
    def law(self, *, linear_density: Annotated[float, positive("kg/m")]) -> CableLaw:
        """The law of a cable of straight fibres.

        EA = (E/ρ) μ, so that the gaps between the fibres do not matter.

        Args:
            linear_density: mass per length μ [kg/m]; 1 dtex = 1e-7 kg/m.

        Raises:
            InputError: a linear density that is not positive.
        """
        return CableLaw(EA=self.E / self.density * linear_density, line_density=linear_density)


def _fibre(name: str, cn_per_dtex: float, grams_per_cm3: float, source: str) -> Fibre:
    """A fibre in SI units, from a tensile modulus in the makers' unit cN/dtex and a density in
    g/cm³."""
    return Fibre(
        name,
        E=cn_per_dtex * grams_per_cm3 * _PA_PER_CN_DTEX,
        density=1e3 * grams_per_cm3,
        source=source,
    )


_TEIJIN = (
    "Teijin, Technora: tensile properties of industrial fibres, table 3, density and modulus in "
    "cN/dtex; teijin.com/products/advanced_fibers/aramid/contents/aramid/technora/eng/bussei/"
    "tech_bussei_hippari.htm"
)
_TOYOBO = (
    "Toyobo, Zylon: density by Technical Information (2005), yumpu.com/en/document/view/27944419; "
    "modulus in cN/dtex by directindustry.com/prod/imattec/product-4567250-2558012.html"
)

VECTRAN_HT = _fibre("Vectran HT (polyarylate)", 529.0, 1.41, _TEIJIN)
POLYESTER = _fibre("polyester, the fibre of Dacron", 90.0, 1.38, _TEIJIN)
TECHNORA = _fibre("Technora (aramid)", 530.0, 1.39, _TEIJIN)
ARAMID_HM = _fibre("PPTA of high modulus (aramid)", 720.0, 1.45, _TEIJIN)
PBO_AS = _fibre("Zylon AS (PBO)", 1150.0, 1.54, _TOYOBO)
PBO_HM = _fibre("Zylon HM (PBO)", 1720.0, 1.56, _TOYOBO)
