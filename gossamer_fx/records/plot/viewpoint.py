"""The choices of a user for a picture: camera and transparency."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check

# Largest enlargement of one picture relative to the others: a small body must not fill the page.
LARGEST_ZOOM = 20.0


@check_arguments
@dataclass(frozen=True)
class View:
    """Camera and transparency of pictures and animations; values that are None are chosen from the
    shapes.

    z is up.  With azimuth 0 the camera looks along y, with π/2 against x: it has moved
    counterclockwise.

    Args:
        azimuth: [rad].
        elevation: [rad] above the horizon, between -π/2 and π/2.
        follow: whether the camera moves with the shapes; None: if they travel far.
        zoom: whether each picture is as large as its frame allows, with a note of its enlargement;
            otherwise all have one scale.
        opacity: share of light that a layer absorbs, above 0, at most 1; below 1, folded layers are
            visible.

    Raises:
        InputError: an angle or an opacity out of its range.

    Example:
        >>> view = gx.plot.View(azimuth=0.5, elevation=0.3, opacity=0.6)
        >>> gx.plot.strip(recorded, "displacement", path=folder / "view.png", view=view)
    """

    azimuth: float | None = None
    elevation: float | None = None
    _: KW_ONLY
    follow: bool | None = None
    zoom: bool = False
    opacity: float = 1.0

    def __post_init__(self) -> None:
        """Refuse angles and an opacity out of their range.

        Raises:
            InputError: azimuth is not finite, |elevation| > π/2 [rad], or opacity is not in (0, 1].
        """
        check(
            self.azimuth is None or math.isfinite(self.azimuth),
            f"View: azimuth is {self.azimuth!r} rad; give a number, or None.",
        )
        check(
            self.elevation is None or abs(self.elevation) <= math.pi / 2,
            f"View: elevation is {self.elevation!r} rad; give a number between -π/2 and π/2, or "
            "None.",
        )
        check(
            isinstance(self.opacity, int | float) and 0 < self.opacity <= 1,
            f"View: opacity is {self.opacity!r}; give a number above 0 and at most 1.",
        )
