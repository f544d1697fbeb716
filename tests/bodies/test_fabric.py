"""Fabrics by measured curves: patches under tension, free flight, gradients by their points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from tests.strain_samples import SQUARE, Samples

WARP = ([0.0, 0.01, 0.03], [0.0, 2e3, 20e3])
WEFT = ([0.0, 0.005, 0.02, 0.05], [0.0, 500.0, 6e3, 30e3])
SHEAR = ([0.0, 0.02, 0.1], [0.0, 200.0, 400.0])


def fabric(angle: float = 0.0, **changed: Any) -> gx.materials.Fabric:
    """A fabric whose warp is turned from x by an angle [degrees]."""
    turned = math.radians(angle)
    given: dict[str, Any] = {
        "warp": WARP,
        "weft": WEFT,
        "shear": SHEAR,
        "contraction": 0.3,
        "density": 800.0,
        "thickness": 3e-4,
        "direction": (math.cos(turned), math.sin(turned), 0.0),
    }
    return gx.materials.Fabric(**(given | changed))


def pulled(comm, law, N1: float, N2: float, order: int = 1):
    """A square patch under tensions [N/m] along x and y, in equilibrium."""
    film = gx.Membrane(sheet(comm, 2, 2, crossed=True), law, order=order, name="film")
    supports = [
        gx.Fixed(film, "left", components=(0,)),
        gx.Fixed(film, "bottom", components=(1,)),
        gx.Fixed(film, "left", components=(2,), name="z"),
    ]
    loads = [
        gx.loads.EdgeLoad(film, "right", force=(N1, 0.0, 0.0), name="along x"),
        gx.loads.EdgeLoad(film, "top", force=(0.0, N2, 0.0), name="along y"),
    ]
    equilibrium = gx.Equilibrium(gx.Scene(film, *supports, *loads))
    equilibrium.find()
    corner = film.port_at((1.0, 1.0, 0.0))
    x, y = (gx.probes.Position(corner, axis)(equilibrium) - 1.0 for axis in "xy")
    return equilibrium, (x, y)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("N1", "N2"), [(1e3, 1e3), (15e3, 4e3), (30e3, 45e3), (12e3, 10.0)])
def test_a_patch_has_the_tensions_of_its_curves(comm, N1, N2, order):
    """Also beyond the last points.  A dead load on an edge of one metre is a tension on the
    stress-free width."""
    law = fabric()
    _, (x, y) = pulled(comm, law, N1, N2, order)
    found = law.tensions(x, y, 0.0)
    assert found == pytest.approx((N1, N2, 0.0), rel=1e-6)


@pytest.mark.mpi
def test_its_axes_are_those_of_the_direction(comm):
    """Turned by a right angle, warp and weft change places."""
    _, (x, y) = pulled(comm, fabric(90.0), 15e3, 4e3)
    assert fabric().tensions(y, x, 0.0) == pytest.approx((4e3, 15e3, 0.0), rel=1e-6)


def test_the_average_stress_of_a_step_does_the_work_of_its_energy(comm):
    """Along paths between random strains in turned axes, through taut, half slack and slack
    states."""
    law = fabric(30.0)
    film = gx.Membrane(sheet(comm, 1, 1), law)
    domain, c = film.mesh.domain, film.constants
    ends = [fem.Constant(domain, np.zeros(3)) for _ in range(2)]
    way = ends[1] - ends[0]
    work = sum(
        (piece.end - piece.start)
        * ufl.dot(piece.stress(ends[0] + piece.start * way, ends[0] + piece.end * way), way)
        for piece in law.pieces(*ends, c)
    )
    shares = sum(piece.end - piece.start for piece in law.pieces(*ends, c))
    change = law.energy(ends[1], c) - law.energy(ends[0], c)
    forms = [fem.form(what * ufl.dx(domain)) for what in (change, work, shares)]
    rng = np.random.default_rng(5)
    for _ in range(200):
        for end in ends:
            end.value[:] = rng.normal(scale=0.02, size=3)
        found = [fem.assemble_scalar(form) for form in forms]
        assert found[2] == pytest.approx(1.0, rel=1e-12)
        assert found[1] == pytest.approx(found[0], rel=1e-11, abs=1e-11)


def in_its_axes(law: gx.materials.Fabric):
    """Constants of a law whose warp is the first axis of its film."""
    c = law.constants(SQUARE)
    c.cosine = 1.0
    c.sine = 0.0
    return c


# Engineering strains of warp and weft, and the yarns that are taut: on the first piece of the
# curves and beyond their corners.
STATES = [
    (0.004, 0.003, "both"),
    (0.02, 0.04, "both"),
    (0.02, -0.002, "both"),
    (-0.0005, 0.04, "both"),
    (0.02, -0.03, "warp"),
    (-0.03, 0.04, "weft"),
    (-0.03, -0.02, "none"),
    (-0.001, -0.03, "none"),
]


def on_curve(curve, e: float) -> tuple[float, float]:
    """Stress [N/m] of a yarn that is pulled alone to the Green-Lagrange strain e, and its stiffness
    at zero strain."""
    strain, tension = (np.array(column) for column in curve)
    green = strain + strain**2 / 2
    stress = tension / (1 + strain)
    last = (stress[-1] - stress[-2]) / (green[-1] - green[-2])
    beyond = last * max(e - green[-1], 0.0)
    return float(np.interp(e, green, stress)) + beyond, float(stress[1] / green[1])


def stresses_by_hand(law, e1: float, e2: float, γ: float) -> tuple[float, float, float]:
    """Stresses [N/m] of both yarns and in shear at Green-Lagrange strains: where both are taut they
    contract each other by their stiffness at zero strain."""
    alone1, K1 = on_curve(law.warp, e1)
    alone2, K2 = on_curve(law.weft, e2)
    ν12 = law.contraction
    ν21 = ν12 * K2 / K1
    N1 = law.residual_stiffness * K1 * e1 + alone1
    N2 = law.residual_stiffness * K2 * e2 + alone2
    if e1 + ν21 * e2 >= 0 and e2 + ν12 * e1 >= 0:
        N1 += K1 * (e1 + ν21 * e2) / (1 - ν12 * ν21) - K1 * max(e1, 0.0)
        N2 += K2 * (e2 + ν12 * e1) / (1 - ν12 * ν21) - K2 * max(e2, 0.0)
    elif e1 > 0:
        N2 -= K2 * max(e2, 0.0)
    strain, force = law.shear
    in_shear = np.interp(abs(γ), strain, force)
    return N1, N2, float(np.copysign(in_shear, γ))


@pytest.mark.parametrize("residual", [0.0, 0.2])
@pytest.mark.parametrize(("x", "y", "taut"), STATES)
@pytest.mark.parametrize("shear", [0.01, -0.05])
def test_stresses_are_those_of_the_curves_in_every_state(x, y, taut, shear, residual):
    law = fabric(residual_stiffness=residual)
    c = in_its_axes(law)

    def stress(e):
        e = ufl.variable(e)
        return ufl.diff(law.energy(e, c), e)

    e = np.array([[x + x**2 / 2, y + y**2 / 2, shear]])
    found = Samples(stress)(e)[0].tolist()
    assert found == pytest.approx(stresses_by_hand(law, *e[0]), rel=1e-12, abs=1e-9)
    tensions = law.tensions(x, y, shear)
    assert tensions == pytest.approx(
        (found[0] * (1 + x), found[1] * (1 + y), found[2]), rel=1e-12, abs=1e-12
    )
    state = int(Samples(lambda e: law.state(e, c) * 1.0)(e)[0, 0])
    assert state == {"both": 2, "warp": 1, "weft": 1, "none": 0}[taut]
    if residual == 0:
        is_pulled = [tension > 0 for tension in tensions[:2]]
        assert is_pulled == [taut in ("both", "warp"), taut in ("both", "weft")]
        assert all(tension >= 0 for tension in tensions[:2])


@pytest.mark.parametrize(("name", "curve"), [("warp", WARP), ("weft", WEFT), ("shear", SHEAR)])
def test_a_yarn_alone_has_the_tensions_of_its_curve(name, curve):
    """The other one is slack, as in a test of a strip; beyond the last point the slope stays."""
    law = fabric(residual_stiffness=0.0)
    for strain, tension in zip(*curve, strict=True):
        if name == "shear":
            assert law.tensions(0.0, 0.0, strain) == pytest.approx((0.0, 0.0, tension))
            assert law.tensions(0.0, 0.0, -strain) == pytest.approx((0.0, 0.0, -tension))
            continue
        strains = (strain, -0.1) if name == "warp" else (-0.1, strain)
        expected = (tension, 0.0) if name == "warp" else (0.0, tension)
        assert law.tensions(*strains, 0.0) == pytest.approx((*expected, 0.0))
    if name == "shear":
        assert law.tensions(0.0, 0.0, 0.18)[2] == pytest.approx(400.0 + 2500.0 * 0.08)


def test_the_stiffness_without_wrinkles_is_that_of_small_taut_strain():
    """The energy by which damping acts is that of the fabric below the first corners, and is the
    same for compression."""
    law = fabric(residual_stiffness=0.0)
    c = in_its_axes(law)
    e = np.array([[4e-3, 2e-3, 0.0], [4e-3, -1e-3, 3e-3], [-1e-4, 3e-3, -0.015]])
    energy = Samples(lambda e: law.energy(e, c))(e)
    unwrinkled = Samples(lambda e: law.unwrinkled().energy(e, c))
    np.testing.assert_allclose(unwrinkled(e), energy, rtol=1e-12)
    np.testing.assert_allclose(unwrinkled(-e), energy, rtol=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize("point", [1, 2])
def test_a_free_strip_has_the_measured_points(comm, point):
    """Pulled along the warp, it contracts by ν12 at small strain."""
    _, (x, y) = pulled(comm, fabric(residual_stiffness=0.0), WARP[1][point], 0.0)
    assert x == pytest.approx(WARP[0][point], rel=1e-7)
    if point == 1:
        # Green-Lagrange strains contract in this ratio.
        e1, e2 = x + x**2 / 2, y + y**2 / 2
        assert e2 <= -0.3 * e1 + 1e-9


@pytest.mark.mpi
def test_a_flying_fabric_conserves_energy_and_momenta(comm):
    """It stretches beyond the corners of its curves, and goes slack, in 1000 steps."""
    film = gx.Membrane(
        sheet(comm, 3, 3, crossed=True),
        fabric(20.0),
        velocity=lambda X: np.stack([6 * (X[0] - 0.5), -6 * (X[1] - 0.5), np.sin(3 * X[0])]),
    )
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3))
    first = run.totals
    states = gx.probes.AreaFraction(film, "taut")
    run.run(until=0.01)
    assert states(run) < 1
    run.run(until=1.0)
    assert run.step == 1000
    assert abs(run.energy_error) < 1e-10
    scale = math.sqrt(2 * 0.24 * first.kinetic)
    assert np.abs(run.totals.momentum - first.momentum).max() < 1e-11 * scale
    assert np.abs(run.totals.angular_momentum - first.angular_momentum).max() < 1e-10 * scale


@pytest.mark.mpi
def test_results_have_derivatives_by_the_points_of_curves(comm):
    def moved(**changed: Any):
        equilibrium, _ = pulled(comm, fabric(15.0, **changed), 15e3, 4e3)
        corner = equilibrium.scene.bodies[0].port_at((1.0, 1.0, 0.0))
        return equilibrium, gx.probes.Position(corner, "x")

    equilibrium, result = moved()
    names = ["film.warp", "film.shear", "film.contraction"]
    found = gx.analysis.gradient(equilibrium, of=result, by=names)
    assert found["film.warp"].values.shape == (3,)
    for name, curve, point in (("warp", WARP, 1), ("warp", WARP, 2), ("shear", SHEAR, 1)):
        h = 1e-4 * curve[1][point]
        ends = []
        for sign in (-1, 1):
            tensions = list(curve[1])
            tensions[point] += sign * h
            changed, probe = moved(**{name: (curve[0], tensions)})
            ends.append(probe(changed))
        difference = (ends[1] - ends[0]) / (2 * h)
        assert found[f"film.{name}"].values[point] == pytest.approx(difference, rel=1e-4)
    ends = []
    for sign in (-1, 1):
        changed, probe = moved(contraction=0.3 + sign * 1e-4)
        ends.append(probe(changed))
    by_contraction = found["film.contraction"].values[0]
    assert by_contraction == pytest.approx((ends[1] - ends[0]) / 2e-4, rel=1e-4)


def test_damping_takes_its_first_stiffness(comm):
    film = gx.Membrane(
        sheet(comm, 2, 2), fabric(), velocity=lambda X: np.stack([X[0], X[1], 0 * X[2]])
    )
    run = gx.Simulation(
        gx.Scene(film, gx.Damping(film, stiffness_factor=1e-4)), gx.Midpoint(dt=1e-3)
    )
    run.run(until=0.05)
    assert run.totals.losses and abs(run.energy_error) < 1e-10


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"warp": ([0.01, 0.02], [0.0, 1.0])}, "warp begins at"),
        (
            {"weft": ([0.0, 0.02, 0.01], [0.0, 1.0, 2.0])},
            "weft .*, whose number 3 does not fit",
        ),
        (
            {"shear": ([0.0, 0.02, 0.03], [0.0, 2.0, 1.0])},
            "shear .*, whose number 3 does not fit",
        ),
        ({"shear": ([0.0, 0.02], [0.0, 0.0])}, "zero at the second point"),
        ({"warp": ([0.0, 0.02], [0.0, 1.0, 2.0])}, "equal length"),
        ({"contraction": 2.0}, "less than"),
        ({"warp": ([0.0, 0.01, 0.02], [0.0, 2e3, 2.001e3])}, "flatten less"),
        ({"direction": (0.0, 0.0, 0.0)}, "direction"),
    ],
)
def test_curves_that_are_none_are_refused(changed, words):
    with pytest.raises(gx.InputError, match=words):
        fabric(**changed)
