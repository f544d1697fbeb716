"""Scenes that can be computed, but are not what was meant: each is refused or warned of in one
sentence."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest
from dolfinx import mesh as dmesh
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.mesh.quality import folded_in_plane
from gossamer_fx.extend import Group, Item
from gossamer_fx.mechanics.contact.obstacles import Obstacle, ObstacleBoundary, ObstacleSolid
from gossamer_fx.mechanics.gas.enclosure import label_components
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.meshes.tube import flat_tube
from tests.small_scenes import at_rest

LAW = gx.Linear(2.5e9, 0.34, density=1420.0, thickness=25e-6)
DISTANCE = 1e-3


def film(comm: MPI.Intracomm, name: str = "film") -> gx.Membrane:
    return gx.Membrane(sheet(comm, 4, 4), LAW, name=name)


def compiled(*items: Any) -> gx.Simulation:
    return gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=1e-4))


# ---- contact -------------------------------------------------------------------------------------


def contact_with_plane(sail: gx.Membrane, height: float, name: str) -> gx.Contact:
    """Contact of a sail with a plane below or above it."""
    normal = (0.0, 0.0, -np.sign(height))
    plane = gx.contact.Plane(point=(0.0, 0.0, height), normal=normal, name=f"plane of {name}")
    return gx.Contact(sail, plane, distance=DISTANCE, name=name)


@pytest.mark.mpi
def test_the_same_contact_twice_is_refused(comm) -> None:
    sail = film(comm)
    first, second = (contact_with_plane(sail, -0.1, name) for name in ("first", "second"))
    with pytest.raises(gx.InputError, match="'first' and 'second' are"):
        compiled(first, second)
    # a contact of which all is in another one
    with pytest.raises(gx.InputError, match="leave one of them out"):
        compiled(first, gx.Contact(sail, distance=DISTANCE, name="of the sail"))


def test_two_contacts_of_one_film_are_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    sail = film(MPI.COMM_SELF)
    with caplog.at_level(logging.WARNING):
        compiled(contact_with_plane(sail, -0.1, "first"), contact_with_plane(sail, 0.1, "second"))
    assert "'first' and 'second' both keep 'film' apart from itself" in caplog.text


def test_an_own_item_can_warn_of_a_scene(comm, caplog: pytest.LogCaptureFixture) -> None:
    class Lamp(Group):
        name = "lamp"

        def warnings(self, items: Iterable[Item]) -> Iterable[str]:
            yield f"'lamp' shines on {[item.name for item in items if item is not self]}."

    with caplog.at_level(logging.WARNING):
        gx.Scene(film(comm), Lamp()).compile()
    assert "'lamp' shines on ['film']" in caplog.text


@pytest.mark.mpi
def test_a_box_around_all_of_a_film_is_refused(comm) -> None:
    sail = film(comm)
    centre = (0.5, 0.5, 0.0)
    around = gx.contact.Box(centre=centre, sizes=(3.0, 3.0, 3.0), name="bus")
    with pytest.raises(gx.InputError, match=r"25 points of 'film' .* inside the obstacle 'bus'"):
        compiled(gx.Contact(sail, around, distance=DISTANCE))
    room = gx.contact.Box(centre=centre, sizes=(3.0, 3.0, 3.0), inside=True)
    beside = gx.contact.Box(centre=(0.5, 0.5, 0.5), sizes=(3.0, 3.0, 0.5))
    compiled(gx.Contact(sail, room, beside, distance=DISTANCE))


@dataclass(frozen=True, eq=False, kw_only=True)
class Faces(Obstacle):
    """An obstacle of the test: triangles between points [m]."""

    points: np.ndarray
    triangles: tuple[tuple[int, int, int], ...]

    def parts(self) -> tuple[list[ObstacleBoundary], list[ObstacleSolid]]:
        pairs = {tuple(sorted(pair)) for t in self.triangles for pair in combinations(t, 2)}
        corners = tuple(self.fixed_point(point) for point in self.points)
        return [], [ObstacleSolid(corners, tuple(sorted(pairs)), self.triangles)]


def square_torus(around: int = 12) -> Faces:
    """A ring of square section about the z axis of (0.5, 0.5), from 2 to 3 m from it."""
    angles = 2 * np.pi * np.arange(around) / around
    section = [(2.0, -0.5), (3.0, -0.5), (3.0, 0.5), (2.0, 0.5)]
    points = [
        (0.5 + r * np.cos(angle), 0.5 + r * np.sin(angle), z)
        for angle in angles
        for r, z in section
    ]
    triangles = []
    for i, k in product(range(around), range(4)):
        a, b = 4 * i + k, 4 * i + (k + 1) % 4
        c, d = (a + 4) % (4 * around), (b + 4) % (4 * around)
        # Their orders of corners differ on purpose.
        triangles += [(a, b, c), (d, c, b)] if i % 2 else [(b, a, c), (c, d, b)]
    return Faces(points=np.array(points), triangles=tuple(triangles), name="ring")


@pytest.mark.mpi
def test_a_film_may_lie_in_the_hole_of_a_ring_or_near_an_open_face(comm) -> None:
    compiled(gx.Contact(film(comm), square_torus(), distance=DISTANCE))
    corners = np.array([(-1.0, -1.0, 0.3), (2.0, -1.0, -0.3), (2.0, 2.0, -0.2), (-1.0, 2.0, 0.4)])
    for side in (-1.0, 1.0):
        face = Faces(
            points=np.add(corners, (0, 0, side)), triangles=((0, 1, 2), (3, 2, 0)), name="face"
        )
        compiled(gx.Contact(film(comm), face, distance=DISTANCE))


@pytest.mark.mpi
def test_a_film_within_a_ring_is_refused(comm) -> None:
    sail = gx.Membrane(
        sheet(comm, 4, 4, 0.2, 0.2),
        LAW,
        displacement=lambda X: np.tile([[2.9], [0.4], [0.0]], X.shape[1]),
        name="film",
    )
    with pytest.raises(gx.InputError, match=r"25 points of 'film' .* inside the obstacle 'ring'"):
        compiled(gx.Contact(sail, square_torus(), distance=DISTANCE))


# ---- plates --------------------------------------------------------------------------------------


def test_a_hinge_group_given_twice_is_refused() -> None:
    mesh = sheet(MPI.COMM_SELF, 4, 4)
    edges = dmesh.locate_entities(mesh.domain, 1, lambda X: np.isclose(X[0], 0.5))
    hinged = Mesh(mesh.domain, mesh.groups | {"line": (1, np.sort(edges))})
    gx.Plate(hinged, LAW, hinges=["line"])
    with pytest.raises(gx.InputError, match="hinge group 'line' is given twice; give it once"):
        gx.Plate(hinged, LAW, hinges=["line", "line"])


def along_y(X: np.ndarray, t: float) -> np.ndarray:
    return np.tile([[0.0], [1.0], [0.0]], X.shape[1])


@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (0.0, -2.0, 0.1), along_y])
def test_a_clamped_edge_with_a_direction_along_it_is_refused(comm, direction: Any) -> None:
    plate = gx.Plate(sheet(comm, 4, 4), LAW)
    with pytest.raises(
        gx.InputError, match=r"'plate/left clamped': .* lies along the edge at \(0, "
    ):
        compiled(gx.Fixed(plate, "left", direction=direction))


def test_a_clamped_edge_may_have_an_oblique_direction(comm) -> None:
    plate = gx.Plate(sheet(comm, 4, 4), LAW)
    compiled(gx.Fixed(plate, "left", direction=(-1.0, 0.5, 1.0)))


def stiffness_of_cantilever(aspect: float, thickness: float) -> float:
    """Stiffness over exact of a strip of unit length, clamped at x = 0, with eight columns of
    cells."""
    width = 1 / 8 / aspect
    law = gx.Linear(1e9, 0.0, density=1000.0, thickness=thickness)
    plate = gx.Plate(sheet(MPI.COMM_SELF, 8, 1, 1.0, width), law, name=f"{aspect} {thickness}")
    deflection = 1e-3
    line_force = 3 * 1e9 * thickness**3 / 12 * deflection
    load = gx.loads.EdgeLoad(plate, "right", force=(0.0, 0.0, line_force))
    equilibrium = at_rest(plate, load, gx.Fixed(plate, "left", rotation=True))
    tip = plate.nodes("right")
    return float(deflection / equilibrium.system.unknowns.q0.array_r.reshape(-1, 3)[tip, 2].mean())


@pytest.mark.parametrize(("aspect", "thickness"), [(1, 1e-2), (1, 1e-6), (30, 1e-5), (100, 1e-4)])
def test_thin_plates_and_oblong_cells_are_right(
    aspect: float, thickness: float, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        stiffness = stiffness_of_cantilever(aspect, thickness)
    assert stiffness == pytest.approx(1.0, rel=0.01)
    assert "may be too stiff" not in caplog.text


@pytest.mark.parametrize(("aspect", "thickness"), [(1000, 1e-5), (30, 1e-7), (1, 1e-8)])
def test_a_plate_whose_bending_is_below_round_off_is_warned_of(
    aspect: float, thickness: float, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        stiffness = stiffness_of_cantilever(aspect, thickness)
    assert abs(stiffness) > 100
    assert "bending forces are less than the round-off of its membrane forces" in caplog.text
    assert "The equilibrium does not show the loads" in caplog.text


def test_a_film_without_a_visible_load_is_not_called_a_plate(
    caplog: pytest.LogCaptureFixture,
) -> None:
    sail = film(MPI.COMM_SELF)
    edges = [gx.Fixed(sail, edge) for edge in EDGES]
    with caplog.at_level(logging.WARNING):
        at_rest(sail, *edges, gx.Gravity(sail, (0.0, 0.0, -1e-13)))
    assert "The equilibrium does not show the loads" in caplog.text
    assert "units of the loads" in caplog.text
    assert "plate" not in caplog.text
    # Its edges are fixed already; what resists is tension.
    assert "slack, without stiffness against translation z" in caplog.text


@pytest.mark.mpi
@pytest.mark.parametrize(("factor", "warns"), [(1.0, True), (0.3, False)])
def test_positions_in_place_of_a_displacement_are_warned_of(
    comm: MPI.Intracomm, factor: float, warns: bool, caplog: pytest.LogCaptureFixture
) -> None:
    name = f"stretched {factor}"
    with caplog.at_level(logging.WARNING):
        compiled(gx.Membrane(sheet(comm, 6, 6), LAW, displacement=lambda X: factor * X, name=name))
    expected = f"displacement of '{name}' stretches it to 2 times its size"
    assert (expected in caplog.text) == (warns and comm.rank == 0)


CURVATURE = np.diag((0.5, 0.0, 0.0))
COMPLEX = {
    "array": CURVATURE * (1 + 1e-3j),
    "list": (CURVATURE * (1 + 1e-3j)).tolist(),
    "function": lambda X: (CURVATURE * (1 + 1e-3j))[..., None] * np.ones(X.shape[1]),
    "words": lambda X: "flat",
    "words in an array": lambda X: np.full((3, 3, X.shape[1]), "0.1"),
}


@pytest.mark.parametrize("given", list(COMPLEX))
def test_a_rest_curvature_that_is_not_real_is_refused(comm, given: str) -> None:
    with pytest.raises(gx.InputError, match=r"rest_curvature .* numbers"):
        gx.Plate(sheet(comm, 4, 4), LAW, rest_curvature=COMPLEX[given])


def test_a_complex_motion_is_refused() -> None:
    """NumPy would drop the imaginary part with no more than a warning."""
    sail = film(MPI.COMM_SELF)
    held = gx.Fixed(sail, "left", motion=lambda X, t: 0j * X)
    with pytest.raises(gx.InputError, match=r"film/left moved .* it must return finite numbers"):
        compiled(held)


# ---- bags ----------------------------------------------------------------------------------------


# Corners of a cube about the origin, the bits of their number being their signs; triangles with
# outward normals.
CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
OUTWARD = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def two_cubes(comm: MPI.Intracomm, offset: float, size: float, inside_out: bool) -> Mesh:
    """A unit cube at the origin, and one with edges of `size` [m] about (offset, 0, 0)."""
    points = np.vstack([CUBE, size * CUBE + [offset, 0.0, 0.0]])
    second = OUTWARD[:, ::-1] if inside_out else OUTWARD
    triangles = np.vstack([OUTWARD, second + len(CUBE)])
    return mesh_of_arrays(comm, lambda: (points, triangles, {}))


def bag(mesh: Mesh) -> gx.Simulation:
    air = gx.IdealGas(R=287.0, gamma=1.4)
    skin = gx.Membrane(mesh, LAW, name="bag")
    return compiled(gx.Chamber(skin, gas=air, pressure=1.0, temperature=300.0))


@pytest.mark.mpi(1)
@pytest.mark.parametrize("size", [1.0, 0.5])
def test_a_bag_of_which_one_part_is_inside_out_is_refused(comm, size: float) -> None:
    cubes = two_cubes(comm, 3.0, size, inside_out=True)
    with pytest.raises(gx.InputError, match="one of the 2 components of 'bag' is inside out"):
        bag(cubes)


@pytest.mark.mpi
def test_parts_with_normals_on_one_side_add_their_volumes(comm) -> None:
    run = bag(two_cubes(comm, 3.0, 0.5, inside_out=False))
    (state,) = run.chambers.values()
    assert state.volume == pytest.approx(1.125, rel=1e-12)


def test_a_hollow_part_is_no_defect(comm) -> None:
    run = bag(two_cubes(comm, 0.0, 0.5, inside_out=True))
    (state,) = run.chambers.values()
    assert state.volume == pytest.approx(0.875, rel=1e-12)


@pytest.mark.mpi
def test_parts_are_labelled_alike_on_all_ranks(comm) -> None:
    mesh = two_cubes(comm, 3.0, 1.0, inside_out=False)
    domain = mesh.domain
    table = mesh.edges
    index_map = domain.topology.index_map(2)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    labels = label_components(table, cells)
    x = domain.geometry.x[geometry_nodes(domain)[:, :3]].mean(axis=1)[:, 0]
    of_first = comm.allgather(np.unique(labels[x < 1.5]).tolist())
    of_second = comm.allgather(np.unique(labels[x > 1.5]).tolist())
    first = {label for part in of_first for label in part}
    second = {label for part in of_second for label in part}
    assert len(first) == len(second) == 1
    assert first.isdisjoint(second)


# ---- meshes that are folded over -----------------------------------------------------------------


def moved(comm: MPI.Intracomm, move: Callable[[np.ndarray], np.ndarray]) -> Mesh:
    mesh = sheet(comm, 8, 8)
    mesh.domain.geometry.x[:] = move(mesh.domain.geometry.x)
    return mesh


def overlap(X: np.ndarray) -> np.ndarray:
    """A column of nodes is moved across the next one."""
    x = X.copy()
    x[np.isclose(X[:, 0], 0.5), 0] = 0.65
    return x


@pytest.mark.mpi
def test_cells_folded_over_in_the_plane_are_warned_of(comm, caplog) -> None:
    mesh = moved(comm, overlap)
    count, share = folded_in_plane(mesh.edges)
    # one column of sixteen triangles between x = 0.5, now 0.65, and 0.625: 0.025 wide of 1.05 in
    # all
    assert count == 16
    assert share == pytest.approx(0.025 / 1.05, rel=1e-9)
    with caplog.at_level(logging.WARNING):
        compiled(gx.Membrane(mesh, LAW, name="folded film"))
    if comm.rank == 0:
        assert "'folded film' has 16 triangles upside down in its plane" in caplog.text


@pytest.mark.mpi
def test_a_sound_sheet_a_tube_pressed_flat_and_a_box_are_not_folded_over(comm) -> None:
    turned = moved(comm, lambda X: X[:, [1, 0, 2]])
    for mesh in (
        sheet(comm, 8, 8),
        turned,
        flat_tube(comm, 1.0, 0.2, 6),
        two_cubes(comm, 3.0, 1.0, inside_out=False),
    ):
        assert folded_in_plane(mesh.edges) == (0, 0.0)


# ---- motions -------------------------------------------------------------------------------------


def driven(comm: MPI.Intracomm, spin: float, rate: float) -> gx.constraints.Driven:
    """A motor of 10 rad/s, times `rate`, on a hub that spins [rad/s]."""
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), spin=(0.0, 0.0, spin), comm=comm)
    return gx.constraints.Driven(hub, (0.0, 0.0, 1.0), angle=lambda t: 10.0 * rate * t)


def lifted(comm: MPI.Intracomm, height: Callable[[float], float]) -> gx.Fixed:
    """A film whose left edge, on one rank perhaps none of the edge, rises to a height [m] of t."""
    return gx.Fixed(film(comm), "left", motion=lambda X, t: 0 * X + [[0], [0], [height(t)]])


@pytest.mark.mpi
@pytest.mark.parametrize(("dt", "rejected"), [(0.3, 0), (0.4, 1), (0.8, 3)])
def test_a_step_of_half_a_turn_or_more_is_divided(comm, dt: float, rejected: int) -> None:
    """Both ends of a step of 4 rad would be those of 2.3 rad backwards."""
    motor = driven(comm, 10.0, 1.0)
    run = gx.Simulation(gx.Scene(motor), gx.Midpoint(dt=dt))
    run.run(until=dt)
    assert run.substeps == rejected
    assert gx.probes.AngularMomentum(axis="z")(run) > 10.0


def test_a_motor_that_jumps_is_named(comm) -> None:
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=comm)
    motor = gx.constraints.Driven(hub, (0.0, 0.0, 1.0), angle=lambda t: 4.0 * (t > 0))
    run = gx.Simulation(gx.Scene(motor), gx.Midpoint(dt=0.1))
    with pytest.raises(gx.StepFailure, match=r"'motor' turns by 4 rad .*; give a shorter dt"):
        run.run(until=0.1)


def test_a_step_that_twists_a_beam_by_half_a_turn_or_more_is_divided(comm) -> None:
    section = gx.sections.tube(0.02, 5e-4, E=1e6, nu=0.3, density=1560.0)
    beam = gx.Beam(line(comm, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], 2), section)
    turned = gx.Fixed(beam, "start", twist=lambda t: 10.0 * t)
    run = gx.Simulation(gx.Scene(turned), gx.Midpoint(dt=0.4))
    run.run(until=0.4)
    assert run.substeps == 1


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("make", "is_sudden"),
    [
        (lambda comm: driven(comm, 0.0, 1.0), True),
        (lambda comm: driven(comm, 10.0, 0.0), True),
        (lambda comm: driven(comm, 10.0, 1.0), False),
        (lambda comm: driven(comm, 0.0, 0.0), False),
        (lambda comm: lifted(comm, lambda t: 2.0 * t), True),
        (lambda comm: lifted(comm, lambda t: 1e-6 * (t > 0)), True),
        (lambda comm: lifted(comm, lambda t: 50.0 * t**2), False),
        (lambda comm: lifted(comm, lambda t: 1e-3 * np.sin(30 * t) ** 2), False),
        (lambda comm: lifted(comm, lambda t: 0.0), False),
    ],
)
def test_a_motion_that_begins_at_another_rate_is_warned_of(comm, caplog, make, is_sudden) -> None:
    """The midpoint rule keeps the mean of both velocities of a step: 0 and 20 rad/s of 10."""
    support = make(comm)
    with caplog.at_level(logging.WARNING):
        run = compiled(support)
        run.run(until=1e-4)
        run.run(until=2e-4)
    warned = caplog.text.count("begins at another rate than the velocity of its body")
    if comm.rank == 0:
        assert warned == is_sudden


@pytest.mark.mpi
@pytest.mark.parametrize("what", ["motor", "edge", "smooth", "equilibrium"])
def test_a_motion_that_begins_elsewhere_than_its_body_is_warned_of(comm, caplog, what) -> None:
    """A support that jumps in the first step gives a velocity that grows as steps shrink."""
    if what == "motor":
        hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), spin=(0.0, 0.0, 10.0), comm=comm)
        support: Any = gx.constraints.Driven(hub, (0, 0, 1), angle=lambda t: 0.5 + 10.0 * t)
    elif what == "edge":
        support = lifted(comm, lambda t: 0.01)
    elif what == "smooth":
        support = lifted(comm, lambda t: 1e-3 * np.sin(30 * t) ** 2)
    else:
        # The run begins where the motion of the equilibrium has ended, and not where its own does.
        support = lifted(comm, lambda t: 0.01 * t)
        held = gx.Fixed(support.body, "right")
        stretched = gx.Equilibrium(gx.Scene(support, held))
        stretched.find(at=1.0)
    with caplog.at_level(logging.WARNING):
        caplog.clear()
        start = [] if what != "equilibrium" else [held, gx.StartFrom(stretched.system)]
        compiled(support, *start).run(until=1e-4)
    warned = caplog.text.count("begins elsewhere than its body")
    if comm.rank == 0:
        assert warned == (what != "smooth")
        assert "another rate" not in caplog.text


Z = (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("joint", "axis", "is_suspect"),
    [
        (gx.constraints.RevoluteJoint, Z, False),
        (gx.constraints.CylindricalJoint, (0, 0, -2), False),
        (gx.constraints.RevoluteJoint, (0, 1e-3, 1), True),
        (None, Z, True),
    ],
)
def test_a_torsional_spring_without_its_hinge_is_warned_of(caplog, joint, axis, is_suspect) -> None:
    """Where one side leans, its moment has not the work of its energy: that changes by 6e-6."""
    hub = gx.RigidBody(1.0, (1.0, 1.2, 1.5), name=f"hub {joint} {axis}")
    sides = (gx.ground_frame(), hub.frame())
    name = f"spring of {hub.name}"
    spring = gx.connectors.TorsionSpring(*sides, axis=Z, stiffness=4.0, name=name)
    hinge = [] if joint is None else [gx.constraints.HoldDown(joint(*sides, axis=axis))]
    with caplog.at_level(logging.WARNING):
        compiled(spring, *hinge)
    assert (f"'{name}' acts about the axis" in caplog.text) == is_suspect


# ---- order 2 -------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
def test_order_2_on_plane_triangles_of_a_curved_surface_is_warned_of(comm, caplog, order) -> None:
    sail = gx.Membrane(sphere(comm, 1.0, 6), LAW, order=order, name="balloon")
    compiled(sail)
    is_warned = "is of order 2 on a curved mesh of plane triangles" in caplog.text
    assert is_warned == (order == 2)


def test_order_2_on_a_plane_mesh_is_not_warned_of(comm, caplog) -> None:
    compiled(gx.Membrane(sheet(comm, 4, 4), LAW, order=2))
    assert "curved mesh" not in caplog.text
