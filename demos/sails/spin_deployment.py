"""A disc of film, folded round a hub, is deployed by its spin.

The film is pleated and wound round a polygonal hub (skew fold), its inner edge fixed to it; masses
sit at its tips. Hub and roll spin together; at t = 0 the roll is released.  Free particles would
move along tangents.  Layers collide with each other and with the hub, waves run through the film,
and angular momentum passes from the hub to the sail, unless a motor keeps the rate constant.
Layers and hub are in contact; with `crease` the folds have a rest angle, and with `yield_angle`
they are plastic.

Where the values come from:
    diameter 1, 2 m      the spinning films with rigid parts of Miyazaki, KAKENHI 19360384 final
                         report (2009), §4(4); their masses, films and spin rates were not published
    film                 polyimide, Kapton HN (DuPont data sheet H-38492), here of 7.5 µm
    hub, tips, spin      chosen: hub of 0.1 kg and a tenth of the diameter, 8 revolutions a second,
                         tips of 2 g
    damping              chosen: 0.1 ms, viscosity of the film over its stiffness; what depends on
                         it, `./gossamer study disc` says

    ./gossamer demo spin_deployment
    ./gossamer run demos/sails/spin_deployment.py diameter=2.0 rev=4.0 until=0.5 --output out/spin
    ./gossamer report out/spin
    ./gossamer run demos/sails/spin_deployment.py held=True crease=5e-4
    ./gossamer run demos/sails/spin_deployment.py crease=3e-3 set_angle_ratio=1.0 yield_angle=0.35
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import (
    UNITS,
    crease_figures,
    deployment_case,
    first_time,
    fold_angles,
    print_figures,
    run_case,
)
from demos.common.figures import finish, new_figure, save
from demos.common.spinning import (
    Disturbance,
    attitude_probes,
    drum,
    plot_spins,
    radii_of_tips,
    ring_heights,
    spin_figures,
    spin_probes,
)
from gossamer_fx.meshes.sails import pinwheel
from gossamer_fx.presets.films import KAPTON_HN

TITLE = "A disc of film, deployed by its spin"
VIEW = gx.plot.View(azimuth=0.3, elevation=math.radians(35), zoom=True)
HUB = 0.1  # diameter of the hub over that of the disc
HOLD = 1e3  # stiffness of what holds a tip that sticks [N/m]
OPEN = 0.75  # mean radius of the tips of a disc that counts as open, over its own
BAND = (1.0, 1e5)  # frequencies within which a loss factor of the film is constant [Hz]
CLEAR = 2.0  # distance of the hub from the film on it, over the activation distance


def pattern(diameter: float, n: int) -> tuple[float, int]:
    """Side of the hub's polygon [m], and the number of sides to the end of a sector: tips are at
    diameter/2."""
    slope = math.tan(math.pi / n)

    def tip(count: int) -> float:
        """Radius of the tips over a side."""
        return math.hypot(0.5 + count, count * slope - 0.5 / slope)

    side = HUB * diameter * math.sin(math.pi / n)
    # The number of sides whose tips are nearest to the wanted radius; the side is then adapted to
    # the radius.
    count = min(range(2, 60), key=lambda k: abs(side * tip(k) - diameter / 2))
    return diameter / 2 / tip(count), count


def build(
    comm: MPI.Comm,
    diameter: float = 1.0,
    n: int = 6,
    cells: int = 1,
    rev: float = 8.0,
    held: bool = False,
    thickness: float = 7.5e-6,
    tip: float = 2e-3,
    inertia: float = 1.25e-4,
    slenderness: float = 0.8,
    tilt: float = 0.0,
    offset: float = 0.0,
    stuck: float = 0.0,
    contact: float = 4e-4,
    contact_stiffness: float | None = None,
    gap: float = 5e-4,
    friction: float = 0.0,
    crease: float = 0.0,
    set_angle_ratio: float = 0.5,
    yield_angle: float = 0.0,
    damping: float = 1e-4,
    loss_factor: float = 0.0,
    residual_stiffness: float = 1e-6,
    gravity: float = 0.0,
    air: float = 0.0,
    sense: int = 1,
    ring: float = 0.0,
    until: float = 0.24,
    dt: float = 4e-4,
    largest: float = 1e-3,
    growth: float = 1.1,
    iterations: int = 10,
) -> gx.Case:
    """The folded sail on its hub.

    Args:
        diameter: of the circle through the tips [m].
        n: sides of the hub, and tips.
        cells: cells on a side of the hub.
        rev: spin at the start [1/s].
        held: whether a motor keeps this rate; else the hub is free.
        tip: mass at each tip [kg].
        inertia: of the hub about its axis [kg m²].
        slenderness: inertia of the hub across its axis over that about it; above 1 the hub is a
            rod.
        tilt, offset, stuck: see `demos.common.spinning.Disturbance`; a tip sticks.
        contact: activation distance [m].
        contact_stiffness: [N/m³]; None: from closing speeds.  Gradients need a number.
        gap: between the layers [m].
        friction: coefficient of the film on itself and the hub.
        crease: stiffness of creases with a rest angle [N m/m/rad]; 0: none.
        set_angle_ratio: rest angle of the creases over the angle of their folds, 0 to 1.
        yield_angle: of the creases [rad], see `gx.connectors.Crease`; 0: elastic.
        damping: viscosity of the film over its stiffness [s]; 0: none.
        loss_factor: of the film, the same over the `BAND` of frequencies; 0: none.
        residual_stiffness: of the film, compressive over tensile.
        gravity: along -z [m/s²].
        air: density of residual air [kg/m³], which drags on the film; p/(287 T) at the pressure p.
            0: vacuum.
        sense: 1: spin in the direction in which the roll opens; -1: against it.
        ring: radius over that of the disc of points whose heights are recorded; 0: none.
        until: end of the run [s].
        dt, largest: first and largest step [s].
        growth: factor by which a step may be longer than the last one; steps that grow by half are
            rejected more often.
    """
    side, count = pattern(diameter, n)
    folds = gx.fold.Star(n=n, side=side, columns=cells, reach=count * cells, gap=gap)
    mesh = folds.mark(pinwheel(comm, n, side, cells, count * cells))
    film = gx.Membrane(
        mesh, KAPTON_HN.law(thickness, residual_stiffness=residual_stiffness), name="sail"
    )
    # Height of the roll: the length of the last column of cells.
    height = count * side * math.tan(math.pi / n)
    disturbance = Disturbance(tilt, offset, stuck)
    across = slenderness * inertia
    hub = gx.RigidBody(
        0.1,
        (across, across, inertia),
        position=disturbance.hub_position(),
        name="hub",
        comm=comm,
    )
    # The inscribed circle of the roll, less the gap to the film.
    radius = folds.radius * math.cos(math.pi / n / cells) - CLEAR * contact
    surface = drum(hub, radius, 0.0, -height)
    touching = gx.Contact(
        film, surface, distance=contact, stiffness=contact_stiffness, friction=friction
    )
    spin = sense * 2 * math.pi * rev
    tips = [film.port(f"tip {k}") for k in range(n)]
    # Where the first tip is when the film is rolled up.
    flat_tip = np.array([tips[0].initial()])
    rolled_tip = folds.place(flat_tip, np.ones(1))[0]
    items: list[object] = [
        film,
        folds.start(film),
        hub,
        gx.RigidRegion(film, "hub", rigid_body=hub),
        touching,
    ]
    items += [
        gx.connectors.AttachedMass(port, tip, name=f"mass {k}") for k, port in enumerate(tips)
    ]
    items += disturbance.holding_tethers(hub, tips[0], rolled_tip, HOLD)
    items.append(gx.RigidMotion(spin=disturbance.spin(spin)))
    if held:
        items.append(gx.constraints.Driven(hub, (0.0, 0.0, 1.0), angle=lambda t: spin * t))
    if damping:
        items.append(gx.Damping(film, stiffness_factor=damping))
    if loss_factor:
        items.append(gx.loads.flat_damping(film, loss_factor=loss_factor, band=BAND))
    creases: Sequence[gx.connectors.Crease] = ()
    if crease:
        creases = folds.creases(
            film,
            stiffness=crease,
            set_angle_ratio=set_angle_ratio,
            # Zero stands for creases that are elastic: arguments of the command line are numbers.
            yield_angle=yield_angle or None,
        )
        items += creases
    if gravity:
        items.append(gx.Gravity(film, (0.0, 0.0, -gravity)))
    if air:
        items.append(gx.loads.AirDrag(film, air))
    axis = hub.frame_at((0.0, 0.0, 0.0))
    # Angles of tips are taken in the frame of the hub, which turns.
    probes = {
        **spin_probes(hub, film, tips),
        "twist [rad]": gx.probes.PolarPosition(tips[0], axis, quantity="angle"),
        "penetrations": gx.probes.Penetrations(touching),
        **attitude_probes(hub, tips),
        **fold_angles(creases),
    }
    if ring:
        probes |= ring_heights(film, ring * diameter / 2)
    control = gx.StepControl(target_iterations=iterations, max_step=largest, max_factor=growth)
    return deployment_case(items, TITLE, probes, until, control, dt)


def main(
    output: str | Path | None = None,
    until: float = 0.24,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: object,
) -> dict[str, float]:
    """Deploy the sail; `given` are arguments of `build`.  With `output`, a folder: a recording and
    pictures.

    Returns the figures of `spin_figures`; the time [s] of the largest mean radius of the tips, and
    that at which it is `OPEN` of that of the open disc; with creases the figures of
    `crease_figures`.
    """
    case = build(comm, until=until, **given)  # type: ignore[arg-type]
    # Pictures are denser at first, where the roll opens fast.
    parts = (0.0, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.75, 0.85, 1.0)
    run, series = run_case(case, output, "spin_deployment", parts, VIEW)
    if output is not None and comm.rank == 0:
        draw(series, Path(output) / "spin_deployment_curves.png")
    radius = radii_of_tips(series).mean(axis=0)
    diameter = float(given.get("diameter", 1.0))  # type: ignore[arg-type]
    return {
        **spin_figures(run, series),
        "when": float(series.time[radius.argmax()]),
        "opened": first_time(series.time, radius, OPEN * diameter / 2),
        **crease_figures(run, series, case),
    }


def draw(series: gx.Series, path: Path) -> None:
    """Spins over the time, and over the radius of the tips."""
    figure = new_figure(9.0, 3.8)
    left, right = figure.subplots(1, 2)
    plot_spins(left, 1e3 * series.time, series, "rad/s")
    finish(left, "t [ms]", "spin [rad/s]")
    plot_spins(right, 1e3 * radii_of_tips(series).mean(axis=0), series, "rad/s")
    finish(right, "mean radius of the tips [mm]", "spin [rad/s]")
    save(figure, path, TITLE)


if __name__ == "__main__":
    print_figures(main(output="out/spin_deployment"), UNITS)
