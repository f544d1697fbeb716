"""The deployed state of SPROUT: two inflated tubes in V hold a film between them; equilibrium and
vibrations.

The tubes are held at a round section on the cube.  The film hangs by three cords from the tips of
the tubes and from the cube.  Its edges are arcs with a cable in each, so that film and cables are
in equilibrium with the same tension n in all directions: a cable of radius R bears n R, and a cord
the resultant of two cables.  A film that is tied along the tubes cannot be drawn taut by them: it
is 10⁴ times as stiff in its plane as they are in bending, so that it bears on a few points, and
wrinkles.  The tips are pulled inwards; the film is cut for the tips as a cantilever of the bending
stiffness EI = π E t r³ has them under the cord's force F, across (n) and along (a) the tube:

    δ = F_n L³/(3 EI) / (1 - F_a/P),    P = π² EI/(4 L²)

For a tube alone there is another closed form, the first frequency 1.8751² √(EI/m)/(2π L²) with its
mass m per length.

Where the values come from:
    tubes, film, cube    the demo `sprout`; the pressure is that at the end of its run
    tension              chosen: 8 mN/m.  The tubes then bear half of π p r³/2, at which a tube
                         begins to wrinkle (Comer & Levy, AIAA J. 1 (1963) 1652)
    cords                chosen: 1 N/m, so that an error of a millimetre changes the tension by a
                         few per cent
    cables               aramid thread of 0.1 mm: 500 N, 1.1e-5 kg/m

    ./gossamer demo sprout_deployed
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.arcs import Arc, arc_mesh, arcs, corner_pulls, radii_of
from demos.common.deployment import print_figures
from demos.inflatables.sprout import CUBE, HALF, MASS, SIDES, STAND, Figure, inertia
from gossamer_fx.core.model.body import Array
from gossamer_fx.meshes.creased import creased_tube
from gossamer_fx.presets.films import KAPTON_HN

TITLE = "SPROUT deployed"
VIEW = gx.plot.View(azimuth=math.radians(-60), elevation=math.radians(35))
FILM = KAPTON_HN
CABLE = gx.CableLaw(EA=500.0, line_density=1.1e-5)
FILM_THICKNESS = 12.5e-6  # m
PRESSURE = 10.3e3  # of the gas over that outside [Pa]
TENSION = 8e-3  # of the film [N/m]
CORD = 1.0  # stiffness of a cord [N/m]
CORD_LENGTH = 0.06  # under load [m]
SAG = 0.08  # of the arcs, over the distance of their ends
# cos k cosh k = -1 of a cantilever.
FIRST_EIGENVALUE = 1.875104069
# Modes below this frequency [Hz] are rigid motions of the free satellite, of which there are six.
RIGID = 0.02
RIGID_MOTIONS = 6


@dataclass(frozen=True)
class Satellite:
    """The deployed satellite: its tubes, the figure in which they are cut, and the search for the
    equilibrium."""

    tubes: dict[int, gx.Membrane]
    film: gx.Membrane | None
    figure: Figure
    shape: Cut
    statics: gx.Equilibrium

    def tip(self, side: int) -> Array:
        """Position (3,) [m] of the middle of a tube's tip: of the two seams there."""
        ends = []
        for out in (0.0, self.figure.width):
            x, y = self.figure.at(side, self.figure.length, out)
            port = self.tubes[side].port_at((x, y, 0.0))
            ends.append(self.statics.system.state.vector(port))
        middle: Array = (ends[0] + ends[1]) / 2
        return middle


@dataclass(frozen=True)
class Rounding:
    """Map of a flat tube to a round one that may be bent, which keeps lengths but near its flat
    ends.

    Args:
        figure: of the flat tubes.
        side: of the tube.
        root, tip: distances [m] along the tube of its flat ends from the line of the roots.
        deflection: of the tip inwards [m], in the shape of a cantilever that is loaded there.
    """

    figure: Figure
    side: int
    root: float
    tip: float
    deflection: float

    def displacement(self, X: Array, up: int) -> Array:
        """Displacement (3, n) [m] of points X (3, n) of the upper (up = 1) or lower sheet (-1)."""
        x0, y0 = self.figure.at(self.side, 0.0, 0.0)
        axis = np.array([self.side * math.sin(HALF), math.cos(HALF)])
        outward = np.array([self.side * math.cos(HALF), -math.sin(HALF)])
        from_root = X[:2] - np.array([[x0], [y0]])
        along = axis @ from_root
        out = outward @ from_root
        # Ends are cut along x: their distance depends on that across the tube.
        shift = out * math.tan(HALF)
        nearest_end = np.minimum(along - shift - self.root, self.tip - along + shift)
        # From flat at the ends to round at a distance of one diameter.
        roundness = np.clip(nearest_end / self.figure.diameter, 0.0, 1.0)
        radius = self.figure.diameter / 2
        angle = np.pi * out / self.figure.width
        round_out = self.figure.width / 2 - radius * np.cos(angle)
        moved = roundness * (round_out - out)
        lifted = up * roundness * radius * np.sin(angle)
        # Sections stay normal to the bent axis, so that the start is nearly free of stress.
        length = self.figure.length
        station = np.clip(along / length, 0.0, 1.0)
        # Beyond the tip the tube goes on straight.
        beyond = np.maximum(along / length - 1, 0.0)
        inward = self.deflection * ((3 * station**2 - station**3) / 2 + 1.5 * beyond)
        slope = self.deflection * (6 * station - 3 * station**2) / (2 * length)
        from_axis = out + moved - self.figure.width / 2
        across = moved - inward
        forwards = slope * from_axis
        in_plane = np.outer(outward, across) + np.outer(axis, forwards)
        return np.vstack([in_plane, lifted])


def tube_of(
    comm: MPI.Comm,
    figure: Figure,
    side: int,
    law: gx.Miyazaki,
    cell: float,
    round_ends: bool,
    deflection: float,
) -> gx.Membrane:
    """A tube; with round ends it starts round and bent, and has a stub beyond each end that closes
    it.

    The groups "ring 1" and "ring 2" are its round sections at root and tip; "side 1" is the flat
    root of a flat tube.
    """
    name = {1: "right", -1: "left"}[side]
    # A line of edges along the axis, so that the sections have nodes there.
    lines = [figure.axis(side)]
    if not round_ends:
        flat = creased_tube(comm, figure.tube(side), lines, cell, lambda X: X[:, 1], ())
        return gx.Membrane(flat, law, name=name)
    stub = stub_length(figure)
    longer = Figure(figure.length + 2 * stub, figure.diameter, figure.at(0, -stub, 0.0))
    # The root of the longer tube is nearer to the middle, too.
    shift = -side * stub * math.sin(HALF)
    outline = [(x + shift, y) for x, y in longer.tube(side)]
    for along in (0.0, figure.length):
        lines.append((figure.at(side, along, 0.0), figure.at(side, along, figure.width)))
    walls = (0.0, figure.length * math.cos(HALF))
    mesh = creased_tube(comm, outline, lines, cell, lambda X: X[:, 1], walls)
    rounding = Rounding(figure, side, -stub, figure.length + stub, deflection)
    sheets = {
        "top": partial(rounding.displacement, up=1),
        "bottom": partial(rounding.displacement, up=-1),
    }
    return gx.Membrane(mesh, law, displacement=sheets, name=name)


def stub_length(figure: Figure) -> float:
    """Length [m] of tube beyond a round end, in which it closes to a flat seam."""
    return 1.5 * figure.diameter


def bending_stiffness(figure: Figure, thickness: float) -> float:
    """π E t r³ [N m²] of a round tube."""
    return math.pi * FILM.E * thickness * (figure.diameter / 2) ** 3


@dataclass(frozen=True)
class Cut:
    """The film with arcs for edges, in the plane, and the forces in it.

    Attributes:
        supports: where its cords are held (3, 2) [m]: on the cube, and at the tips as they are
            under load, right and left.
        edges: arcs between the corners of the film.
        forces: of film and cables on the cords (3, 2) [N].
        deflection: of the tips [m], by the closed form.
    """

    supports: Array
    edges: list[Arc]
    forces: Array
    deflection: float

    @property
    def corners(self) -> Array:
        """Of the film (3, 2) [m]."""
        return np.array([arc.ends[0] for arc in self.edges])


def cut(figure: Figure, thickness: float, tension: float, pressure: float) -> Cut:
    """The film for a tension [N/m], for which the tips are where the closed forms say; pressure of
    the gas [Pa]."""
    length = figure.length
    EI = bending_stiffness(figure, thickness)
    buckling_load = math.pi**2 * EI / (4 * length**2)
    inward = np.array([-math.cos(HALF), math.sin(HALF)])
    along = np.array([math.sin(HALF), math.cos(HALF)])
    # A closed tube under pressure is longer by (½ - ν) p r/(E t).
    strain = (0.5 - FILM.nu) * pressure * figure.diameter / (2 * FILM.E * thickness)
    root = np.array(figure.axis(1)[0])
    straight_tip = root + (1 + strain) * length * along
    mirror = np.array([-1.0, 1.0])
    supports = np.array([[0.0, 0.0], straight_tip, straight_tip * mirror])
    corners = supports.copy()
    deflection = 0.0
    # Forces turn with the corners, and move them a little: a few turns until both agree.
    for _ in range(50):
        radii = radii_of(corners, SAG)
        forces = corner_pulls(arcs(corners, radii), tension)
        # The force pulls the tip towards the middle of the film: a part bends the tube, a part
        # presses on it.
        across_tube = float(forces[1] @ inward)
        along_tube = float(-forces[1] @ along)
        # Compression makes the tube softer in bending, as in Euler's buckling.
        small = across_tube * length**3 / (3 * EI)
        deflection = small / (1 - along_tube / buckling_load)
        tip = straight_tip + deflection * inward
        supports[1] = tip
        supports[2] = tip * mirror
        # Each cord lies along its force; on the way its length moves the corner of the film.
        directions = forces / np.linalg.norm(forces, axis=1)[:, None]
        corners = supports + CORD_LENGTH * directions
    return Cut(supports, arcs(corners, radii), forces, deflection)


def hung_film(
    comm: MPI.Comm, shape: Cut, law: gx.Miyazaki, tension: float, cell: float
) -> tuple[gx.Membrane, list[gx.connectors.Tape]]:
    """The film under its tension [N/m], with cells of a size [m], and the cables in its edges."""
    names = [f"corner {k}" for k in range(3)]
    mesh = arc_mesh(comm, shape.edges, names, lambda model, *_: model.mesh.generate(2), cell)
    film = gx.Membrane(mesh, law, initial_stress=tension / law.thickness, name="film")
    cables = []
    for k, arc in enumerate(shape.edges):
        # Made shorter by its strain, so that it bears its force at the length of the arc.
        strain = tension * arc.radius / CABLE.EA
        cable = gx.connectors.Tape.along_edges(
            film, CABLE, edges=f"edge {k}", length_factor=1 / (1 + strain), name=f"cable {k}"
        )
        cables.append(cable)
    return film, cables


def build(
    comm: MPI.Comm,
    length: float = 1.5,
    diameter: float = 0.03,
    thickness: float = FILM_THICKNESS,
    pressure: float = PRESSURE,
    tension: float = TENSION,
    cell: float = 0.012,
    film_cell: float = 0.06,
    mass: float = MASS,
    held: bool = False,
    with_film: bool = True,
    round_ends: bool = True,
) -> Satellite:
    """The scene of the deployed state before its equilibrium.

    Args:
        length, diameter: of the tubes [m].
        thickness: of all films [m].
        pressure: of the gas over that outside [Pa].
        tension: of the film [N/m].
        cell, film_cell: of tubes and film [m].
        mass: of the cube [kg].
        held: whether the cube is fixed in space.
        with_film: whether there is a film; without it the tubes are two cantilevers.
        round_ends: whether the tubes have round plates as ends, by which they are fixed to the
            cube; else they are pressed flat there, as in the demo `sprout`, and bear no film.
    """
    figure = Figure(length, diameter, (0.0, 0.0))
    law = FILM.law(thickness, residual_stiffness=1e-4)
    cube = gx.RigidBody(
        mass,
        [inertia(mass)] * 3,
        position=(0.0, -CUBE / 2 - STAND, 0.0),
        comm=comm,
        name="cube",
    )
    # Bodies and what joins them, in any order: the scene sorts them.
    items: list[object] = [cube]
    if held:
        items.append(gx.constraints.FixedJoint(gx.ground_frame(), cube.frame_at((0.0, 0.0, 0.0))))
    fixed_group = "ring 1" if round_ends else "side 1"
    tubes: dict[int, gx.Membrane] = {}
    plates: dict[int, gx.RigidRegion] = {}
    shape = cut(figure, thickness, tension, pressure)
    deflection = shape.deflection if with_film else 0.0
    for name, side in SIDES.items():
        tube = tube_of(comm, figure, side, law, cell, round_ends, deflection)
        root = gx.RigidRegion(tube, fixed_group, rigid_body=cube, name=f"root of {name}")
        items += [tube, root, gx.Pressure(tube, pressure, name=f"gas of {name}")]
        tubes[side] = tube
        if round_ends:
            plates[side] = gx.RigidRegion(tube, "ring 2", name=f"tip of {name}")
            items.append(plates[side])
    film = None
    if with_film:
        film, cables = hung_film(comm, shape, law, tension, film_cell)
        items += [film, *cables]
        ends = [cube.port_at((*shape.supports[0], 0.0)), plates[1].port(), plates[-1].port()]
        for k, end in enumerate(ends):
            # At its length under load, `CORD_LENGTH`, the cord has the force of the cut.
            stretch = float(np.linalg.norm(shape.forces[k])) / CORD
            cord = gx.connectors.Spring(
                film.port(f"corner {k}"),
                end,
                stiffness=CORD,
                length=CORD_LENGTH - stretch,
                name=f"cord {k}",
            )
            items.append(cord)
    scene = gx.Scene(*items)  # type: ignore[arg-type]
    return Satellite(tubes, film, figure, shape, gx.Equilibrium(scene))


def bending_moment_at_root(shape: Cut, figure: Figure) -> float:
    """Moment [N m] of the cord's force about the root of a tube, in its plane."""
    x0, y0 = figure.axis(1)[0]
    arm = shape.supports[1] - np.array([x0, y0])
    fx, fy = shape.forces[1]
    return abs(float(arm[0] * fy - arm[1] * fx))


def wrinkling_moment(figure: Figure, pressure: float) -> float:
    """Moment [N m] at which a round tube under a pressure [Pa] begins to wrinkle, π p r³/2."""
    return math.pi * pressure * (figure.diameter / 2) ** 3 / 2


def beam_frequency(figure: Figure, thickness: float) -> float:
    """First frequency [Hz] of a tube as a cantilever, with the mass of the stub at its tip
    (Rayleigh's quotient)."""
    EI = bending_stiffness(figure, thickness)
    mass_per_length = FILM.density * thickness * math.pi * figure.diameter
    stiffness = 3 * EI / figure.length**3
    # Without a stub this is 1.8751² √(EI/m)/(2π L²).
    own_mass = 3 / FIRST_EIGENVALUE**4 * mass_per_length * figure.length
    stub_mass = mass_per_length * stub_length(figure)
    return math.sqrt(stiffness / (own_mass + stub_mass)) / (2 * math.pi)


def tip_deflection(loaded: Satellite, unloaded: Satellite) -> float:
    """Mean deflection [m] of the tips inwards, by the film."""
    total = 0.0
    for side in SIDES.values():
        outward = np.array([side * math.cos(HALF), -math.sin(HALF), 0.0])
        total += float((unloaded.tip(side) - loaded.tip(side)) @ outward)
    return total / len(SIDES)


def mean_tensions(satellite: Satellite) -> tuple[float, float]:
    """Mean principal tensions [N/m] of the film, each cell counted once; the larger first."""
    film = satellite.film
    assert film is not None
    thickness = film.law.thickness
    means = []
    for field in ("stress1", "stress2"):
        values = gx.fields.field_values(satellite.statics, film, field=field)[1]
        total = film.comm.allreduce(float(values.sum()))
        count = film.comm.allreduce(len(values))
        means.append(thickness * total / count)
    return means[0], means[1]


def main(
    output: str | Path | None = None,
    count: int = 4,
    cell: float = 0.012,
    film_cell: float = 0.06,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Equilibrium and modes of the satellite held and free, and of a tube alone.

    Args:
        output: folder for records of the equilibrium and of the modes, and a picture; None: nothing
            is written.
        count: number of modes.
        cell, film_cell: of `build`.
        comm: communicator of the meshes.

    Returns:
        Frequencies [Hz], tensions [N/m] and deflections [m], with those of the closed forms.
    """
    alone = build(comm, cell=cell, held=True, with_film=False)
    alone.statics.find()
    tube_modes = gx.analysis.modes(alone.statics, 4)
    flat = build(comm, cell=cell, held=True, with_film=False, round_ends=False)
    # The tangent of a tube with a flat root is nearly singular: it turns about the root without any
    # resistance.
    flat.statics.find()
    flat_modes = gx.analysis.modes(flat.statics, 2)

    held = build(comm, cell=cell, film_cell=film_cell, held=True)
    held.statics.find()
    held_modes = gx.analysis.modes(held.statics, count)
    tensions = mean_tensions(held)
    free = build(comm, cell=cell, film_cell=film_cell)
    free.statics.find()
    all_modes = gx.analysis.modes(free.statics, count + RIGID_MOTIONS)
    # A free satellite has six motions without frequency; they are not vibrations.
    free_modes = [mode for mode in all_modes if mode.frequency > RIGID]
    if output is not None:
        folder = Path(output)
        recording = gx.Recording(folder / "equilibrium", title=TITLE, overwrite=True)
        gx.outputs.record(free.statics, [recording])
        records = gx.outputs.record_modes(
            free.statics, free_modes, folder / "modes", overwrite=True
        )
        if comm.rank == 0:
            gx.plot.modes(records, folder / "sprout_deployed.png", view=VIEW)
    moment = bending_moment_at_root(held.shape, held.figure)
    moment_ratio = moment / wrinkling_moment(held.figure, PRESSURE)
    mean_tube = sum(mode.frequency for mode in tube_modes) / len(tube_modes)
    return {
        "a tube alone [Hz]": mean_tube,
        "a tube alone, closed form [Hz]": beam_frequency(alone.figure, FILM_THICKNESS),
        "a tube with a flat root [Hz]": flat_modes[0].frequency,
        "deflection of the tips [m]": tip_deflection(held, alone),
        "deflection of the tips, closed form [m]": held.shape.deflection,
        "moment at the root over that of wrinkling": moment_ratio,
        "larger tension of the film [N/m]": tensions[0],
        "smaller tension of the film [N/m]": tensions[1],
        **{f"held, mode {k} [Hz]": mode.frequency for k, mode in enumerate(held_modes, start=1)},
        **{f"free, mode {k} [Hz]": mode.frequency for k, mode in enumerate(free_modes, start=1)},
    }


if __name__ == "__main__":
    print_figures(main(output="out/sprout_deployed"))
