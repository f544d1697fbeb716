"""From where pictures are taken, and what is seen through, as users choose it."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check

LARGEST_ZOOM = 20.0


@check_arguments
@dataclass(frozen=True)
class View:
    """From where pictures and animations of a run are taken; what is None is chosen from the shapes.

    z is up.  Azimuth 0 looks along y, azimuth π/2 against x: the camera has gone round counterclockwise.

    Args:
        azimuth: [rad].
        elevation: [rad] above the horizon, between -π/2 and π/2.
        follow: whether the camera moves with the shapes; None: if they travel far.
        zoom: whether each picture is as large as its frame allows, and says by how much; else all have one scale.
        opacity: share of light that a layer keeps back, between 0 and 1: below 1 folded layers are seen through.

    Raises:
        InputError: an angle or an opacity out of its range.
    """

    azimuth: float | None = None
    elevation: float | None = None
    _: KW_ONLY
    follow: bool | None = None
    zoom: bool = False
    opacity: float = 1.0

    def __post_init__(self) -> None:
        check(
            self.azimuth is None or math.isfinite(self.azimuth),
            f"View: azimuth is {self.azimuth!r} rad; give a number, or None.",
        )
        check(
            self.elevation is None or abs(self.elevation) <= math.pi / 2,
            f"View: elevation is {self.elevation!r} rad; give a number between -π/2 and π/2, or None.",
        )
        check(
            isinstance(self.opacity, int | float) and 0 < self.opacity <= 1,
            f"View: opacity is {self.opacity!r}; give a number above 0 and at most 1.",
        )
