"""From where pictures are taken, as users choose it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gossamer_fx.checks.errors import check

LARGEST_ZOOM = 20.0


@dataclass(frozen=True)
class View:
    """From where pictures and animations of a run are taken; what is None is chosen from the shapes.

    z is up.  Azimuth 0 looks along y, azimuth π/2 against x: the camera has gone round counterclockwise.

    Args:
        azimuth: [rad].
        elevation: [rad] above the horizon, between -π/2 and π/2.
        follow: whether the camera moves with the shapes; None: if they travel far.
        zoom: whether each picture is as large as its frame allows, and says by how much; else all have one scale.

    Raises:
        InputError: an angle out of its range.
    """

    azimuth: float | None = None
    elevation: float | None = None
    follow: bool | None = None
    zoom: bool = False

    def __post_init__(self) -> None:
        check(
            self.azimuth is None or math.isfinite(self.azimuth),
            f"View: azimuth is {self.azimuth!r} rad; give a number, or None.",
        )
        check(
            self.elevation is None or abs(self.elevation) <= math.pi / 2,
            f"View: elevation is {self.elevation!r} rad; give a number between -π/2 and π/2, or None.",
        )
