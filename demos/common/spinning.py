"""Parts of the sails that spin: probes and figures of hub and tips, wound cables, and disturbances:
a hub that is tilted or off its axis, and a part that sticks for a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import gossamer_fx as gx
from demos.common.deployment import dissipation, run_figures
from demos.common.figures import BLUE, RED, finish
from gossamer_fx.extend import Array, Probe, relative_drift

RPM = 2 * math.pi / 60
# In rad/s.
SPIN_UNITS = {"rad/s": 1.0, "rpm": RPM}

# Speed [m/s] at which the tether of a part that stuck is paid out: far above that of any part, so
# that it is slack at once.
RELEASE_SPEED = 100.0

# Points of a ring of film, whose heights are recorded.
RING_POINTS = 24

# Length of that tether over the first distance of its ends: it holds at once.
TETHER_LENGTH = 1.0


@dataclass(frozen=True)
class Disturbance:
    """What is not perfect at the start of a spin deployment.

    Attributes:
        tilt: angle between the spin and the axis of the hub, 0 to less than 90 [deg].
        offset: of the hub's centre of mass from the axis of the roll, along x [m].
        stuck: time for which one part is held on the roll [s]; 0: none.
    """

    tilt: float = 0.0
    offset: float = 0.0
    stuck: float = 0.0

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


def momentum_probes(hub: gx.RigidBody) -> dict[str, Probe]:
    """Components in space of the angular momentum of the scene about its centre of mass, and of the
    part that the hub has about its own [kg m²/s]."""
    directors = hub.frame().directors

    def of_hub(k: int) -> Probe:
        def component(run: Any) -> float:
            d = run.system.unknowns.state.vectors(directors)
            rates = run.system.unknowns.state.rates(directors)
            # Σ E_ij d_i × d_j' with Euler's tensor E
            return float(np.cross(d, hub.euler_tensor @ rates).sum(axis=0)[k])

        return component

    found: dict[str, Probe] = {}
    for k, axis in enumerate("xyz"):
        found[f"angular momentum {axis} [kg m²/s]"] = gx.probes.AngularMomentum(axis)
        found[f"angular momentum of the hub {axis} [kg m²/s]"] = of_hub(k)
    return found


def plot_momentum(panels: Any, series: gx.Series) -> None:
    """Components of the angular momentum over the time in three axes: of all, of the hub about its
    centre, and of the rest."""
    for axes, axis in zip(panels, "xyz", strict=True):
        whole = series[f"angular momentum {axis} [kg m²/s]"]
        hub = series[f"angular momentum of the hub {axis} [kg m²/s]"]
        axes.plot(series.time, whole, color="black", label="all")
        axes.plot(series.time, hub, color=BLUE, label="hub")
        axes.plot(series.time, whole - hub, color=RED, label="sail")
        finish(axes, "t [s]", f"angular momentum about {axis} [kg m²/s]")


def ring_heights(film: gx.Membrane, radius: float) -> dict[str, Probe]:
    """Probes of the heights of `RING_POINTS` points of a film around z, at a radius [m] in the
    mesh."""
    found: dict[str, Probe] = {}
    for k in range(RING_POINTS):
        angle = 2 * math.pi * k / RING_POINTS
        point = film.port_at((radius * math.cos(angle), radius * math.sin(angle), 0.0))
        found[f"height {k} [m]"] = gx.probes.Position(point, "z")
    return found


def heights_of_ring(series: gx.Series) -> Array:
    """Heights (RING_POINTS, n) [m] in the run of a case with `ring_heights`."""
    return np.array([series[f"height {k} [m]"] for k in range(RING_POINTS)])


def spins(hub: gx.RigidBody, film: gx.Membrane | None) -> dict[str, Probe]:
    """Spins of hub and film about z [rad/s]."""
    found: dict[str, Probe] = {"hub": gx.probes.AngularVelocity(hub.frame(), "z")}
    if film is not None:
        found["sail"] = gx.probes.MeanSpin(film, "z")
    return found


def spin_probes(
    hub: gx.RigidBody, film: gx.Membrane | None, tips: Sequence[gx.Port], unit: str = "rad/s"
) -> dict[str, Probe]:
    """Spins of hub and film in a unit of `SPIN_UNITS`, and the tips' distances from the axis
    through the origin."""
    axis = hub.frame_at((0.0, 0.0, 0.0))
    return {
        **{
            f"spin of the {name} [{unit}]": in_unit(spin, unit)
            for name, spin in spins(hub, film).items()
        },
        **{
            f"radius {k} [m]": gx.probes.PolarPosition(port, axis, quantity="radius")
            for k, port in enumerate(tips)
        },
    }


def in_unit(spin: Probe, unit: str) -> Probe:
    """A probe of a spin [rad/s] in a unit of `SPIN_UNITS`."""
    return lambda run: spin(run) / SPIN_UNITS[unit]


def radii_of_tips(series: gx.Series) -> Array:
    """Distances (tips, n) [m] of the tips from the axis, of a case with `spin_probes`."""
    return np.array([series[name] for name in series.probes if name.startswith("radius")])


def spin_figures(run: gx.Simulation, series: gx.Series) -> dict[str, float]:
    """Figures of the run of a case with `spin_probes`.

    Returns:
        those of `run_figures` and `dissipation`; angular_momentum_drift (relative), which counts
        for a free hub only; spin_of_hub, spin_of_sail: at the end, in the unit of the probes;
        radius, smallest_radius: mean and smallest distance of the tips from the axis at the end
        [m]; largest_radius: of the mean in the run [m]; energy: at the start [J]; with
        `attitude_probes` also nutation_at_start and nutation [deg], and imbalance of the tips, at
        the end.
    """
    radii = radii_of_tips(series)
    found = {
        **run_figures(run, series),
        "angular_momentum_drift": relative_drift(
            run.totals.angular_momentum, run.first.angular_momentum
        ),
        "radius": float(radii.mean(axis=0)[-1]),
        "smallest_radius": float(radii[:, -1].min()),
        "largest_radius": float(radii.mean(axis=0).max()),
        "energy": run.first.energy,
        **dissipation(run),
    }
    for name in series.probes:
        if name.startswith("spin of the"):
            found[f"spin_of_{name.split()[3]}"] = float(series[name][-1])
    if "nutation [deg]" in series.probes:
        found["nutation_at_start"] = float(series["nutation [deg]"][0])
        found["nutation"] = float(series["nutation [deg]"][-1])
        found["imbalance"] = float(series["imbalance of the tips"][-1])
    return found


def plot_spins(axes: Any, x: Array, series: gx.Series, unit: str, upto: float = math.inf) -> None:
    """Curves of the spins of hub and sail over x (n,), until a time [s]."""
    shown = series.time <= upto
    for what, colour in (("hub", BLUE), ("sail", RED)):
        spin = series[f"spin of the {what} [{unit}]"]
        axes.plot(x[shown], spin[shown], color=colour, label=what)


def drum(hub: gx.RigidBody, radius: float, low: float, high: float) -> gx.contact.Cylinder:
    """The surface of a hub, from one height to another along its axis [m]."""
    return gx.contact.Cylinder(
        start=(0.0, 0.0, low), end=(0.0, 0.0, high), radius=radius, body=hub, name="drum"
    )


def turned(points: Array, angle: float) -> Array:
    """Points (n, 2) turned about the origin by an angle [rad]."""
    c = math.cos(angle)
    s = math.sin(angle)
    return points @ np.array([[c, -s], [s, c]]).T


def laid_along(corners: Array, stations: Array) -> Callable[[Array], Array]:
    """Displacement of a straight cable along x to a polygon in the plane z = 0.

    Args:
        corners: of the polygon (n, 2) [m].
        stations: distances (n,) [m] of its corners along the cable.
    """

    def displacement(X: Array) -> Array:
        x = np.interp(X[0], stations, corners[:, 0])
        y = np.interp(X[0], stations, corners[:, 1])
        return np.vstack([x, y, 0 * x]) - X

    return displacement
