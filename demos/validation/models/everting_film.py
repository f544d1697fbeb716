"""The film of an everting tube: a tail inside is drawn through the tip and turned inside out.

A wedge of the tube, one cell wide between planes of symmetry, is a tension field whose mesh is a
strip of the open cylinder, of radius R.  At first its first part, the tail, lies on a rod of radius
r in the axis of the tube, where it is slack around; the rest is the wall of the tube, and half a
torus joins both.  Gas presses on the wall from inside and on the tail from outside, which contact
keeps off the rod.  The end of the tail is let out at a steady speed.  With the areas A and a of
wall and tail, the work of the gas in a travel s of the tip is p (A - a) s, and the tension T of the
tail takes up 2 T s, since the tail moves twice as far:

    T = p (A - a)/2                                                                             (1)

The wedge keeps the film axisymmetric: a quarter of the tube with six cells around lets the slack
tail fold into pleats of the size of the cells.  Nothing but film, pressure and contact is in the
model, in time; (1) and the ratio of the motions are what it has to find.  Damping of the taut film
makes the oscillations of the start decay.  With A and a from the radii that the model finds, (1)
leaves out what the film itself takes up: strain energy of new wall, less than p R/(E t) of the
work, and the loss by damping.
"""

from __future__ import annotations

import math
import time

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.records.fields.reactions import GroundForce

# Lengths over R: of the wall and of the tail at first.
WALL = 2.0
TAIL = 3.0

# Distance of contact over R, and the gap at first over that distance.
DISTANCE = 0.03
FIRST_GAP = 0.9

# Times [s] in which the pressure and the speed of the tail increase, and when the tail starts.
PRESSURE_RAMP = 1e-3
SPEED_RAMP = 2e-3
START = 2e-3

# Stiffness-proportional damping [s]: near half of critical for the breathing of the wall.
DAMPING = 2e-5

# Travel over R after which readings are taken, and steps between those of the shape.
COUNTED_FROM = 0.2
READ_EVERY = 5


class Shape:
    """Mesh and first shape of the tube.

    Args:
        radius: R [m].
        core: radius of the rod [m].
        around: cells around the tube, of which one is in the wedge.
        along: cells over a length R.

    Attributes:
        angle: of the wedge [rad].
        length: of the film along a meridian [m].
        cell: length of a cell along it [m].
        middle: mean of the radii of wall and tail [m].
    """

    def __init__(self, radius: float, core: float, around: int, along: int) -> None:
        self.radius = radius
        self.around = around
        self.angle = 2 * math.pi / around
        self._tail_radius = core + FIRST_GAP * DISTANCE * radius
        # Of the circle in which the torus is turned.
        self.middle = (radius + self._tail_radius) / 2
        self._arc = math.pi * (radius - self.middle)
        self.length = (WALL + TAIL) * radius + self._arc
        self._rings = round(self.length / radius * along) + 1
        self.cell = self.length / (self._rings - 1)

    def mesh(self, comm: MPI.Intracomm) -> gx.Mesh:
        """The strip about the z axis: "tail" and "base" are its ends, "first side" its edge in the
        plane y = 0, and "second side" the other one."""

        def arrays() -> tuple[Array, Array, dict[str, Array]]:
            angle = np.array([0.0, self.angle])
            ring = self.radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
            points = np.repeat(ring[None], self._rings, axis=0)
            points[:, :, 2] = np.linspace(0.0, self.length, self._rings)[:, None]
            number = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
            triangles = []
            for i in range(self._rings - 1):
                a, b = number[i]
                d, c = number[i + 1]
                # Normals to the axis, and diagonals that alternate.
                if i % 2:
                    triangles += [(a, c, b), (a, d, c)]
                else:
                    triangles += [(a, d, b), (b, d, c)]
            lines = {
                "first side": number[:, 0],
                "second side": number[:, 1],
                "tail": number[0],
                "base": number[-1],
            }
            groups = {name: np.stack([line[:-1], line[1:]], axis=1) for name, line in lines.items()}
            return points.reshape(-1, 3), np.array(triangles), groups

        return mesh_of_arrays(comm, arrays)

    def displacement(self, X: Array) -> Array:
        """From the cylinder to the first shape, of points (3, n)."""
        along = X[2]
        tail_length = TAIL * self.radius
        tip = WALL * self.radius
        turned = np.clip((along - tail_length) / self._arc, 0.0, 1.0) * math.pi
        half_width = self.radius - self.middle
        r = self.middle - half_width * np.cos(turned)
        z = tip + half_width * np.sin(turned)
        z += np.minimum(along - tail_length, 0.0)
        z -= np.maximum(along - tail_length - self._arc, 0.0)
        share = r / np.hypot(X[0], X[1])
        return np.stack([X[0] * share, X[1] * share, z]) - X

    @property
    def normal(self) -> tuple[float, float, float]:
        """Of the plane of the second side."""
        return (-math.sin(self.angle), math.cos(self.angle), 0.0)

    @property
    def area_factor(self) -> float:
        """Area of a section, a polygon, over the square of the radius of its corners."""
        return self.around / 2 * math.sin(self.angle)


def travel(t: float, speed: float) -> float:
    """Of the tip [m], half of that of the tail, at the time t."""
    since = max(t - START, 0.0)
    if since < SPEED_RAMP:
        return speed * since**2 / (2 * SPEED_RAMP)
    return speed * (since - SPEED_RAMP / 2)


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Tension of the tail over (1), and travel of the tip over that of the tail."""
    begun = time.process_time()
    radius = inputs.number("flat_width", "m", above=0) / math.pi
    core = inputs.number("core_ratio", "1", above=0) * radius
    pressure = inputs.number("pressure", "Pa", above=0)
    speed = inputs.number("tip_speed", "m/s", above=0)
    step = inputs.number("step", "s", above=0)
    # The quick form ends earlier.
    last_travel = inputs.number("travel", "1", above=0) * radius * (0.5 if quick else 1)
    shape = Shape(
        radius,
        core,
        around=inputs.whole("cells_around"),
        along=inputs.whole("cells_along"),
    )
    law = gx.TensionField(
        inputs.number("E", "Pa", above=0),
        inputs.number("poisson", "1"),
        density=inputs.number("density", "kg/m3", above=0),
        thickness=inputs.number("thickness", "m", above=0),
    )
    film = gx.Membrane(shape.mesh(comm), law, displacement=shape.displacement, name="tube")

    def let_out(X: Array, t: float) -> Array:
        moved = shape.displacement(X)
        moved[2] += 2 * travel(t, speed)
        return moved

    # Free across: where a fixed end is wider than the tail, gas would press on the cone between.
    tail = gx.Fixed(film, "tail", components=(2,), motion=let_out)
    rod = gx.contact.Cylinder(
        start=(0.0, 0.0, -shape.length),
        end=(0.0, 0.0, 2 * shape.length),
        radius=core,
    )
    scene = gx.Scene(
        gx.Pressure(film, lambda t: pressure * min(t / PRESSURE_RAMP, 1.0)),
        tail,
        gx.Fixed(film, "base", components=(2,)),
        gx.Fixed(film, "first side", components=(1,)),
        gx.Fixed(film, "second side", normal=shape.normal),
        gx.Contact(film, rod, distance=DISTANCE * radius),
        gx.Damping(film, stiffness_factor=DAMPING, tension_only=True),
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=step))
    # One ring of nodes after the other turns, so that means are over whole cells.
    cells = max(round((last_travel - COUNTED_FROM * radius) / shape.cell), 1)
    run.run(until=START + SPEED_RAMP / 2 + COUNTED_FROM * radius / speed)
    first = run.totals
    tensions = []
    readings = []
    for _ in range(round(cells * shape.cell / speed / step)):
        run.run(until=run.time + step)
        # Of all wedges; the support pulls the tail back.
        force, _ = GroundForce(run.system, tail)()
        tensions.append(-shape.around * float(force[2]))
        if run.step % READ_EVERY == 0:
            readings.append([2 * travel(run.time, speed), *_positions(run, film, shape)])
    tail_travel, tip, wall_square, tail_square = np.array(readings).T
    area = shape.area_factor * float((wall_square - tail_square).mean())
    slope, _ = np.polyfit(tail_travel, tip, 1)
    tension = float(np.mean(tensions))
    # Of the gas in the wedge.
    work = pressure * area * cells * shape.cell / shape.around
    quantities = {
        "tension of the tail over balance": Predicted(tension / (pressure * area / 2)),
        "tip over tail": Predicted(float(slope)),
    }
    details = {
        "tension [N]": tension,
        "stored over work": (run.totals.energy - first.energy) / work,
        "dissipated over work": (run.totals.dissipated - first.dissipated) / work,
        "energy error": run.energy_error,
        "unknowns": float(run.system.unknowns.numbering.size),
        "steps": float(run.step),
        "seconds": time.process_time() - begun,
    }
    return Prediction(quantities, details)


def _positions(run: gx.Simulation, film: gx.Membrane, shape: Shape) -> tuple[float, float, float]:
    """Height of the tip [m], and mean squares of the radii [m²] of wall and tail, at nodes that are
    more than R behind the tip; collective."""
    points, moved = gx.fields.field_values(run, film, field="displacement")
    position = points + moved
    squares = position[:, 0] ** 2 + position[:, 1] ** 2
    comm = film.comm
    tip = comm.allreduce(float(position[:, 2].max(initial=-np.inf)), op=MPI.MAX)
    is_behind = position[:, 2] < tip - shape.radius
    is_wall = squares > shape.middle**2
    means = []
    for part in (is_behind & is_wall, is_behind & ~is_wall):
        count = comm.allreduce(int(part.sum()))
        means.append(comm.allreduce(float(squares[part].sum())) / count)
    return tip, means[0], means[1]
