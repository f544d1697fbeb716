"""Disturbances of a spin deployment: a hub that is tilted or off its axis, and a part that sticks
for a time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import gossamer_fx as gx
from gossamer_fx.core.checks.errors import check
from gossamer_fx.records.outputs.output import Probe

# Speed [m/s] at which the tether of a part that stuck is paid out: far above that of any part, so
# that it is slack at once.
RELEASE_SPEED = 100.0

# Length of that tether over the first distance of its ends: it holds at once.
TETHER_LENGTH = 1.0


@dataclass(frozen=True)
class Disturbance:
    """What is not perfect at the start of a spin deployment.

    Attributes:
        tilt: angle between the spin and the axis of the hub [deg].
        offset: of the hub's centre of mass from the axis of the roll, along x [m].
        stuck: time for which one part is held on the roll [s].
    """

    tilt: float = 0.0
    offset: float = 0.0
    stuck: float = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers out of their ranges.

        Raises:
            InputError: an angle of 90 degrees or more, or a negative time.
        """
        check(
            0 <= self.tilt < 90,
            f"tilt is {self.tilt!r} degrees; give 0 to less than 90.",
        )
        check(
            math.isfinite(self.stuck) and self.stuck >= 0,
            f"stuck is {self.stuck!r} s; give 0 or a longer time.",
        )

    def spin(self, rate: float) -> tuple[float, float, float]:
        """Spin (3,) [rad/s] of hub and roll at the start, in the plane of x and the axis z."""
        tilt = math.radians(self.tilt)
        return rate * math.sin(tilt), 0.0, rate * math.cos(tilt)

    def hub_position(self) -> tuple[float, float, float]:
        """Centre of mass of the hub [m]."""
        return self.offset, 0.0, 0.0

    def holding_tethers(
        self, hub: gx.RigidBody, port: gx.Port, place: np.ndarray, stiffness: float
    ) -> list[gx.connectors.Tether]:
        """The tether that holds a part of the film on the roll, if one sticks.

        Args:
            hub: the body that holds it.
            port: a point of the film.
            place: where the point is on the roll [m].
            stiffness: of the tether [N/m].
        """
        if self.stuck == 0:
            return []
        # From the axis, so that the tether does not pull along the roll.
        reel = (0.0, 0.0, float(place[2]))
        length = TETHER_LENGTH * math.hypot(float(place[0]), float(place[1]))

        def paid_out(t: float) -> float:
            return length + RELEASE_SPEED * max(t - self.stuck, 0.0)

        tether = gx.connectors.Tether(
            hub.port_at(reel), port, stiffness=stiffness, length=paid_out, name="stuck"
        )
        return [tether]


def attitude_probes(hub: gx.RigidBody, tips: list[gx.Port]) -> dict[str, Probe]:
    """Nutation, angular momentum across the axis of the hub, imbalance of the tips, and the wave of
    their heights.

    Args:
        hub: its third axis is the axis of the roll.
        tips: at even angles around the axis, in their order.
    """
    frame = hub.frame_at((0.0, 0.0, 0.0))
    nutation = gx.probes.Nutation(frame)
    probes: dict[str, Probe] = {
        "nutation [deg]": lambda run: math.degrees(nutation(run)),
        "imbalance of the tips": gx.probes.Imbalance(tips, frame),
    }
    for axis in "xy":
        probes[f"angular momentum across the hub {axis} [kg m²/s]"] = gx.probes.AngularMomentum(
            axis, frame=frame
        )
    for part in ("cosine", "sine"):
        probes[f"wave of heights {part} [m]"] = gx.probes.Waves(tips, frame, number=1, part=part)
    return probes
