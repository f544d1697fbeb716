"""Fibre-reinforced layers by name, for booms and stiff films.

boom = Plate(mesh, GRAPHITE_EPOXY_HM.law(0.1e-3, direction=(1, 0, 0)))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.mechanics.materials.orthotropic import LinearOrthotropic, Orthotropic


@dataclass(frozen=True)
class Lamina:
    """A layer of parallel fibres in a matrix, whatever its thickness.

    Args:
        name: what it is made of.
        E1: Young's modulus along the fibres [Pa].
        E2: Young's modulus across them [Pa].
        nu12: ratio of the contraction across to the extension along the fibres.
        G12: shear modulus [Pa].
        density: of mass [kg/m³].
        source: where each figure is from.

    Example:
        >>> from gossamer_fx.presets.laminae import GRAPHITE_EPOXY_HM
        >>> GRAPHITE_EPOXY_HM.law(0.1e-3, direction=(1.0, 0.0, 0.0)).E1
        220000000000.0
    """

    name: str
    E1: float
    E2: float
    nu12: float
    G12: float
    density: float
    source: str

    @check_arguments
    def law(
        self,
        thickness: float,
        *,
        direction: Any,
        kind: type[LinearOrthotropic | Orthotropic] = LinearOrthotropic,
    ) -> LinearOrthotropic | Orthotropic:
        """The law of a layer of this material: its stress from its strain.

        Args:
            thickness: t [m].
            direction: of the fibres, see `LinearOrthotropic`.
            kind: `LinearOrthotropic`, or `Orthotropic`, which wrinkles.

        Raises:
            InputError: a thickness that is not positive, another `kind`, or what the law refuses.
        """
        return kind(
            self.E1,
            self.E2,
            self.nu12,
            self.G12,
            density=self.density,
            thickness=thickness,
            direction=direction,
        )


GRAPHITE_EPOXY_HM = Lamina(
    "high-modulus graphite/epoxy, 60 % of fibres by volume",
    E1=220e9,
    E2=6.9e9,
    nu12=0.25,
    G12=4.8e9,
    density=1640.0,
    source="C. Zweben (1989), typical properties of high-modulus graphite/epoxy unidirectional "
    "composites, V_f = 0.6, as table 3.10 of Strengthening Design of Reinforced Concrete with FRP "
    "reprints them; "
    "what-when-how.com/Tutorial/topic-646lhaam9/"
    "Strengthening-Design-of-Reinforced-Concrete-with-FRP-79.html",
)
