"""Supports of any body in any direction, loads along edges, weights of attached masses, damping of
lines."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx.mesh import locate_entities

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import crossed_sheet, sheet
from tests.small_scenes import at_rest, run_until, three_sheets

E = 1e9
THICKNESS = 1e-4
LAW = gx.Linear(E, 0.0, density=1000.0, thickness=THICKNESS)
TUBE = gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0)


def bent(X):
    """A velocity that bends a line along x."""
    return np.vstack([0 * X[0], X[0] ** 2, 0 * X[0]])


def turned(comm, angle):
    """A strip of 2 m × 1 m, turned about z."""
    mesh = sheet(comm, 8, 4, 2.0, 1.0)
    X = mesh.domain.geometry.x
    c = np.cos(angle)
    s = np.sin(angle)
    X[:, :2] = X[:, :2] @ np.array([[c, s], [-s, c]])
    return mesh


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_strip_slides_in_planes_of_any_direction(comm, angle):
    """Between planes that are not x, y, z: f = E t λ ε, ε = (λ² - 1)/2, and ε across is -ν ε."""
    film = gx.Membrane(turned(comm, angle), gx.Linear(E, 0.3, density=1000.0, thickness=THICKNESS))
    e = np.array([np.cos(angle), np.sin(angle), 0.0])
    n = np.array([-np.sin(angle), np.cos(angle), 0.0])
    ends = (gx.Fixed(film, "left", normal=tuple(e)), gx.Fixed(film, "bottom", normal=tuple(n)))
    flat = [gx.Fixed(film, edge, components=(2,)) for edge in ("left", "right", "top", "bottom")]
    ε = (1.02**2 - 1) / 2
    # Force per length that stretches the strip by 2 %.
    f = E * THICKNESS * 1.02 * ε
    scene = gx.Scene(*ends, *flat, gx.loads.EdgeLoad(film, "right", normal_force=f))
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    x = gx.fields.positions(equilibrium, film)
    along = comm.allreduce(float((x @ e).max()), max)
    assert along == pytest.approx(2.04, rel=1e-8)
    measured = comm.allreduce(float((x @ n).max()), max)
    # √(1 - 2 ν ε) across.
    assert measured == pytest.approx((1 - 0.6 * ε) ** 0.5, rel=1e-8)
    force, _ = equilibrium.reaction(ends[0])
    assert force == pytest.approx(-f * e, abs=1e-6 * f)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("following", [False, True], ids=["dead", "following"])
def test_a_normal_load_pulls_along_the_film_or_as_the_mesh_was(comm, following):
    """The strip starts turned by a right angle: the load that follows pulls it along, the dead one
    turns it back."""
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    film = gx.Membrane(
        sheet(comm, 4, 2, 2.0, 1.0),
        LAW,
        displacement=lambda X: (X.T @ quarter - X.T).T,
    )
    load = gx.loads.EdgeLoad(film, "right", normal_force=lambda t: 2000.0 * t, following=following)
    run = run_until(1e-3, load, dt=1e-4)
    # Force 2e6 N/s × t on 1 m, integrated over 1 ms.
    impulse = 2000.0 * 1e-3**2 / 2
    expected = [0, impulse, 0] if following else [impulse, 0, 0]
    # The film moves by 1e-5 of its length meanwhile.
    assert run.totals.momentum == pytest.approx(expected, abs=1e-5 * impulse)
    assert abs(run.energy_error) < 1e-9


@pytest.mark.mpi
def test_a_load_on_edges_inside_the_film_counts(comm):
    mesh = sheet(comm, 4, 4)
    mesh.domain.topology.create_entities(1)
    inside = locate_entities(mesh.domain, 1, lambda X: np.isclose(X[0], 0.5))
    mesh.groups["middle"] = (1, np.sort(inside).astype(np.int32))
    film = gx.Membrane(mesh, LAW)
    held = [gx.Fixed(film, edge) for edge in ("left", "right")]
    equilibrium = at_rest(*held, gx.loads.EdgeLoad(film, "middle", force=(30.0, 0.0, 0.0)))
    total = sum(equilibrium.reaction(support)[0] for support in held)
    assert total == pytest.approx([-30.0, 0, 0], abs=1e-5)
    with pytest.raises(gx.InputError, match=r"no normal"):
        gx.loads.EdgeLoad(film, "middle", normal_force=1.0)


def test_a_load_on_a_seam_of_three_sheets_counts_once():
    film = gx.Membrane(three_sheets(), LAW, order=2)
    held = gx.Fixed(film, "seam")
    equilibrium = at_rest(film, held, gx.loads.EdgeLoad(film, "seam", force=(30.0, 0.0, 20.0)))
    force, moment = equilibrium.reaction(held)
    # The seam is 1 m long, from the origin along x.
    assert force == pytest.approx([-30.0, 0.0, -20.0], abs=1e-9)
    assert moment == pytest.approx([0.0, 10.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (
            {"force": (1.0, 0.0, 0.0), "normal_force": 1.0},
            r"force is \(1\.0, 0\.0, 0\.0\) and normal_force is 1\.0",
        ),
        ({}, "force is None and normal_force is None"),
        ({"force": (1.0, np.nan, 0.0)}, "three numbers"),
    ],
)
def test_edge_loads_that_are_none(comm, bad, words):
    film = gx.Membrane(sheet(comm, 1, 1), LAW)
    with pytest.raises(gx.InputError, match=words):
        gx.loads.EdgeLoad(film, "right", **bad)


def test_beams_and_cables_are_held_moved_and_damped_as_films_are(comm):
    """A cantilever by three supports of its ends; damping dissipates what the ledger says."""
    beam = gx.Beam(line(comm, [(0, 0, 0), (1, 0, 0)], 4), TUBE)
    pinned = gx.Fixed(beam, "start")
    lifted = gx.Fixed(
        beam,
        "end",
        motion=lambda X, t: np.vstack([0 * X[0], 0 * X[0], 0.1 * t + 0 * X[0]]),
        components=(2,),
    )
    equilibrium = gx.Equilibrium(
        gx.Scene(pinned, lifted, gx.Fixed(beam, "end", components=(1,)), gx.Gravity(beam))
    )
    equilibrium.find(at=1.0)
    assert gx.probes.Position(beam.port("end"), "z")(equilibrium) == pytest.approx(0.1)
    # kg/m × 1 m × gravity.
    weight = TUBE.line_density * 9.80665
    measured = equilibrium.reaction(pinned)[0] + equilibrium.reaction(lifted)[0]
    assert measured == pytest.approx([0, 0, weight], abs=1e-5)

    for body in (
        gx.Cable(
            line(comm, [(0, 0, 0), (1, 0, 0)], 4),
            gx.TensionOnly(1e4, 0.1),
            displacement=lambda X: 0.01 * X,
        ),
        gx.Beam(
            line(comm, [(0, 0, 0), (1, 0, 0)], 4),
            TUBE,
            velocity=lambda X: np.vstack([0 * X[0], X[0] ** 2, 0 * X[0]]),
        ),
    ):
        for damping in (
            gx.Damping(body, mass_factor=20.0),
            gx.Damping(body, stiffness_factor=1e-3),
        ):
            run = run_until(3e-3, gx.Fixed(body, "start"), damping, dt=1e-4)
            # Damping takes energy, and not all of it.
            assert 0 < run.totals.dissipated < run.first.energy
            assert abs(run.energy_error) < 1e-9


@pytest.mark.parametrize("load", ["gravity", "centrifugal"])
def test_a_tape_has_weight(comm, load):
    film = gx.Membrane(sheet(comm, 4, 4), LAW)
    tape = gx.connectors.Tape.along_edges(film, gx.CableLaw(1e4, 0.5), edges="right")
    held = [gx.Fixed(film, edge) for edge in ("left", "right")]
    field = gx.Gravity(film) if load == "gravity" else gx.loads.Centrifugal(film, (0.0, 0.0, 2.0))
    equilibrium = at_rest(tape, field, *held)
    total = sum(equilibrium.reaction(support)[0] for support in held)
    # Mass of the film of 1 m²; the tape has 0.5 kg.
    mass = 1000.0 * THICKNESS
    if load == "gravity":
        expected = [0, 0, (mass + 0.5) * 9.80665]
        assert total == pytest.approx(expected, rel=1e-6, abs=1e-6)
    else:  # of the film about (½, ½), of the tape about (1, ½); what stretching adds is small
        expected = [-4 * (mass / 2 + 0.5), -4 * (mass / 2 + 0.25), 0]
        assert total == pytest.approx(expected, rel=1e-4, abs=1e-6)


def stretched(X, t):
    """Displacement [m] of a film that becomes longer by a part of 0.01 t."""
    return 0.01 * t * np.vstack([X[0], 0 * X[0], 0 * X[0]])


@pytest.mark.mpi
def test_edges_that_share_corners_move_as_one_rim(comm):
    """Four edges with one motion are the rim with that motion, also in the work of the supports."""
    edges = ("bottom", "right", "top", "left")
    works = []
    for groups in (edges, edges[::-1], ("rim",)):
        mesh = crossed_sheet(comm, 3, 3)
        rim = np.concatenate([mesh.curve(edge, "rim") for edge in edges])
        mesh.groups["rim"] = (1, np.unique(rim).astype(np.int32))
        film = gx.Membrane(mesh, LAW)
        supports = [gx.Fixed(film, group, motion=stretched) for group in groups]
        run = run_until(0.03, film, *supports, dt=0.01)
        assert abs(run.energy_error) < 1e-10
        works.append(run.totals.supplied)
    assert works == pytest.approx([works[0]] * 3, rel=1e-11)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("other", ["held", "moved"])
def test_contradicting_supports_are_refused(comm, other: str):
    """Those that contradict at the start when the scene is compiled, others where they begin to."""
    film = gx.Membrane(sheet(comm, 2, 2), LAW)
    lift = np.array([[0.0], [0.0], [1.0]])
    moved = gx.Fixed(film, "left", motion=lambda X, t: lift * max(t - 0.02, 0.0) + 0 * X)
    motion = None if other == "held" else lambda X, t: 0 * X
    run = run_until(0.02, moved, gx.Fixed(film, "bottom", motion=motion), dt=0.01)
    with pytest.raises(gx.InputError, match=r"film/.*film/.* differ by 0.01 at t = 0.03 s"):
        run.run(until=0.05)
    from_the_start = gx.Fixed(film, "left", motion=lambda X, t: lift + 0 * X)
    with pytest.raises(gx.InputError, match="differ by 1 at t = 0 s"):
        gx.Scene(from_the_start, gx.Fixed(film, "bottom", motion=motion)).compile()


def test_a_support_of_nothing_is_refused(comm):
    mesh = sheet(comm, 2, 2)
    mesh.groups["nowhere"] = (1, np.zeros(0, dtype=np.int32))
    film = gx.Membrane(mesh, LAW)
    for support in (
        lambda: gx.Fixed(film, "nowhere"),
        lambda: gx.Fixed(film, "nowhere", motion=lambda X, t: 0 * X),
        lambda: gx.Fixed(film, "left", normal=(0.0, 0.0, 0.0)),
    ):
        with pytest.raises(gx.InputError, match=r"no node|not all zero"):
            support()


def test_supports_that_share_corners_balance_the_load_together(comm) -> None:
    """Four edges of a square hold its weight; each corner belongs to two of them."""
    film = gx.Membrane(
        sheet(comm, 4, 4), gx.Linear(E=1e7, nu=0.3, density=1000.0, thickness=1e-3), name="sheet"
    )
    edges = [gx.Fixed(film, edge) for edge in ("bottom", "right", "top", "left")]
    # In the plane of the film, where it is stiff.
    search = at_rest(film, gx.Gravity(film, (0.0, -10.0, 0.0)), *edges)
    forces = np.array([search.reaction(edge)[0] for edge in edges])
    # 1 kg of film; the weight of the corner nodes is borne, too.
    assert forces.sum(axis=0) == pytest.approx([0.0, 10.0, 0.0], rel=1e-6, abs=1e-6)
    # The pattern of triangles is not symmetric, the sheet nearly.
    assert forces[1, 1] == pytest.approx(forces[3, 1], rel=0.1)


def test_a_scene_that_is_fixed_everywhere_is_at_rest(comm):
    """Nothing can move: the supports carry the whole weight, and no equation is left to solve."""
    # One cell of 1 m: all four nodes are on the edges that are fixed.
    film = gx.Membrane(sheet(comm, 1, 1), LAW)
    supports = [gx.Fixed(film, group, name=group) for group in ("left", "right")]
    equilibrium = gx.Equilibrium(gx.Scene(*supports, gx.Gravity(film)))
    found = equilibrium.find()
    assert found.iterations == 0
    weight = 9.80665 * 1000.0 * THICKNESS
    carried = sum(equilibrium.reaction(support)[0] for support in supports)
    assert carried == pytest.approx([0.0, 0.0, weight], rel=1e-3)
