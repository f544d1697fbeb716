"""Beams against the elastica, the frequencies of Euler and Bernoulli, and their sections.

Sources:
    cantilever under a dead tip force    K. E. Bisshopp & D. C. Drucker, Large deflection of
                                         cantilever beams, Quarterly
        of Applied Mathematics 3 (1945) 272, doi:10.1090/qam/13360; figures as in K. Mattiasson,
        Numerical results from large deflection beam and frame problems analysed by means of
        elliptic integrals, IJNME 17 (1981) 145, doi:10.1002/nme.1620170113
    frequencies    roots βL of cos βL cosh βL = 1 (free at both ends) and = -1 (clamped and free):
                   R. D. Blevins,
        Formulas for Natural Frequency and Mode Shape (1979), table 8-1
    sections    moments of inertia of tubes; torsion constant of a square, S. P. Timoshenko & J. N.
                Goodier, Theory of
        Elasticity, 3rd ed. (1970), § 109
"""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from spectrum import angular_frequencies

import gossamer_fx as gx
from gossamer_fx.analysis.statics.continuation import Continuation
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.mechanics.bodies.meshed import global_node
from gossamer_fx.meshes.line import line
from tests.small_scenes import run_until

COMM = MPI.COMM_WORLD


def cantilever(elements: int, slenderness: float, load: float) -> tuple[float, float, int]:
    """Tip (w/L, u/L) and Newton iterations under a dead tip force P = load EI/L² across a circular
    beam, L/r given."""
    section = gx.sections.solid_circle(1 / slenderness, E=1e9, nu=0.3, density=1000.0)
    beam = gx.Beam(line(COMM, [(0, 0, 0), (1, 0, 0)], elements), section)
    P = load * section.EI2
    scene = gx.Scene(
        beam, gx.Fixed(beam, "start", rotation=True), gx.loads.Force(beam.port("end"), (0, 0, P))
    )
    # The first step is the time in which the load moves the beam's own mass by about its length.
    search = Continuation(first_step=(section.line_density / P) ** 0.5, inner_tolerance=1e-6)
    statics = Equilibrium(scene, search)
    found = statics.find()
    node = global_node(beam, "end")
    # Nine coordinates a node: its position, then two directors.
    x, _, z = statics.system.unknowns.q0.array_r[9 * node : 9 * node + 3]
    return float(z), float(1 - x), found.iterations


# Tip deflection and shortening by elliptic integrals, for P L²/EI = 1, 2, 5, 10.
ELASTICA = {
    1: (0.301721, 0.056433),
    2: (0.493457, 0.160642),
    5: (0.713792, 0.387628),
    10: (0.810609, 0.554996),
}


@pytest.mark.parametrize("load", ELASTICA)
def test_cantilever_is_an_elastica(load: int) -> None:
    w, u, _ = cantilever(8, 1e3, load)
    # 8 elements reach 0.3 % at all four loads.
    assert (w, u) == pytest.approx(ELASTICA[load], rel=3e-3)


def test_four_elements_suffice() -> None:
    w, u, _ = cantilever(4, 1e3, 10)
    assert (w, u) == pytest.approx(ELASTICA[10], rel=1e-3)


def test_no_locking_and_no_more_iterations_in_slender_beams() -> None:
    """From L/r = 100, where shear and extension are below 0.1 %, to 1e4; at 10 they add 5 %, as the
    theory says."""
    tips, iterations = zip(
        *[(c[:2], c[2]) for c in (cantilever(8, s, 10) for s in (1e1, 1e2, 1e3, 1e4))], strict=True
    )
    # At L/r = 10, shear and extension add more than 3 % to the deflection.
    assert tips[0][0] > ELASTICA[10][0] * 1.03
    for tip in tips[1:]:
        assert tip == pytest.approx(ELASTICA[10], rel=1e-3)
    # Locking shows as more iterations too: the tangent of a thin beam is ill-conditioned.
    assert max(iterations) <= min(iterations) + 3


def frequencies(supports: str, slenderness: float = 1e3) -> np.ndarray:
    """(βL)² = ω√(μL⁴/EI) of bending vibrations, each twice."""
    section = gx.sections.solid_circle(1 / slenderness, E=1e9, nu=0.3, density=1000.0)
    beam = gx.Beam(line(COMM, [(0, 0, 0), (1, 0, 0)], 16), section)
    items: list = [gx.Fixed(beam, "start", rotation=True)] if supports == "clamped-free" else []
    if supports == "pinned-pinned":
        items = [
            gx.constraints.BallJoint(beam.port(end), gx.Ground((x, 0, 0)), name=end)
            for end, x in (("start", 0), ("end", 1))
        ]
    ω = angular_frequencies(gx.Scene(beam, *items))
    # √(μL⁴/EI) for L = 1 m.
    return ω * (section.line_density / section.EI2) ** 0.5


@pytest.mark.parametrize(
    ("supports", "rigid", "roots"),
    [
        ("free-free", 6, (4.73004074, 7.85320462)),
        ("clamped-free", 0, (1.87510407, 4.69409113)),
        ("pinned-pinned", 1, (np.pi, 2 * np.pi)),
    ],
)
def test_bending_frequencies(supports: str, rigid: int, roots: tuple[float, float]) -> None:
    found = frequencies(supports)
    # rigid motions have the root of a round-off for a frequency, well below the first bending
    assert (found[:rigid] < 0.3 * roots[0] ** 2).all()
    assert np.sqrt(found[rigid : rigid + 4]) == pytest.approx(np.repeat(roots, 2), rel=1e-2)


def test_boom_of_the_antenna() -> None:
    """Tube of outer radius 0.02 m, wall 0.5 mm, E = 100 GPa, ν = 0.3, 1560 kg/m³."""
    s = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
    measured = (s.EA, s.EI2, s.EI3, s.GJ, s.line_density)
    # EA = E·2πrt and so on of the tube, by hand: N, N m² (three times), kg/m.
    expected = (6204645.5, 1210.2937, 1210.2937, 930.99512, 0.09679247)
    assert measured == pytest.approx(expected, rel=1e-6)


def test_square_section_has_the_torsion_constant_of_saint_venant() -> None:
    """J = 0.140577 a⁴ of a square."""
    s = gx.sections.rectangle(0.1, 0.1, E=2.0, nu=0.0, density=1.0)
    # G = E / 2(1 + ν) = 1 Pa, so that GJ is the torsion constant itself.
    error = abs(s.GJ / (0.1405770 * 1e-4) - 1)
    assert error < 1e-5


def test_thrown_beam_conserves() -> None:
    """A curved beam, spinning and bent by its own motion, 200 steps: energy, momenta, orthonormal
    directors."""
    section = gx.sections.rectangle(0.02, 0.05, E=1e7, nu=0.3, density=1000.0)

    mesh = line(COMM, [(0, 0, 0), (0.5, 0.2, 0), (1, 0.2, 0.3)], 3)
    beam = gx.Beam(
        mesh,
        section,
        velocity=lambda x: np.cross([3.0, 2.0, 5.0], x.T).T + np.array([[1.0], [0.0], [0.0]]),
    )
    run = run_until(1.0, beam, dt=5e-3)
    # 200 steps at the default tolerance of Newton's method.
    assert abs(run.energy_error) < 1e-11
    scale = np.linalg.norm(run.first.angular_momentum)
    error = np.abs(run.totals.momentum - run.first.momentum).max()
    assert error < 1e-10 * scale
    error = np.abs(run.totals.angular_momentum - run.first.angular_momentum).max()
    assert error < 1e-10 * scale
    owned = run.system.unknowns.numbering.owned(0)
    d = run.system.unknowns.q0.array_r[owned].reshape(-1, 3, 3)[:, 1:]
    products = np.einsum("nai,nbi->nab", d, d) - np.eye(2)
    assert np.abs(products).max(initial=0.0) < 1e-10
    # It must have been bent, or the test would not see the elastic forces.
    assert run.totals.stored["beam"] > 1e-3


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: gx.sections.tube(0.01, 0.02, E=1e9, nu=0.3, density=1e3),
            r"wall_thickness is 0\.02 and outer_radius is 0\.01",
        ),
        (
            lambda: gx.Beam(
                line(COMM, [(0, 0, 0), (1, 0, 0)], 2),
                gx.sections.solid_circle(0.1, E=1e9, nu=0.3, density=1e3),
                normal=(1, 0, 0),
            ),
            "its normal .* is along the beam .* give another direction",
        ),
    ],
)
def test_bad_beams_are_refused(make, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        make()


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("corners", "normal"),
    [
        ([(0, 0, 0), (1, 0, 0)], (0, 0, 1)),
        ([(0, 0, 0), (0, 0, 1)], (1, 0, 0)),
        ([(0, 0, 0), (0, 0, 2), (2, 0, 2)], (0, 1, 0)),
    ],
    ids=["along x", "upright", "portal"],
)
def test_the_default_normal_is_an_axis_across_the_beam(comm, corners, normal):
    section = gx.sections.rectangle(0.01, 0.02, E=1e9, nu=0.3, density=1e3)
    beam = gx.Beam(line(comm, corners, 4), section)
    d2 = beam.stress_free(np.arange(beam.block.index_map.size_local))[:, 1]
    assert d2 == pytest.approx(np.tile(normal, (len(d2), 1)))
