"""How surfaces reflect, absorb and radiate sunlight."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated

from gossamer_fx.extend import Range, check, check_arguments

PRESSURE = 4.563e-6  # N/m² at 1 AU (1368 W/m²; McInnes 1999)

Share = Annotated[float, Range(0.0, 1.0)]


@check_arguments
@dataclass(frozen=True)
class Optics:
    """Optical properties of a surface, for the pressure of light.

    Light of pressure P comes along u, at an angle α to the normal n of the side away from it.  The
    force per area on the lit side is

        f/P = cos α {[2 r s cos α + B (1-s) r + (1-r) (ε B - ε' B')/(ε + ε')] n + (1 - r s) u}

    with ε', B' of the other side.  Absorbed light is radiated at once (C. R. McInnes, Solar
    Sailing, 1999, section 2.6, also for the coefficients `JPL_SAIL`).

    Args:
        reflectivity: r, fraction of the light that is reflected, 0 to 1.
        specular: s, fraction of the reflected light that is mirrored; the remainder is scattered.
        emissivity: ε.
        lambertian: B, 2/3 for an ideal scatterer.
        other_side: optics of the back; None: as the front.

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> sail = gx.orbit.Optics(0.88, 0.94, emissivity=0.05, lambertian=0.79)
        >>> sail.reflectivity
        0.88
    """

    reflectivity: Share = 1.0
    specular: Share = 1.0
    _: KW_ONLY
    emissivity: Share = 0.05
    lambertian: Share = 2 / 3
    other_side: Optics | None = None

    def __post_init__(self) -> None:
        back = self.other_side
        check(
            back is None or back.other_side is None,
            "Optics: the other side has another side; "
            "give the optics of the two sides of one film.",
        )
        check(
            self.emissivity + (back or self).emissivity > 0 or self.reflectivity == 1,
            "Optics: a surface that absorbs must radiate; give a positive emissivity.",
        )

    @property
    def sides(self) -> tuple[Optics, Optics]:
        """Front and back."""
        return self, self.other_side or self

    @check_arguments
    def coefficients(self, back: bool = False) -> tuple[float, float, float]:
        """Coefficients (2rs, B(1-s)r + (1-r)(εB - ε'B')/(ε + ε'), 1 - rs) of the force of light on
        a surface whose front, or back, is lit:

            f/P = cos α {[c_0 cos α + c_1] n + c_2 u}

        with ε', B' of the dark side, see the class.
        """
        lit, dark = self.sides[::-1] if back else self.sides
        r = lit.reflectivity
        s = lit.specular
        total_emissivity = lit.emissivity + dark.emissivity
        # The recoil of the heat that both sides radiate; it is the difference of the sides.
        radiated = lit.emissivity * lit.lambertian - dark.emissivity * dark.lambertian
        thermal = 0.0
        # Zero emissivity is allowed for a surface that absorbs nothing.
        if total_emissivity:
            thermal = (1 - r) * radiated / total_emissivity
        return 2 * r * s, lit.lambertian * (1 - s) * r + thermal, 1 - r * s


# The default of `SolarPressure` and `Surface`: an ideal mirror on both sides.
MIRROR = Optics()
# Aluminium on the front, chromium, which radiates more heat, on the back.
JPL_SAIL = Optics(
    0.88,
    0.94,
    emissivity=0.05,
    lambertian=0.79,
    other_side=Optics(0.88, 0.94, emissivity=0.55, lambertian=0.55),
)
