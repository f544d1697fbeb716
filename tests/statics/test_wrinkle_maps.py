"""Maps of wrinkles against fields of known strain."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

E = 2.5e9
NU = 0.3
THICKNESS = 1e-5
LAW = gx.TensionField(E, NU, density=1400.0, thickness=THICKNESS)
STRETCH = 1e-3
SHORTENING = 4e-3


def stretched(law, comm, angle=0.0, order=1):
    """A film that is stretched along one direction and shortened across it, by uniform strains."""
    t = np.array([math.cos(angle), math.sin(angle), 0.0])
    n = np.array([-math.sin(angle), math.cos(angle), 0.0])

    def displacement(X):
        along = (math.sqrt(1 + 2 * STRETCH) - 1) * np.outer(t, t)
        across = (math.sqrt(1 - 2 * SHORTENING) - 1) * np.outer(n, n)
        return (along + across) @ X

    film = gx.Membrane(sheet(comm, 4, 4, 2.0, 2.0), law, order=order, displacement=displacement)
    return gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-6)), film, t


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_slope_amplitude_and_direction(comm, angle, order):
    """a = -(γ2 + ν γ1), slope 2 √a; W = 2 L √a/π with L = √(π ℓ) (B/T)^(1/4), ℓ = 2 m."""
    run, film, t = stretched(LAW, comm, angle, order)
    excess = SHORTENING - NU * STRETCH
    _, slope = gx.fields.field_values(run, film, field="wrinkle_slope")
    # The push forward of the strain across the crests has its shortened length.
    assert slope == pytest.approx(2 * math.sqrt(excess), rel=1e-2)
    tension = E * THICKNESS * STRETCH
    bending = E * THICKNESS**3 / 12 / (1 - NU**2)
    half = math.sqrt(math.pi * 2.0) * (bending / tension) ** 0.25
    _, amplitude = gx.fields.field_values(run, film, field="wrinkle_amplitude")
    assert amplitude == pytest.approx(2 * half * math.sqrt(excess) / math.pi, rel=1e-2)
    _, direction = gx.fields.field_values(run, film, field="wrinkle_direction")
    cosines = np.abs(direction.reshape(-1, 3) @ t)
    assert cosines == pytest.approx(1.0, abs=1e-6)


def test_taut_film_has_no_wrinkles(comm):
    film = gx.Membrane(sheet(comm, 3, 3), LAW, initial_stress=1e6)
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-6))
    for field in ("wrinkle_slope", "wrinkle_amplitude"):
        _, values = gx.fields.field_values(run, film, field=field)
        assert values == pytest.approx(0.0, abs=1e-6)


@pytest.mark.mpi
def test_a_chessboard_of_states_is_smoothed(comm):
    """Cells that are sheared to and fro alternate between two strains; the map has little of it."""

    def zigzag(X):
        x, y, _ = X
        shift = 2e-3 * np.where(np.rint(4 * x) % 2 == 1, 1.0, -1.0)
        return np.vstack([0 * x, -5e-3 * y + shift * y, 0 * x])

    film = gx.Membrane(sheet(comm, 8, 8, 2.0, 2.0), LAW, displacement=zigzag)
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-6))
    _, strain = gx.fields.field_values(run, film, field="strain2")
    _, slope = gx.fields.field_values(run, film, field="wrinkle_slope")
    spread_of_strain = spread(comm, np.sqrt(np.maximum(-strain, 0.0)))
    assert spread(comm, slope) / 2 < 0.75 * spread_of_strain


def spread(comm, values):
    """Largest less smallest value on all ranks."""
    highest = comm.allreduce(float(values.max(initial=-np.inf)), MPI.MAX)
    return highest - comm.allreduce(float(values.min(initial=np.inf)), MPI.MIN)


def test_laws_without_maps_are_refused(comm):
    law = gx.analysis.Prestress(E, NU, density=1400.0, thickness=THICKNESS, tension=1.0)
    film = gx.Membrane(sheet(comm, 2, 2), law)
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-6))
    with pytest.raises(gx.InputError, match="has no maps of wrinkles"):
        gx.fields.field_values(run, film, field="wrinkle_slope")


def fabric(E1: float, E2: float, nu12: float, G12: float, direction) -> gx.Orthotropic:
    return gx.Orthotropic(
        E1,
        E2,
        nu12,
        G12,
        density=1400.0,
        thickness=THICKNESS,
        direction=direction,
    )


def map_of(run, film, field: str) -> np.ndarray:
    """Values of a field at its points."""
    return gx.fields.field_values(run, film, field=field)[1]


@pytest.mark.parametrize(
    "direction, along, across",
    [((1.0, 0.0, 0.0), E, E / 2), ((0.0, 1.0, 0.0), E / 2, E)],
    ids=["first axis", "second axis"],
)
def test_maps_of_a_fabric_along_its_axes(comm, direction, along, across):
    """Stretched along an axis, crests run along it: a = -(γ2 + ν γ1) with the ratio and bending of
    that axis."""
    law = fabric(E, E / 2, NU, E / 4, direction)
    run, film, t = stretched(law, comm)
    # ν12 E2 = ν21 E1
    ratio = NU * along / E
    excess = SHORTENING - ratio * STRETCH
    assert map_of(run, film, "wrinkle_slope") == pytest.approx(2 * math.sqrt(excess), rel=1e-2)
    # Wrinkles bend across the crests.
    bending = across * THICKNESS**3 / 12 / (1 - NU * law.nu21)
    tension = along * THICKNESS * STRETCH
    half_wavelength = math.sqrt(math.pi * 2.0) * (bending / tension) ** 0.25
    amplitude = 2 * half_wavelength * math.sqrt(excess) / math.pi
    assert map_of(run, film, "wrinkle_amplitude") == pytest.approx(amplitude, rel=1e-2)
    crests = map_of(run, film, "wrinkle_direction").reshape(-1, 3)
    assert np.abs(crests @ t) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("field", ["wrinkle_slope", "wrinkle_amplitude", "wrinkle_direction"])
def test_maps_of_a_fabric_of_equal_stiffness_are_those_of_a_tension_field(comm, field):
    alike = fabric(E, E, NU, E / 2 / (1 + NU), direction=(1.0, 0.4, 0.0))
    maps = []
    for law in (LAW, alike):
        run, film, _ = stretched(law, comm, angle=0.7)
        maps.append(map_of(run, film, field))
    assert maps[1] == pytest.approx(maps[0], rel=1e-9, abs=1e-12)


def test_crests_of_a_fabric_leave_the_direction_of_the_largest_strain(comm):
    """They run along the tension: soft in shear, the fabric pulls along its yarns."""
    softness = 100.0
    law = fabric(E, E, 0.0, E / softness, direction=(1.0, 0.0, 0.0))
    angle_of_strain = 0.5
    run, film, _ = stretched(law, comm, angle=angle_of_strain)
    crests = map_of(run, film, "wrinkle_direction").reshape(-1, 3)
    found = np.arctan2(crests[:, 1], crests[:, 0])
    # The largest e_tt²/F_tt, by trial of all directions t.
    angles = np.linspace(-np.pi / 2, np.pi / 2, 100_001)
    off = angles - angle_of_strain
    strain = STRETCH * np.cos(off) ** 2 - SHORTENING * np.sin(off) ** 2
    squares = np.cos(angles) ** 2 * np.sin(angles) ** 2
    compliance = np.cos(angles) ** 4 + np.sin(angles) ** 4 + softness * squares
    tension = np.maximum(strain, 0.0)
    expected = angles[np.argmax(tension**2 / compliance)]
    assert abs(expected - angle_of_strain) > 0.1
    # Crests are those of the deformed film, which has turned by strains of 4e-3.
    assert found == pytest.approx(expected, abs=5e-3)
