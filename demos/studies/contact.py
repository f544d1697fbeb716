"""Contact: iterations and errors of conservation over step and law, exact answers, and extreme
numbers.

films     a square film of 0.2 m is thrown at 2 m/s, turned and turning, onto another one; d̂ 1 mm,
          K 2e6 N/m³, 10 ms
zigzag    a strip folded into 6 layers 2 mm apart, thrown at each other at random 1 m/s; d̂ 0.5 mm,
          K 8e6 N/m³, 10 ms
bars      two strips head-on, edge to edge: one-dimensional waves (Saint-Venant): contact for 2L/c,
          stress ρcΔv/2, velocities exchanged
wall      such a strip on a fixed plane: contact for 2L/c, it comes back as it came
block     a film flat on a plane that is the face of a rigid body, by a linear penalty: contact for
          π√(m/k), m the reduced mass, and the velocities of two bodies on a spring
cable     a cable falls on a film;  edges: film edge on film edge;  corner: a film over the corner
          of a box
tube      0.8 m, 58 mm, five compartments folded to a zigzag, filled from a tank for 40 ms, steps of
          2.5e-5 s; and alone, without contact, when layers pass through each other: the ratio of
          the times is what contact costs; and controlled, with steps of at most 5e-5 s that aim at
          nine iterations
map       films of 0.1 m, 4 x 4 cells, at 2 m/s, d̂ 1 mm, h 1e-4 s, 3 ms; one number goes from
          ordinary to extreme

`deviation` is the largest relative error of contact time, velocities and mean stress, zero where no
exact answer exists.  Every case must keep energy and momenta, and have no edge that intersects a
triangle at its end; anything else is an error.  The picture is the map.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.inflatable_tube import InflatableTube
from demos.studies import stability
from demos.studies.engine.study import Study
from gossamer_fx.extend import Result, check
from gossamer_fx.meshes.arrays import cell_corners, mesh_of_arrays, plane_grid, triangles_of
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN

# A polymer film of 0.1 mm [Pa, 1, kg/m³, m].
LAW = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
# Largest errors, relative, with which a case counts as right.
ENERGY = 1e-10
MOMENTUM = 1e-12
# The values of each axis of the map; the others are then those of ORDINARY.
MAP = {
    "speed": [0.01, 0.1, 10.0, 100.0],
    "h": [0.1, 0.3, 3.0, 10.0],
    "stiffness": [1e-6, 1e-3, 1e3, 1e6],
    "thickness": [7.5e-6, 2.5e-5, 1e-3],
    "size": [0.01, 1.0, 10.0],
    "distance": [1e-5, 1e-4, 5e-3],
}
ORDINARY = {
    "speed": 2.0,
    "h": 1.0,
    "stiffness": 1.0,
    "thickness": 1e-4,
    "size": 0.1,
    "distance": 1e-3,
}


def film(
    comm: MPI.Comm, n: int = 4, size: float = 0.1, name: str = "film", **given: Any
) -> gx.Membrane:
    """A square film about `at` [m], turned about z by `turn` and about x by `tilt`, at a velocity
    and spin about z."""
    # What a film has if it is not given.
    motion = {
        "at": (0.0, 0.0, 0.0),
        "turn": 0.0,
        "tilt": 0.0,
        "velocity": (0.0, 0.0, 0.0),
        "spin": 0.0,
    } | given
    law = motion.pop("law", None) or gx.Miyazaki(**LAW, residual_stiffness=1e-6)
    # Turn about z, then tilt about the turned x axis.
    c, s, C, S = (f(motion[a]) for a in ("turn", "tilt") for f in (np.cos, np.sin))

    def placed(X: np.ndarray) -> np.ndarray:
        x = X[0] - size / 2
        y = X[1] - size / 2
        x, y = c * x - s * y, s * x + c * y
        return np.vstack([x, C * y, S * y]) + np.array(motion["at"])[:, None]

    def thrown(X: np.ndarray) -> np.ndarray:
        x = placed(X) - np.array(motion["at"])[:, None]
        return np.cross((0, 0, motion["spin"]), x.T).T + np.array(motion["velocity"])[:, None]

    mesh = sheet(comm, n, n, size, size)
    return gx.Membrane(
        mesh,
        law,
        name=name,
        displacement=lambda X: placed(X) - X,
        velocity=thrown,
    )


def zigzag(
    # The strip is meshed flat, and its columns then go to and fro.
    comm: MPI.Comm,
    layers: int = 6,
    cells: int = 6,
    cell: float = 0.01,
    ridge: float = 2e-3,
) -> gx.Membrane:
    """A strip folded along z, with random speeds of 1 m/s of its layers, and 0.3 m/s of its
    nodes."""
    # Stations along the flat strip [m]: the cells of each layer, then the ridge to the next one.
    x = np.concatenate([[0], np.cumsum(([cell] * cells + [ridge]) * layers)[:-1]])
    layer = np.repeat(np.arange(layers), cells + 1)
    # Distance from the begin of the column's layer.
    way = x - layer * (cells * cell + ridge)
    # Every second layer runs back.
    X = np.where(layer % 2, cells * cell - way, way)

    def flat_strip() -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        points = plane_grid(x, np.arange(6) * cell)
        a, b, c, d = cell_corners(np.arange(len(points)).reshape(6, -1))
        return points, np.vstack([triangles_of(a, b, c), triangles_of(a, c, d)]), {}

    speeds = np.random.default_rng(0).uniform(-1, 1, layers)[layer]

    def folded(p: np.ndarray) -> np.ndarray:
        return np.vstack(
            [np.interp(p[0], x, X) - p[0], 0 * p[0], np.interp(p[0], x, layer * ridge)]
        )

    def thrown(p: np.ndarray) -> np.ndarray:
        # Different wave numbers along and across, so that no two nodes of a neighbourhood move
        # alike.
        phase = np.sin(
            np.outer((3e3, 5e3, 7e3), p[0]) + np.outer((2e3, 11e3, 13e3), p[1])
        )  # the same on every rank
        return 0.4 * phase + np.vstack([0 * p[0] + 0.1, 0 * p[0] + 0.2, np.interp(p[0], x, speeds)])

    mesh = mesh_of_arrays(comm, flat_strip)
    return gx.Membrane(
        mesh,
        gx.Miyazaki(**LAW, residual_stiffness=1e-6),
        displacement=folded,
        velocity=thrown,
        name="strip",
    )


# End of the run of the tube [s]: the valve is open, and all compartments are under pressure.
UNTIL = 0.04
# ν = 0 makes the waves one-dimensional.
BAR = {"E": 2.3e9, "nu": 0.0, "density": 1400.0, "thickness": 1e-4}
# Sizes [m] and speed [m/s] of each bar, and speed of waves in it [m/s].
LENGTH = 0.5
WIDTH = 0.02
SPEED = 1.0
WAVE = (BAR["E"] / BAR["density"]) ** 0.5


def bar(comm: MPI.Comm, start: float, speed: float, name: str) -> gx.Membrane:
    """A strip along x that begins at `start`."""
    moved = lambda X: np.vstack([0 * X[0] + start, 0 * X[0], 0 * X[0]])  # noqa: E731
    thrown = lambda X: np.vstack([0 * X[0] + speed, 0 * X[0], 0 * X[0]])  # noqa: E731
    mesh = sheet(comm, 64, 2, LENGTH, WIDTH)
    return gx.Membrane(
        mesh,
        gx.Linear(**BAR),
        displacement=moved,
        velocity=thrown,
        name=name,
    )


def impact(comm: MPI.Comm, against: str) -> tuple[gx.Simulation, gx.Contact, float]:
    """Bars head-on, or one against a wall."""
    # d is far below the displacement of the end in a passage of the wave, and h resolves a
    # hundredth of it.
    d = 2e-5
    h = 4e-6
    left = bar(comm, -LENGTH - 1.1 * d, SPEED, "left")
    if against == "bars":
        other: Any = bar(comm, 0.0, -SPEED, "right")
    else:
        other = gx.contact.Plane(
            point=(0.0, 0.0, 0.0),
            normal=(-1.0, 0.0, 0.0),
            name="wall",
        )
    contact = gx.Contact(left, other, distance=d)
    force = gx.Series({"force": gx.probes.ContactForce(contact, left, axis="x")})
    run = gx.Simulation(
        gx.Scene(contact),
        gx.Midpoint(dt=h),
        outputs=[force],
    )
    # The contact ends after 2 L/c; a tenth more shows the rebound.
    run.run(until=2.2 * 2 * LENGTH / WAVE)
    values = -np.array(force["force"])
    # Contact lasts for the steps with a force above round-off.
    time = h * np.count_nonzero(values > 1e-6 * values.max())
    # Mean stress: impulse over contact time and section.
    stress = h * values.sum() / time / (WIDTH * BAR["thickness"])
    x = bar_velocity(run, left)
    # Saint-Venant: both bars of one impedance, or one bar on a wall, bear ρ c V.
    exact = BAR["density"] * WAVE * SPEED
    return (
        run,
        contact,
        max(abs(time * WAVE / (2 * LENGTH) - 1), abs(stress / exact - 1), abs(x / -SPEED - 1)),
    )


def bar_velocity(run: gx.Simulation, body: gx.Membrane) -> float:
    """Mean velocity along x, by mass."""
    owned = run.system.unknowns.state[body].owned
    P = run.system.unknowns.numbering.vector()
    run.system.unknowns.M.mult(run.system.unknowns.v0, P)
    mass = BAR["density"] * BAR["thickness"] * LENGTH * WIDTH
    return float(run.comm.allreduce(P.array_r[owned][::3].sum()) / mass)


def block(comm: MPI.Comm) -> tuple[gx.Simulation, gx.Contact, float]:
    """m1 = the film at 2 m/s on m2 = 3 m1 at rest."""
    d = 1e-3
    V = 2.0
    size = 0.1
    mass = LAW["density"] * LAW["thickness"] * size**2
    reduced = 0.75 * mass
    # A spring of this stiffness is closed by 0.6 of the distance.
    k = reduced * (V / (0.6 * d)) ** 2
    # Three times the mass of the film; it neither turns nor tilts, so that its inertia does not
    # count.
    face = gx.RigidBody(
        3 * mass,
        (1e-5, 1e-5, 1e-5),
        position=(0, 0, -0.01),
        comm=comm,
        name="block",
    )
    thrown = film(
        comm,
        size=size,
        at=(0, 0, 1.05 * d),
        velocity=(0, 0, -V),
    )
    plane = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1), body=face)
    contact = gx.Contact(
        thrown,
        plane,
        distance=d,
        stiffness=k / size**2,
        law="penalty",
    )
    # About a thousandth of the contact time.
    h = 2e-6
    expected = np.pi * (reduced / k) ** 0.5
    force = gx.Series(
        {
            "force": gx.probes.ContactForce(contact, thrown, axis="z"),
            "gap": gx.probes.ContactGap(contact),
        }
    )
    run = gx.Simulation(
        gx.Scene(contact),
        gx.Midpoint(dt=h),
        outputs=[force],
    )
    # Past the end of the contact.
    run.run(until=1.3 * expected)
    time = h * np.count_nonzero(np.array(force["force"]) > 1e-9)
    depth = d - min(force["gap"])
    velocity = gx.probes.Velocity(face.port(), "z")(run)
    return (
        run,
        contact,
        max(abs(time / expected - 1), abs(depth / (0.6 * d) - 1), abs(velocity / -(V / 2) - 1)),
    )


def mixed(comm: MPI.Comm, what: str) -> tuple[gx.Simulation, gx.Contact, float]:
    """Lines, edges and corners."""
    flat = film(comm, name="flat")
    if what == "cable":
        down = lambda X: np.outer((0.0, 0.0, -2.0), np.ones(X.shape[1]))  # noqa: E731
        mesh = line(comm, [(-0.06, -0.01, 0.003), (0.07, 0.02, 0.003)], 5)
        rope = gx.Cable(
            # A cable of 10 g/m, as thick as the distance of contact.
            mesh,
            gx.CableLaw(EA=1e4, line_density=0.01),
            velocity=down,
            name="rope",
        )
        contact = gx.Contact(
            flat,
            rope,
            distance=1e-3,
            radius={"rope": 1e-3},
        )
    elif what == "edges":
        # Both films are upright, and their lower and upper edge cross.
        upright = film(
            comm,
            at=(0.003, 0.0, 0.052),
            tilt=np.pi / 2,
            velocity=(0, 0, -2.0),
            name="upright",
        )
        contact = gx.Contact(
            film(
                comm,
                turn=0.3,
                tilt=np.pi / 2,
                at=(0, 0, -0.064),
                name="other",
            ),
            upright,
            distance=1e-3,
        )
    else:
        # A corner points upwards, where three faces and three edges meet.
        box = gx.contact.Box(
            centre=(0, 0, -0.0366),
            sizes=(0.04, 0.04, 0.04),
            axes=on_a_corner(),
        )
        thrown = film(
            comm,
            n=6,
            velocity=(0, 0, -2.0),
            name="thrown",
        )
        contact = gx.Contact(thrown, box, distance=1e-3)
    run = gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=1e-4))
    run.run(until=5e-3)
    return run, contact, 0.0


def on_a_corner() -> tuple[tuple[float, ...], ...]:
    """Axes of a box whose diagonal is upright."""
    up = np.ones(3) / 3**0.5
    side = np.array([1.0, -1.0, 0.0]) / 2**0.5
    R = np.vstack([side, np.cross(up, side), up])
    return tuple(tuple(row) for row in R.T.tolist())


def tube(
    comm: MPI.Comm, touches: bool, controlled: bool = False
) -> tuple[gx.Simulation, gx.Contact | None, float]:
    """A folded tube of five compartments, filled through a valve that opens within 15 ms."""
    # The inflatable tube of a laboratory, rolled from film of 25 µm.
    length = 0.8
    diameter = 0.058
    folds = gx.fold.Zigzag(
        length=length,
        panels=5,
        angle=np.radians(80),
        width=np.pi * diameter / 2,
        opening=1e-3,
        lift=3e-4,
    )
    law = KAPTON_HN.law(25e-6, residual_stiffness=1e-6)
    mesh = flat_tube(comm, length, diameter, 6, compartments=5)
    distance = 0.0
    if touches:
        distance = 5e-4
    made = InflatableTube(
        mesh,
        law,
        gas=NITROGEN,
        pressure=1.0,
        dead_volume=1e-6,
        folds=folds,
        contact_distance=distance,
    )
    source = gx.Tank(
        20e-6,
        gas=NITROGEN,
        pressure=1.5e6,
        temperature=293.0,
    )

    # Diameter from 0.2 to 1 mm; a sudden opening would shock the first compartment.
    def area(t: float) -> float:
        s = min(max((t - 5e-3) / 1e-2, 0.0), 1.0)
        return np.pi / 4 * (0.2e-3 + 0.8e-3 * s * s * (3 - 2 * s)) ** 2

    control = None
    if controlled:
        control = gx.StepControl(target_iterations=9, max_step=5e-5)
    run = gx.Simulation(
        gx.Scene(made, made.inlet(source, area)),
        gx.Midpoint(dt=2.5e-5),
        control=control,
    )
    run.run(until=UNTIL)
    return run, made.contact, 0.0


def extreme(comm: MPI.Comm, words: list[str]) -> tuple[gx.Simulation, gx.Contact, float]:
    """One cell of the map."""
    v = ORDINARY | {axis: float(value) for axis, value in (word.split("=") for word in words)}
    law = LAW | {"thickness": v["thickness"]}
    # `stiffness` is of the upper film only, so that films of different stiffness meet.
    soft = gx.Miyazaki(**law | {"E": LAW["E"] * v["stiffness"]}, residual_stiffness=1e-6)
    size = v["size"]
    lower = film(comm, size=size, law=gx.Miyazaki(**law, residual_stiffness=1e-6), name="lower")
    # No node above another one, and outside of the activation distance.
    at = (0.1 * size, 0.05 * size, 1.5 * v["distance"])
    velocity = (0.1 * v["speed"], 0.0, -v["speed"])
    upper = film(
        comm,
        size=size,
        law=soft,
        turn=0.4,
        at=at,
        velocity=velocity,
        name="upper",
    )
    contact = gx.Contact(lower, upper, distance=v["distance"])
    run = gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=1e-4 * v["h"]))
    # Thirty steps, and a whole impact where it lasts no longer.
    run.run(until=max(30 * run.stepper.dt, 3e-3 if v["speed"] >= 1 else 0.0))
    return run, contact, 0.0


def thrown_layers(
    comm: MPI.Comm, scene: str, law: str, h: str
) -> tuple[gx.Simulation, gx.Contact, float]:
    """Two films or the layers of a zigzag, with steps of h [s]."""
    if scene == "zigzag":
        contact = gx.Contact(zigzag(comm), distance=5e-4, stiffness=8e6, law=law)
    else:
        lower = film(comm, 10, 0.2, name="lower")
        upper = film(
            comm,
            10,
            0.2,
            name="upper",
            turn=0.4,
            tilt=0.02,
            at=(0.01, 0.005, 6e-3),
            velocity=(0.3, 0, -2.0),
            spin=3.0,
        )
        contact = gx.Contact(lower, upper, distance=1e-3, stiffness=2e6, law=law)
    run = gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=float(h)))
    run.run(until=0.01)
    return run, contact, 0.0


def problem(comm: MPI.Comm, case: str) -> Mapping[str, float]:
    """Run one case.

    Raises:
        StepFailure: with the reason.
        InputError: it completed with a wrong answer.
    """
    words = case.split()
    if words[0] in ("films", "zigzag"):
        run, contact, deviation = thrown_layers(comm, *words)
    elif words[0] in ("bars", "wall"):
        run, contact, deviation = impact(comm, words[0])
    elif words[0] == "block":
        run, contact, deviation = block(comm)
    elif words[0] == "tube":
        run, contact, deviation = tube(comm, words[1:] != ["alone"], words[1:] == ["controlled"])
    elif words[0] in ("cable", "edges", "corner"):
        run, contact, deviation = mixed(comm, words[0])
    else:
        run, contact, deviation = extreme(comm, [] if case == "ordinary" else words)
    first = run.first
    now = run.totals
    P = run.system.unknowns.numbering.vector()
    run.system.unknowns.M.mult(run.system.unknowns.v0, P)
    # The sum of |m v| of all nodes, which may be opposite, is a scale that is not zero, also where
    # the total momentum is.
    size = float(comm.allreduce(np.abs(P.array_r).sum()))
    # What does not move takes momentum.
    free = words[0] not in ("wall", "corner", "tube")
    turned = np.abs(now.angular_momentum - first.angular_momentum).max()
    change = max(np.abs(now.momentum - first.momentum).max(), turned) / size
    penetrations = 0.0
    if contact is not None:
        penetrations = gx.probes.Penetrations(contact)(run)
    # Whatever else is measured, a case that violates these is an error.
    sound = abs(run.energy_error) < ENERGY and (change < MOMENTUM or not free) and penetrations == 0
    check(
        sound,
        f"Case '{case}' has a wrong result without an error: energy {run.energy_error:.1e}, "
        f"momenta {change:.1e}, "
        f"{penetrations:.0f} penetrations.",
    )
    return {
        "iterations": run.iterations / run.step,
        "substeps": run.substeps,
        "energy_error": abs(run.energy_error),
        "momentum_error": change if free else 0.0,
        "deviation": deviation,
        "seconds": run.seconds,
    }


def cases() -> list[str]:
    """Names of all cases: scenes over law and step, exact ones, and the cells of the map."""
    table = [
        # Both laws, and steps up to those that need rejections.
        f"{s} {law} {h:g}"
        for s in ("films", "zigzag")
        for law in ("barrier", "penalty")
        for h in (1e-4, 2e-4, 5e-4)
    ]
    table += ["films barrier 0.001", "zigzag barrier 0.001"]
    pairs = ["thickness=7.5e-06 size=1", "thickness=7.5e-06 size=4"]  # edges of 1 m in the last
    exact = ["bars", "wall", "block", "cable", "edges", "corner"]
    tubes = ["tube", "tube alone", "tube controlled"]
    single = [f"{axis}={value:g}" for axis, values in MAP.items() for value in values]
    return [*table, *exact, *tubes, "ordinary", *single, *pairs]


def draw(results: list[Result], path: Path) -> None:
    """The map."""
    stability.draw(
        [r for r in results if "=" in str(r.values["case"]) or r.values["case"] == "ordinary"], path
    )


# Stiffnesses are given so that gaps have closed forms or differ between laws.  The estimate of the
# program has a reserve of a quarter in the closing speed; the block closes its gap by 0.6, and a
# barrier is infinite at contact, so that nothing passes in either.
TOO_SOFT = {"is too soft to stop": "the gap closes by a part that is computed or bounded"}

STUDY = Study(
    "contact",
    "Contact: iterations and rejected steps, conservation, and deviation from exact answers",
    problem,
    {"case": cases()},
    lambda case: 1.0,
    quick={"case": ["films barrier 0.0002", "block", "corner", "speed=10"]},
    shows=("iterations", "energy_error"),
    limits={"energy_error": 1e-8, "momentum_error": 1e-12},
    expected_warnings=TOO_SOFT,
    columns="iterations, substeps, energy_error, momentum_error, deviation, seconds",
    may_fail=True,
    draw=draw,
)
