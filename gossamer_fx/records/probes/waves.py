"""Probes of points that are spread evenly around an axis: waves that run around a sail, and its
imbalance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.mechanics.bodies.frames import Frame
from gossamer_fx.solve.view import StateView

# Quantities and parts of `Waves`
QUANTITIES = ("height", "radius")
PARTS = ("cosine", "sine")


@check_arguments
class Waves:
    """Fourier coefficient [m] of the heights or radii of points around the third axis of a frame.

    With the values w_k of N points, numbered around the axis in the sense of positive rotation from
    the first one, and n waves around the axis,

        a_n = 2/N Σ w_k cos(2π n k/N),    b_n = 2/N Σ w_k sin(2π n k/N)

    with 1/N in place of 2/N for n = 0 and n = N/2.  A wave A cos(n θ - ω t) that runs forward, in
    the sense of positive rotation, has a_n = A cos ω t and b_n = A sin ω t; see
    `gx.analysis.travelling_waves`.  The points move with their bodies: ω is the frequency that is
    seen from a sail that spins.

    Args:
        ports: points of bodies, at even angles around the axis and in their order; at least 3.
        frame: with three directors, e.g. of the hub.
        number: n, the waves around the axis, 0 to N/2.
        part: "cosine" for a_n or "sine" for b_n.
        quantity: "height" along the third axis of the frame, from its origin, or "radius" from this
            axis.

    Raises:
        InputError: fewer than 3 points, more waves than these can show, an unknown part or
            quantity, or a frame with two directors only.

    Example:
        >>> corners = ("bottom left", "bottom right", "top right", "top left")
        >>> tips = [film.port(corner) for corner in corners]
        >>> saddle = gx.probes.Waves(tips, gx.ground_frame(), number=2)
    """

    unit = "m"

    def __init__(
        self,
        ports: Sequence[Port],
        frame: Frame,
        *,
        number: int,
        part: str = "cosine",
        quantity: str = "height",
    ) -> None:
        count = len(ports)
        check(count >= 3, f"Waves: {count} points do not show waves; give at least 3.")
        check(
            0 <= number <= count // 2,
            f"Waves: {count} points cannot show {number} waves; give 0 to {count // 2}, or more "
            "points.",
        )
        check(part in PARTS, f"Waves: there is no part {part!r}; choose from {', '.join(PARTS)}.")
        check(
            quantity in QUANTITIES,
            f"Waves: there is no quantity {quantity!r}; choose from {', '.join(QUANTITIES)}.",
        )
        check(
            len(frame.directors) == 3,
            "Waves: the frame has no third axis; give one with three directors.",
        )
        self.ports = tuple(ports)
        self.frame = frame
        self.quantity = quantity
        phase = 2 * np.pi * number * np.arange(count) / count
        pattern = np.cos(phase) if part == "cosine" else np.sin(phase)
        # The mean square of a cosine is 1/2, but 1 where it is a constant or alternates.
        is_extreme = 2 * number in (0, count)
        self._weights = pattern * (1 if is_extreme else 2) / count

    def __call__(self, run: StateView) -> float:
        """The coefficient [m] in the state of a run."""
        heights, radii = cylindrical(run, self.ports, self.frame)
        values = heights if self.quantity == "height" else radii
        return float(self._weights @ values)


@check_arguments
class Imbalance:
    """Largest less smallest radius of some points about the third axis of a frame, over their mean.

    Args:
        ports: points of bodies, e.g. the tips of the arms of a sail; at least 2.
        frame: with three directors, e.g. of the hub.

    Raises:
        InputError: fewer than 2 points, or a frame with two directors only.

    Example:
        >>> tips = [film.port("bottom left"), film.port("top right")]
        >>> imbalance = gx.probes.Imbalance(tips, gx.ground_frame())
    """

    unit = "1"

    def __init__(self, ports: Sequence[Port], frame: Frame) -> None:
        check(len(ports) >= 2, f"Imbalance: {len(ports)} points have none; give at least 2.")
        check(
            len(frame.directors) == 3,
            "Imbalance: the frame has no third axis; give one with three directors.",
        )
        self.ports = tuple(ports)
        self.frame = frame

    def __call__(self, run: StateView) -> float:
        """The imbalance in the state of a run; 0 where all points are on the axis."""
        _, radii = cylindrical(run, self.ports, self.frame)
        mean = radii.mean()
        if mean == 0:
            return 0.0
        return float((radii.max() - radii.min()) / mean)


def cylindrical(run: StateView, ports: Sequence[Port], frame: Frame) -> tuple[Array, Array]:
    """Heights and radii (n,) [m] of points in a frame, on every rank.  Collective."""
    vectors = run.system.state.vectors([*ports, frame.origin, *frame.directors])
    points = np.array(vectors[: len(ports)])
    origin, *axes = vectors[len(ports) :]
    components = (points - origin) @ np.array(axes).T
    return components[:, 2], np.hypot(components[:, 0], components[:, 1])
