"""The arms of IKAROS are let out in days, as in flight: stage 1 as a sequence of steady spins, and
the spin of the open sail after it.

Rods on a ring let the arms out at a given rate, so slowly that hub, ring and arms rotate as one
body.  At each length the arms are in equilibrium in axes that turn with the spin: their wound parts
are in contact with the hub, the free parts with the rods, and the ring is held.  The spin is that
of the constant angular momentum L, which begins as that of 25 rpm with all of the arms wound:

    ω = L/I,    M = ½ ω² dI/dθ

with the moment of inertia I of the equilibrium, the moment M with which the ring is held, and the
angle θ of the ring against the hub.  M is computed from the forces of contact, so that its work
over the release can be compared with the energy that hub and arms lose.  The layers of the roll
have no thickness here: arms are in contact with hub and rods only.

That a release is slow enough is shown by runs that begin at one of the lengths, with the free part
of an arm on a tether that is paid out from the rim of the hub at a rate v.  The arm lags behind its
radius by the angle φ at the rim, where its tension T slows the hub down:

    4 T R sin φ = -I_hub ω',    T = ω² Σ m r,    ω' = -8 Σ m r v ω/I:    sin φ = 2 I_hub v/(I R ω)

with the radius R of the hub, and I_hub with all that is wound.  Beyond v = I R ω/(2 I_hub), some
1.1 m/s, no arm stands out steadily: about the rate of the demo `ikaros_arms`, where they turn the
hub backwards.

Where the values come from:
    masses, hub          as in the demo `ikaros`; 12 of 14 kg of the trapezoids are devices, whose
                         places were not published: `edge` is the part of the 14 kg along the outer
                         edges, the rest is spread evenly
    rate                 chosen: stage 1 began on 3 June 2010, and 7.4 rpm were reported for 6 June,
                         with arms held "a little over 5 m" out (project's blog, item 550)
    rods                 as in the demo `ikaros_arms`

    ./gossamer demo ikaros_release
    ./gossamer run demos/sails/ikaros_release.py rate=3000.0 --output out/release
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import deployment_case, print_figures, smooth_start
from demos.common.figures import BLUE, GREEN, GREY, RED, finish, new_figure, save
from demos.common.rotation_guides import RotationGuides
from demos.common.spinning import RPM, drum, laid_along, spin_figures, spin_probes, turned
from demos.sails.ikaros import (
    FLIGHT,
    HALF,
    HUB_HEIGHT,
    HUB_INERTIA,
    HUB_MASS,
    HUB_RADIUS,
    INNER,
    PETALS,
    TIP,
    half_strip,
)
from demos.sails.ikaros_arms import (
    ARM,
    ARM_RADIUS,
    CONTACT_DISTANCE,
    CONTACT_STIFFNESS,
    EA,
    RING,
    ROD,
    START,
)
from demos.sails.ikaros_arms import FLIGHT as STAGE_1
from gossamer_fx.extend import Array
from gossamer_fx.meshes.line import line

TITLE = "IKAROS, stage 1 in days: arms are let out slowly"
OPEN_SPIN = FLIGHT["open (16 June 2010)"][1]  # in flight [rpm]
DAY = 86400.0  # s
# From which day on arms are let out, and how fast [m/day].
RATE = ((0.0, 3.0),)
# Of an arm; short ones go round a rod without being caught by their corners.
CELLS = 208
LUMPS = 26  # pieces of an arm with a mass each
LIGHT = 1e-3  # line density of the cables, whose mass is in lumps [kg/m]


@dataclass(frozen=True)
class Arms:
    """How the arms are made.

    Args:
        cells: number of cells of an arm.
        edge: part of the trapezoids' mass that is along their outer edges.
        hub_inertia: of the hub about its axis [kg m²].

    Example:
        >>> round(Arms().radius, 3)
        0.788
    """

    cells: int = CELLS
    edge: float = 0.0
    hub_inertia: float = HUB_INERTIA[2]

    @property
    def cell(self) -> float:
        """Length of a cell [m]."""
        return ARM / self.cells

    @property
    def step(self) -> float:
        """Angle of a wound cell [rad], a part of a turn."""
        return 2 * math.pi / round(2 * math.pi * HUB_RADIUS / self.cell)

    @property
    def radius(self) -> float:
        """Of the corners of the roll [m]."""
        return self.cell / (2 * math.sin(self.step / 2))

    def masses(self) -> Array:
        """Masses (LUMPS + 1,) [kg] of an arm at even distances, from its knot to its tip.

        An arm is a half strip of each of two trapezoids; what is not in the arm is at the knot.
        """
        s, evenly = half_strip(PETALS / 4, (HALF, INNER))
        mass = (1 - self.edge) * evenly + self.edge * PETALS / 4 / len(s)
        lump = np.rint(np.clip(s - (HALF - ARM), 0.0, None) / ARM * LUMPS).astype(int)
        masses = np.bincount(lump, mass, LUMPS + 1)
        masses[-1] += TIP
        return masses

    def corners(self, free: int) -> Array:
        """Corners (cells + 1, 2) [m] of the first arm without strain, of which `free` cells stand
        out."""
        k = np.arange(self.cells + 1)
        last = self.cells - free
        angle = -self.step * np.minimum(k, last)
        radius = self.radius + self.cell * np.clip(k - last, 0, None)
        return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def inertia(self, free: int) -> float:
        """Moment of inertia [kg m²] of hub, ring, four arms without strain, and tips."""
        radii = np.linalg.norm(self.corners(free)[:: self.cells // LUMPS], axis=1)
        return self.hub_inertia + self.ring_inertia() + 4 * float(self.masses() @ radii**2)

    def hub_part(self, free: int) -> float:
        """Moment of inertia [kg m²] of hub, ring and what is wound of four arms."""
        wound = self.masses()[: first_free(self, free)].sum() * self.radius**2
        return self.hub_inertia + self.ring_inertia() + 4 * float(wound)

    def square_inertia(self) -> float:
        """Moment of inertia [kg m²] of hub, ring and the flat open sail with its tips."""
        evenly = 2 / 3 * (HALF**2 + INNER**2)
        along_edges = 4 / 3 * HALF**2
        film = PETALS * ((1 - self.edge) * evenly + self.edge * along_edges)
        return self.hub_inertia + self.ring_inertia() + film + 4 * TIP * 2 * HALF**2

    def ring_inertia(self) -> float:
        """Of the ring of the guides [kg m²]."""
        return RING * math.hypot(*self.rod_position(0)) ** 2

    def rod_position(self, free: int) -> tuple[float, float]:
        """(x, y) [m] of the axis of the rod of the first arm: next to the free part of the arm, and
        outside of the roll."""
        clearance = ROD + ARM_RADIUS + 1.1 * CONTACT_DISTANCE
        radial = self.radius + clearance
        across = clearance / math.cos(self.step / 2)
        angle = -self.step * (self.cells - free)
        c = math.cos(angle)
        s = math.sin(angle)
        return radial * c - across * s, radial * s + across * c


@dataclass(frozen=True)
class Quarter:
    """One arm, and a quarter of hub and ring, on an axis that is fixed in space: all four move as
    this one, and do not touch each other.

    Attributes:
        hub, guides: with a quarter of the masses.
        cables: two, whose layers may lie on each other: only cables of one `Contact` touch.
        tip: the end of the arm.
        contacts: of the cables with hub and rod.
        items: knots and masses.
    """

    hub: gx.RigidBody
    guides: RotationGuides
    cables: list[gx.Cable]
    contacts: list[gx.Contact]
    items: list[object]


def quarter(comm: MPI.Comm, arms: Arms, free: int) -> Quarter:
    """The parts without strain, `free` cells of the arm out."""
    about_axis = arms.hub_inertia / 4
    hub = gx.RigidBody(HUB_MASS / 4, (about_axis, about_axis, about_axis), name="hub", comm=comm)
    half = HUB_HEIGHT / 4
    x, y = arms.rod_position(free)
    guides = RotationGuides(
        hub,
        1,
        radius=math.hypot(x, y),
        rod_radius=ROD,
        height=2 * half,
        mass=RING / 4,
        first_angle=math.atan2(y, x),
    )
    # The cells of the roll touch the hub in their middles.
    inner_radius = arms.radius * math.cos(arms.step / 2)
    surface = drum(hub, inner_radius - ARM_RADIUS - 1.05 * CONTACT_DISTANCE, -half, half)
    law = gx.TensionOnly(EA=EA, line_density=LIGHT)
    first_turn = min(round(2 * math.pi / arms.step) - 1, arms.cells - 1)
    corners = arms.corners(free)
    end = hub.port((float(corners[0, 0]), float(corners[0, 1]), 0.0))
    cables = []
    contacts = []
    items: list[object] = []
    for begin, last in ((0, first_turn), (first_turn, arms.cells)):
        along = arms.cell * np.arange(last - begin + 1)
        cable = gx.Cable(
            line(comm, [(float(s), 0.0, 0.0) for s in along], 1),
            law,
            name=f"arm from cell {begin}",
            displacement=laid_along(corners[begin : last + 1], along),
        )
        cables.append(cable)
        items.append(
            gx.constraints.BallJoint(cable.port("start"), end, name=f"start of {cable.name}")
        )
        end = cable.port("end")
        touching = gx.Contact(
            cable,
            surface,
            *guides.rods,
            distance=CONTACT_DISTANCE,
            stiffness=CONTACT_STIFFNESS,
            radius={cable.name: ARM_RADIUS},
            name=f"contact of {cable.name}",
        )
        contacts.append(touching)
        for k, mass in enumerate(arms.masses() - LIGHT * ARM / LUMPS):
            cell = k * arms.cells // LUMPS
            if begin < cell <= last or cell == begin == 0:
                at = cable.port_at((float(along[cell - begin]), 0.0, 0.0))
                items.append(gx.connectors.AttachedMass(at, float(mass), name=f"mass {k}"))
    return Quarter(hub, guides, cables, contacts, items)


@dataclass(frozen=True)
class SteadySpin:
    """The arms at one length, in equilibrium in axes that turn with the spin.

    Attributes:
        free: number of cells that stand out.
        length: of the arms that stands out [m].
        ring_angle: of the ring against the hub from arms that are wound to their tips on [rad].
        spin: ω = L/I [rad/s].
        misfit: relative difference of the spin of the centrifugal force from it.
        inertia: I [kg m²].
        tension: the largest of the arms [N].
        moment: M, with which the ring is held [N m].
        energy: kinetic and strain energy [J].
        search: the equilibrium.
    """

    free: int
    length: float
    ring_angle: float
    spin: float
    misfit: float
    inertia: float
    tension: float
    moment: float
    energy: float
    search: gx.Equilibrium


def steady_spin(comm: MPI.Comm, arms: Arms, free: int) -> SteadySpin:
    """The equilibrium with `free` cells out, for the angular momentum of the start."""
    momentum = START * RPM * arms.inertia(0)
    # Of arms without strain that do not go round their rods, whose inertia differs by up to 1 %.
    spin = (0.0, 0.0, momentum / arms.inertia(free))
    parts = quarter(comm, arms, free)
    ring = parts.guides.ring
    ground = gx.ground_frame()
    held = gx.constraints.FixedJoint(ground, ring.frame(), name="ring held")
    bodies = [parts.hub, ring, *parts.cables, *parts.items]
    items = [*bodies, *parts.contacts, held]
    items.append(gx.constraints.FixedJoint(ground, parts.hub.frame(), name="hub held"))
    items += [gx.loads.Centrifugal(cable, spin) for cable in parts.cables]
    search = gx.Equilibrium(gx.Scene(*items))  # type: ignore[arg-type]
    search.find(progress=False)
    start = (gx.StartFrom(search.system), gx.RigidMotion(spin=spin))
    turning = gx.Simulation(gx.Scene(*bodies, *start), gx.Midpoint(dt=1e-3))  # type: ignore[arg-type]
    inertia = 4 * float(turning.first.angular_momentum[2]) / spin[2]
    found = momentum / inertia
    # The shape hardly depends on the spin, as strains are 1e-3: forces are in proportion to ω².
    factor = (found / spin[2]) ** 2
    tensions = [gx.probes.Tension(cable, "largest")(search) for cable in parts.cables]
    return SteadySpin(
        free=free,
        length=arms.cell * free,
        ring_angle=arms.step * free,
        spin=found,
        misfit=abs(spin[2] / found - 1),
        inertia=inertia,
        tension=factor * max(tensions),
        moment=-4 * factor * float(search.joint_force(held)[1][2]),
        energy=inertia * found**2 / 2 + 4 * sum(search.totals.stored.values()),
        search=search,
    )


def build(
    comm: MPI.Comm,
    free: int = 104,
    rate: float = 3.0,
    edge: float = 0.0,
    hub_inertia: float = HUB_INERTIA[2],
    until: float = 60.0,
    dt: float = 0.1,
) -> gx.Case:
    """A quarter of the motion that begins with a steady spin and `free` of 208 cells out, while the
    free part of the arm is let out.

    Args:
        rate: of the arms [m/day], from a third of the time on; it grows until then.
        edge, hub_inertia: as of `Arms`.
    """
    made = Arms(edge=edge, hub_inertia=hub_inertia)
    hub, cable, items = hanging_arm(comm, made, free, lambda t: rate / DAY * let_out(t, until))
    spin = (0.0, 0.0, START * RPM * made.inertia(0) / made.inertia(free))
    steady = gx.Equilibrium(
        gx.Scene(
            *items,  # type: ignore[arg-type]
            gx.loads.Centrifugal(cable, spin),
            gx.constraints.FixedJoint(gx.ground_frame(), hub.frame(), name="hub held"),
        )
    )
    steady.find(progress=False)
    items.append(gx.constraints.RevoluteJoint(gx.ground_frame(), hub.frame(), axis=(0.0, 0.0, 1.0)))
    items += [gx.StartFrom(steady.system), gx.RigidMotion(spin=spin)]
    probes = {
        **spin_probes(hub, None, [cable.port("end")], "rpm"),
        "angle of the first mass [rad]": gx.probes.PolarPosition(
            cable.port("start"), hub.frame(), quantity="angle"
        ),
    }
    return deployment_case(items, TITLE, probes, until, gx.StepControl(max_step=dt), dt)


def hanging_arm(
    comm: MPI.Comm, arms: Arms, free: int, paid_out: Callable[[float], float]
) -> tuple[gx.RigidBody, gx.Cable, list[object]]:
    """A quarter of the hub with what is wound on it, the free part of an arm on a tether, and all
    items of their scene; `paid_out` is the length [m] that is let out by a time [s]."""
    masses = arms.masses()
    first = first_free(arms, free)
    wound = arms.hub_part(free) / 4
    hub = gx.RigidBody(HUB_MASS / 4, (wound, wound, wound), name="hub", comm=comm)
    pitch = ARM / LUMPS
    radii = arms.radius + pitch * np.arange(1, len(masses) - first + 1)
    cable = gx.Cable(
        line(comm, [(float(r), 0.0, 0.0) for r in radii], 1),
        gx.TensionOnly(EA=EA, line_density=LIGHT),
        name="arm",
    )
    tether = gx.connectors.Tether(
        hub.port((arms.radius, 0.0, 0.0)),
        cable.port("start"),
        stiffness=EA / pitch,
        length=lambda t: pitch + paid_out(t),
    )
    items: list[object] = [hub, cable, tether]
    for k, (r, mass) in enumerate(zip(radii, masses[first:], strict=True)):
        at = cable.port_at((float(r), 0.0, 0.0))
        items.append(gx.connectors.AttachedMass(at, float(mass), name=f"mass {k}"))
    return hub, cable, items


def first_free(arms: Arms, free: int) -> int:
    """Number of the first lump of an arm that stands out."""
    return LUMPS - free * LUMPS // arms.cells + 1


def let_out(t: float, until: float) -> float:
    """Length over the final rate [s] that is let out by the time t: the rate grows smoothly in the
    first third of a run."""
    return smooth_start(t, ramp=until / 3)


def window(
    comm: MPI.Comm, arms: Arms, free: int, rate: float, until: float = 60.0, dt: float = 0.1
) -> dict[str, float]:
    """The motion from a steady spin on, while arms are let out at a rate [m/s].

    Returns the fall of the spin over that of steady spins, the mean angle φ of the last third of
    the run [rad] and over that of the closed form, and the errors of the balances.
    """
    case = build(comm, free, rate * DAY, arms.edge, arms.hub_inertia, until, dt)
    run = case.simulation([series := gx.Series(case.probes)])
    run.run(until=until)
    masses = arms.masses()[first_free(arms, free) :]
    pitch = ARM / LUMPS
    first_length = pitch + rate * np.array([let_out(t, until) for t in series.time])
    radii = arms.radius + first_length + pitch * np.arange(len(masses))[:, None]
    inertia = arms.hub_part(free) + 4 * masses @ radii**2
    spin = series["spin of the hub [rpm]"] * RPM
    # From the angle at the axis to that at the rim.
    lag = -series["angle of the first mass [rad]"] * (arms.radius + first_length) / first_length
    predicted = 2 * arms.hub_part(free) * rate / (inertia * arms.radius * spin)
    late = series.time > 2 / 3 * until
    figures = spin_figures(run, series)
    return {
        "fall": float((1 - spin[-1] / spin[0]) / (1 - inertia[0] / inertia[-1])),
        "lag": float(lag[late].mean()),
        "lag_ratio": float(lag[late].mean() / predicted[late].mean()),
        "energy_error": figures["energy_error"],
        "angular_momentum_drift": figures["angular_momentum_drift"],
        "rejected": figures["rejected"],
        "steps": figures["steps"],
    }


def day_of(length: float, rate: Sequence[tuple[float, float]] = RATE) -> tuple[float, float]:
    """Day on which a length [m] is out, and the rate then [m/day], by a table like `RATE`."""
    days = np.array([day for day, _ in rate])
    speeds = np.array([speed for _, speed in rate])
    lengths = np.concatenate([[0.0], np.cumsum(np.diff(days) * speeds[:-1])])
    k = int(np.searchsorted(lengths, length, side="right")) - 1
    return float(days[k] + (length - lengths[k]) / speeds[k]), float(speeds[k])


def main(
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    arms: Sequence[Arms] = (Arms(), Arms(edge=0.3, hub_inertia=70.0)),
    free: Sequence[int] = tuple(range(8, CELLS, 16)),
    rate: Sequence[tuple[float, float]] = RATE,
    windows: Sequence[tuple[int, float]] = (),
) -> dict[str, float]:
    """Let the arms out.  With `output`, a folder: a picture.

    Args:
        arms: ways in which they are made; windows and the work of the ring are of the first one.
        free: numbers of cells that stand out.
        rate: table of days and rates [m/day].
        windows: runs from the state of this index on, at so many times the rate of the table.

    Returns for each of the arms the spin [rpm] with 5.2 m out, with all of them out and of the open
    sail; the moments of inertia [kg m²] that the spins of the flight would need; the work of the
    ring [J], the energy that is lost, and what `window` returns.
    """
    releases = [[steady_spin(comm, made, k) for k in free] for made in arms]
    found: dict[str, float] = {}
    for made, states in zip(arms, releases, strict=True):
        momentum = START * made.inertia(0)
        name = f"edge {made.edge:g}, hub {made.hub_inertia:g}"
        lengths = np.array([state.length for state in states])
        spins = np.array([state.spin / RPM for state in states])
        for length in (STAGE_1[1][0], 5.5, lengths[-1]):
            found[f"{name}: spin with {length:.3g} m"] = float(np.interp(length, lengths, spins))
        found[f"{name}: spin of the open sail"] = momentum / made.square_inertia()
        for rpm in (STAGE_1[1][1], OPEN_SPIN):
            found[f"{name}: inertia for {rpm:g} rpm"] = momentum / rpm
        found[f"{name}: inertia of the open sail"] = made.square_inertia()
        found[f"{name}: inertia with {lengths[-1]:.3g} m"] = states[-1].inertia
        found[f"{name}: misfit"] = max(state.misfit for state in states)
    states = releases[0]
    angles = np.array([state.ring_angle for state in states])
    moments = np.array([state.moment for state in states])
    found["work_of_the_ring"] = float(np.trapezoid(moments, angles))
    found["energy_lost"] = states[0].energy - states[-1].energy
    for k, factor in windows:
        speed = day_of(states[k].length, rate)[1] * factor / DAY
        of_window = window(comm, arms[0], free[k], speed)
        for name, value in of_window.items():
            found[f"{states[k].length:.3g} m, {speed:.2g} m/s: {name}"] = value
    if output is not None:
        draw(arms, releases, rate, Path(output) / "ikaros_release.png")
    return found


def draw(
    arms: Sequence[Arms],
    releases: Sequence[Sequence[SteadySpin]],
    rate: Sequence[tuple[float, float]],
    path: Path,
) -> None:
    """The arms from above; spin, tension and moment over the length."""
    states = releases[0]
    looks = [states[k] for k in np.linspace(0, len(states) - 1, 5).astype(int)]
    shapes = []
    for state in looks:
        cables = [
            body for body in state.search.system.unknowns.bodies if isinstance(body, gx.Cable)
        ]
        lines = [gx.fields.line_values(state.search, cable).points[:, :2] for cable in cables]
        shapes.append(np.concatenate(lines))
    if states[0].search.comm.rank != 0:
        return
    figure = new_figure(12.0, 6.4)
    above, below = figure.subfigures(2, 1, height_ratios=(1.0, 1.4))
    for axes, state, shape in zip(above.subplots(1, len(looks)), looks, shapes, strict=True):
        circle = np.linspace(0.0, 2 * math.pi, 60)
        axes.plot(HUB_RADIUS * np.cos(circle), HUB_RADIUS * np.sin(circle), color=GREY)
        for k in range(4):
            arm = turned(shape, math.pi / 2 * k)
            axes.plot(arm[:, 0], arm[:, 1], color=BLUE, linewidth=1)
            axes.plot(*arm[-1], "o", color="black", markersize=3)
        day = day_of(state.length, rate)[0]
        axes.set(xlim=(-8, 8), ylim=(-8, 8), aspect="equal", xticks=[], yticks=[])
        axes.set_title(f"day {day:.1f}: {state.spin / RPM:.1f} rpm", fontsize=9)
    left, middle, right = below.subplots(1, 3)
    for made, of_arms, colour in zip(arms, releases, (BLUE, RED, GREEN), strict=False):
        length = [state.length for state in of_arms]
        label = f"hub {made.hub_inertia:g} kg m², {made.edge:.0%} at the edges"
        left.plot(length, [state.spin / RPM for state in of_arms], color=colour, label=label)
        open_spin = START * made.inertia(0) / made.square_inertia()
        left.plot(HALF, open_spin, "s", color=colour, markersize=5)
    for length_out, rpm in STAGE_1:
        left.plot(length_out, rpm, "o", color="black", label="flight" if length_out else None)
    left.plot(HALF, OPEN_SPIN, "o", color="black")
    left.annotate("open ", (HALF, OPEN_SPIN), ha="right", va="center", fontsize=8)
    length = [state.length for state in states]
    middle.plot(length, [state.tension for state in states], color=BLUE)
    right.plot(length, [state.moment for state in states], "o", color=BLUE, label="contact")
    angle = np.array([state.ring_angle for state in states])
    by_inertia = np.gradient([state.inertia for state in states], angle, edge_order=2)
    power = [state.spin**2 / 2 * slope for state, slope in zip(states, by_inertia, strict=True)]
    right.plot(length, power, "--", color=GREY, label="½ ω² dI/dθ")
    finish(left, "length of the arms that is out [m]", "spin [rpm]")
    finish(middle, "length of the arms that is out [m]", "largest tension [N]")
    finish(right, "length of the arms that is out [m]", "moment that holds the ring [N m]")
    save(figure, path, TITLE)


# Units of the figures.
UNITS = {"work_of_the_ring": "J", "energy_lost": "J"}

# Numbers of states, and factors on the rate of the table.
WINDOWS = ((6, 1.0), (11, 1.0), (6, 100.0), (6, 1000.0))

if __name__ == "__main__":
    print_figures(main("out/ikaros_release", windows=WINDOWS), UNITS)
