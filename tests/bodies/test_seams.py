"""Seams draw edges of films together, their work counts as supplied, and then they are ties."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.bodies.edge_lines import edge_line
from gossamer_fx.mechanics.constraints.tie import Seam
from gossamer_fx.meshes.disc import ring
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

COMM = MPI.COMM_WORLD
FILM = gx.Linear(E=1e6, nu=0.3, density=1000.0, thickness=1e-3)
SOFT = gx.Miyazaki(E=1e6, nu=0.3, density=1000.0, thickness=1e-3)


def panel(
    name: str, shift: float, cells: int = 4, order: int = 1, height: float = 0.1
) -> gx.Membrane:
    """A sheet of 0.2 m x `height`, moved along x."""
    return gx.Membrane(
        sheet(COMM, 4, cells, 0.2, height),
        FILM,
        order=order,
        name=name,
        displacement=lambda X: np.vstack([shift + 0 * X[0], 0 * X[0], 0 * X[0]]),
    )


def distance_of_edges(run: gx.Simulation | gx.Equilibrium, seam: Seam) -> float:
    """Largest distance [m] of the nodes of the finer edge from the points that belong to them."""
    state = run.system.unknowns.state
    # The node fractions σ of the finer edge, where a difference of the two lines would show.
    line_a, line_b = seam.lines(run.system.unknowns.initial)
    _, σ = max(line_a.all_nodes(), line_b.all_nodes(), key=lambda found: len(found[0]))
    apart = [state.vector(line_a.port(float(s))) - state.vector(line_b.port(float(s))) for s in σ]
    return float(np.linalg.norm(apart, axis=1).max())


@pytest.mark.mpi(2)
@pytest.mark.parametrize(("cells", "order"), [((4, 4), 1), ((4, 4), 2), ((4, 6), 1), ((6, 4), 2)])
def test_two_panels_are_drawn_together(cells: tuple[int, int], order: int) -> None:
    """Momentum is kept while they are sewn, and the energy is that which the sewing supplied."""
    left = panel("left", 0.0, cells[0], order)
    right = panel("right", 0.23, cells[1], order)
    seam = gx.Seam(left, "right", right, "left", closing=(0.0, 0.05))
    run = run_until(0.025, left, right, seam, dt=1e-3)
    # The gap of 0.03 m closes linearly over 0.05 s: half of it is left at half the time.
    assert distance_of_edges(run, seam) == pytest.approx(0.015, abs=1e-9)
    run.run(until=0.05)
    assert distance_of_edges(run, seam) < 1e-9
    supplied = run.totals.supplied
    turning = run.totals.angular_momentum
    # Sewing does work, or the balance below would be trivial.
    assert supplied > 1e-6
    run.run(until=0.06)
    assert distance_of_edges(run, seam) < 1e-9
    # A closed seam does no work.
    assert run.totals.supplied == pytest.approx(supplied, rel=1e-10)
    assert run.totals.energy == pytest.approx(supplied, rel=1e-8)
    assert abs(run.energy_error) < 1e-10
    error = np.abs(run.totals.momentum).max()
    assert error < 1e-12
    # The directions of open gaps are held from outside; a closed seam has no moment.
    error = np.abs(run.totals.angular_momentum - turning).max()
    assert error < 1e-12


@pytest.mark.mpi
def test_a_sewn_sheet_is_the_whole_one() -> None:
    """Two halves, sewn in an equilibrium and pulled, carry the force of one sheet."""

    left = panel("left", 0.0)
    right = panel("right", 0.23)
    seam = gx.Seam(left, "right", right, "left")
    hold = gx.Fixed(left, "left")

    def beside(X: np.ndarray, t: float) -> np.ndarray:
        # 4 mm on 0.4 m: 1 % of strain, in the second unit of time.
        gap = 0.03 * (1 - min(t, 1.0))
        return np.vstack([0.2 + gap + 0.004 * max(t - 1.0, 0.0) + 0 * X[0], 0 * X[0], 0 * X[0]])

    pull = gx.Fixed(right, "right", motion=beside)
    statics = gx.Equilibrium(gx.Scene(left, right, seam, hold, pull))
    for t in (0.25, 0.5, 0.75, 1.0, 2.0):
        statics.find(at=t)
    assert distance_of_edges(statics, seam) < 1e-9
    whole = gx.Membrane(sheet(COMM, 8, 4, 0.4, 0.1), FILM, name="whole")
    end = gx.Fixed(
        whole,
        "right",
        motion=lambda X, t: np.vstack([0.004 * t + 0 * X[0], 0 * X[0], 0 * X[0]]),
    )
    one = gx.Equilibrium(gx.Scene(whole, gx.Fixed(whole, "left"), end))
    one.find(at=1.0)
    # Same meshes, same law: the tolerance of the equilibrium.
    assert statics.reaction(pull)[0] == pytest.approx(one.reaction(end)[0], rel=1e-7, abs=1e-9)


@pytest.mark.mpi
def test_four_panels_meet_in_a_point() -> None:
    """Four seams meet there, of which three suffice: the fourth tie is left out."""
    places = {"a": (0.0, 0.0), "b": (0.21, 0.0), "c": (0.21, 0.21), "d": (0.0, 0.21)}
    panels = {
        name: gx.Membrane(
            sheet(COMM, 3, 3, 0.2, 0.2),
            FILM,
            name=name,
            displacement=lambda X, at=at: np.vstack([at[0] + 0 * X[0], at[1] + 0 * X[0], 0 * X[0]]),
        )
        for name, at in places.items()
    }
    seams = [
        gx.Seam(panels[first], edge, panels[second], other, closing=(0.0, 0.02))
        for first, edge, second, other in (
            ("a", "right", "b", "left"),
            ("d", "right", "c", "left"),
            ("a", "top", "d", "bottom"),
            ("b", "top", "c", "bottom"),
        )
    ]
    run = run_until(0.03, *panels.values(), *seams, dt=1e-3)
    for seam in seams:
        assert distance_of_edges(run, seam) < 1e-9
    assert abs(run.energy_error) < 1e-10
    error = np.abs(run.totals.momentum).max()
    assert error < 1e-12


@pytest.mark.mpi
def test_closed_edges_are_turned_to_each_other() -> None:
    """Two rings with different meshes, one turned by 50 degrees: nobody has to turn while they are
    sewn."""
    turned = np.deg2rad(50.0)
    c = np.cos(turned)
    s = np.sin(turned)

    def above(X: np.ndarray) -> np.ndarray:
        return np.vstack([c * X[0] - s * X[1], s * X[0] + c * X[1], 0.02 + 0 * X[2]]) - X

    bottom = gx.Membrane(ring(COMM, 0.5, 1.0, 3, 48), FILM, name="bottom")
    top = gx.Membrane(ring(COMM, 0.5, 1.0, 3, 32), FILM, name="top", displacement=above)
    seam = gx.Seam(bottom, "rim", top, "rim")
    equilibrium = gx.Equilibrium(gx.Scene(bottom, top, seam, gx.Fixed(bottom, "hub")))
    line_a, line_b = seam.lines(equilibrium.system.unknowns.initial)
    assert line_a.is_closed
    a = line_a.positions(equilibrium.system.unknowns.initial)
    there = [
        equilibrium.system.unknowns.initial.vector(line_b.port(float(f))) for f in line_a.fractions
    ]
    # No farther than an edge of the coarser ring.
    error = np.linalg.norm(a[:, :2] - np.array(there)[:, :2], axis=1).max()
    assert error < 2 * np.pi / 32


def test_ease_is_reported_and_limited() -> None:
    left = panel("left", 0.0)
    right = panel("right", 0.23, height=0.103)
    seam = gx.Seam(left, "right", right, "left", max_ease=0.04)
    # Ease: the relative difference of the two lengths.
    assert seam.ease == pytest.approx(0.1 / 0.103 - 1)
    with pytest.raises(gx.InputError, match=r"0\.1 m and 0\.103 m long, 3\.0% apart"):
        gx.Seam(left, "right", right, "left")


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("edges", "options", "words"),
    [
        (("right", "seam"), {}, "no group 'seam'"),
        (("film", "left"), {}, "'film' has dimension 2"),
        (("right", "right"), {"same": True}, "a and b, edge_a and edge_b are the same"),
        (("right", "left"), {"closing": (1.0, 0.5)}, r"closing is \(1\.0, 0\.5\)"),
        (("right", "left"), {"closing": (-1.0, 0.5)}, r"closing is \(-1\.0, 0\.5\)"),
    ],
)
def test_bad_seams_are_refused(edges: tuple[str, str], options: dict, words: str) -> None:
    left = panel("left", 0.0)
    right = left if options.pop("same", False) else panel("right", 0.23)
    with pytest.raises(gx.InputError, match=words):
        gx.Seam(left, edges[0], right, edges[1], **options)


def test_lines_are_one_line() -> None:
    film = gx.Membrane(ring(COMM, 0.5, 1.0, 3, 16), FILM)
    line = edge_line(film, "rim", "test")
    # The perimeter of the regular polygon of 16 chords in the unit circle.
    assert line.length == pytest.approx(16 * 2 * np.sin(np.pi / 16))
    square = panel("left", 0.0)
    with pytest.raises(gx.InputError, match="one of its edges is closed"):
        gx.Seam(film, "rim", square, "left", max_ease=100.0)


def test_a_seam_whose_sides_are_both_fixed_is_refused() -> None:
    left = panel("left", 0.0)
    right = panel("right", 0.23)
    seam = gx.Seam(left, "right", right, "left")
    scene = gx.Scene(left, right, seam, gx.Fixed(left, "right"), gx.Fixed(right, "left"))
    with pytest.raises(gx.InputError, match="nodes on both of its sides are fixed"):
        gx.Equilibrium(scene)
