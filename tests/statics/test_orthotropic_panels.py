"""Panels of orthotropic film, sheared and stretched, against the closed forms of uniform
tension."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.mechanics.materials.film import WRINKLED
from gossamer_fx.meshes.sheet import EDGES, sheet

# Pa; the film is four times as stiff along its first axis.
E1 = 4e9
E2 = 1e9
NU12 = 0.3
G12 = 0.4e9
THICKNESS = 1e-4
NUMBERS = {"density": 1400.0, "thickness": THICKNESS}


def compliance_along(angle: float, E1: float = E1) -> float:
    """F_tt t = 1/E along a direction at an angle to the first axis [1/Pa]."""
    c = math.cos(angle)
    s = math.sin(angle)
    return c**4 / E1 + s**4 / E2 + c**2 * s**2 * (1 / G12 - 2 * NU12 / E1)


@pytest.mark.parametrize("side", [1, -1], ids=["right", "left"])
def test_a_sheared_panel_carries_diagonal_tension(comm, side: int) -> None:
    """Of film with E1 = E2 the tension is at 45 degrees to the axes: W = e_tt²/(2 F_tt), S =
    e_tt/F_tt."""
    law = gx.Orthotropic(E2, E2, NU12, G12, direction=(1.0, 0.0, 0.0), **NUMBERS)
    # Half a per cent, to either side.
    E12 = side * 5e-3
    # Green-Lagrange strain E11 = E22 = 0 and E12: the lengths of both sides are constant.
    angle = math.asin(2 * E12)
    c = math.cos(angle)
    s = math.sin(angle)

    def sheared(X: np.ndarray) -> np.ndarray:
        return np.vstack([s * X[1], (c - 1) * X[1], 0 * X[0]])

    film = gx.Membrane(sheet(comm, 6, 6), law, displacement=sheared)
    equilibrium = gx.Equilibrium(gx.Scene(*[gx.Fixed(film, edge) for edge in EDGES]))
    result = equilibrium.find()
    F_tt = compliance_along(math.pi / 4, E2)
    # W = e²/2F times the thickness, on 1 m².
    expected = abs(E12) ** 2 / (2 * F_tt) * THICKNESS
    # A uniform state: exact up to the tolerance of the equilibrium.
    assert result.totals.stored["film"] == pytest.approx(expected, rel=1e-8)
    _, stress = gx.fields.field_values(equilibrium, film, field="second_piola_stress1")
    exact = np.full(stress.shape, abs(E12) / F_tt)
    assert stress == pytest.approx(exact, rel=1e-6)
    _, state = gx.fields.field_values(equilibrium, film, field="state")
    assert (state == WRINKLED).all()


def strain_of_tension(angle: float) -> tuple[float, float, float]:
    """Strains along, across and of shear (2 E12) of a unit stress at an angle to the first axis
    [1/Pa]."""
    t = np.array([math.cos(angle), math.sin(angle)])
    n = np.array([-math.sin(angle), math.cos(angle)])
    e1 = t[0] ** 2 / E1 - NU12 / E1 * t[1] ** 2
    e2 = t[1] ** 2 / E2 - NU12 / E1 * t[0] ** 2
    e12 = t[0] * t[1] / G12
    strain = np.array([[e1, e12 / 2], [e12 / 2, e2]])
    return t @ strain @ t, n @ strain @ n, 2 * t @ strain @ n


@pytest.mark.mpi(2)
@pytest.mark.parametrize("angle", [0.0, 0.5, math.pi / 4, 1.2])
@pytest.mark.parametrize("kind", [gx.Orthotropic, gx.LinearOrthotropic])
def test_a_pulled_strip_stretches_contracts_and_shears_at_any_angle_to_its_axes(
    comm, angle: float, kind
) -> None:
    """f = t μ S with the stretch μ, μ² - 1 = 2 S F_tt; the sides turn, since F couples tension and
    shear."""
    direction = (math.cos(angle), -math.sin(angle), 0.0)
    more = {"residual_stiffness": 1e-2} if kind is gx.Orthotropic else {}
    law = kind(E1, E2, NU12, G12, direction=direction, **more, **NUMBERS)
    along, across, shear = strain_of_tension(angle)
    # 1 % along; the film contracts and shears freely.
    stretch = 1.01
    S = (stretch**2 - 1) / 2 / along
    film = gx.Membrane(sheet(comm, 8, 4, 2.0, 1.0), law)
    f = THICKNESS * stretch * S
    loads = [gx.loads.EdgeLoad(film, edge, normal_force=f) for edge in ("left", "right")]
    held = [
        gx.Fixed(film, "bottom left"),
        gx.Fixed(film, "bottom right", components=(1, 2)),
        *(gx.Fixed(film, edge, components=(2,)) for edge in EDGES),
    ]
    equilibrium = gx.Equilibrium(gx.Scene(*loads, *held))
    result = equilibrium.find()
    # Density of the energy over 2 m².
    measured = result.totals.stored["film"]
    exact = S**2 * along / 2 * THICKNESS * 2.0
    assert measured == pytest.approx(exact, rel=1e-7)
    x = gx.fields.positions(equilibrium, film)
    X = film.space.tabulate_dof_coordinates()[: len(x)]
    lean = S * shear / stretch
    height = math.sqrt(1 + 2 * S * across - lean**2)
    expected = np.column_stack([stretch * X[:, 0] + lean * X[:, 1], height * X[:, 1], 0 * X[:, 2]])
    error = abs(x - expected).max(initial=0.0)
    # 1e-7 m on 2 m.
    assert error <= 1e-7


def test_a_strip_across_its_stiff_axis_is_softer(comm) -> None:
    """Stretched along the first or the second axis between fixed edges: the energies are as E1 and
    E2."""
    stretch = 1.005

    def energy(direction) -> float:
        law = gx.LinearOrthotropic(E1, E2, NU12, G12, direction=direction, **NUMBERS)
        film = gx.Membrane(
            sheet(comm, 4, 4),
            law,
            displacement=lambda X: np.vstack([(stretch - 1) * X[0], *(0 * X[1:])]),
        )
        fixed = [gx.Fixed(film, edge) for edge in EDGES]
        return gx.Equilibrium(gx.Scene(*fixed)).find().totals.stored["film"]

    along = energy((1.0, 0.0, 0.0))
    across = energy({"film": (0.0, 1.0, 0.0)})
    # Between fixed sides the ratio of the stiffnesses is exact.
    assert along / across == pytest.approx(E1 / E2, rel=1e-9)
