"""Heated and cooled films, plates, cables and beams at rest, against closed forms."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from dolfinx.mesh import locate_entities

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import crossed_sheet, sheet
from tests.small_scenes import at_rest

ThermalExpansion = gx.materials.ThermalExpansion
ALPHA = 2e-5  # 1/K
T0 = 300.0  # K
LENGTH = 1.0  # m
WIDTH = 0.2  # m
THICKNESS = 1e-4  # m


def metric(stretch: float) -> float:
    """½ (λ² - 1) of a stretch."""
    return (stretch**2 - 1) / 2


def thermal(ΔT: float) -> float:
    """Thermal strain of a change of temperature."""
    return metric(1 + ALPHA * ΔT)


def strip(comm, law, stretch: float, expansion, order: int = 1) -> tuple[gx.Scene, gx.Fixed]:
    """A strip with one cell across, stretched between its ends, whose sides are free in its
    plane."""
    mesh = sheet(comm, 4, 1, LENGTH, WIDTH)
    film = gx.Membrane(
        mesh,
        law,
        order=order,
        thermal=expansion,
        displacement=lambda X: np.vstack([(stretch - 1) * X[0], 0 * X[1], 0 * X[2]]),
    )
    end = gx.Fixed(film, "right", components=(0,))
    held = (
        gx.Fixed(film, "left", components=(0,)),
        gx.Fixed(film, "bottom", components=(1, 2)),
        gx.Fixed(film, "top", components=(2,)),
    )
    return gx.Scene(film, end, *held), end


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("ΔT", [-50.0, 20.0, 49.0, 51.0, 120.0])
def test_a_strip_between_clamps_goes_slack_when_heated_past_its_pretension(comm, order, ΔT) -> None:
    """S = E (ε0 - e_th) while it is tensile, the residual part of it beyond; force S λ0 t."""
    residual = 1e-3
    law = gx.Miyazaki(2e9, 0.0, density=1400.0, thickness=THICKNESS, residual_stiffness=residual)
    stretch = 1 + ALPHA * 50.0
    expansion = ThermalExpansion(ALPHA, lambda X, t: T0 + ΔT * t, reference=T0)
    scene, end = strip(comm, law, stretch, expansion, order)
    equilibrium = gx.Equilibrium(scene)
    # The first second heats the strip.
    equilibrium.find(at=1.0)
    force = equilibrium.reaction(end)[0][0]
    elastic = metric(stretch) - thermal(ΔT)
    share = 1.0 if elastic > 0 else residual
    expected = share * 2e9 * elastic * stretch * THICKNESS * WIDTH
    assert force == pytest.approx(expected, rel=1e-6, abs=1e-9)
    film = scene.bodies[0]
    # Between the clamps the strain stays; the elastic one is what the temperature leaves of it.
    strain = gx.fields.field_values(equilibrium, film, field="strain1")[1]
    assert strain == pytest.approx(max(metric(stretch), thermal(ΔT)), rel=1e-6)
    larger = gx.fields.field_values(equilibrium, film, field="elastic_strain1")[1]
    smaller = gx.fields.field_values(equilibrium, film, field="elastic_strain2")[1]
    assert larger == pytest.approx(max(elastic, 0.0), rel=1e-6, abs=1e-9)
    assert smaller == pytest.approx(min(elastic, 0.0), rel=1e-6, abs=1e-9)
    state = gx.fields.field_values(equilibrium, film, field="state")[1]
    assert set(state) <= ({2.0} if elastic > 0 else {0.0, 1.0})


def test_fibres_that_shrink_when_heated_pull_along_their_direction(comm) -> None:
    law = gx.LinearOrthotropic(
        100e9, 5e9, 0.0, 2e9, density=1400.0, thickness=THICKNESS, direction=(1.0, 0.0, 0.0)
    )
    expansion = ThermalExpansion((-1e-6, 30e-6), T0 + 80.0, reference=T0)
    scene, end = strip(comm, law, 1.0, expansion)
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    force = equilibrium.reaction(end)[0][0]
    # No strain along, so that the whole thermal strain is stress.
    assert force == pytest.approx(-100e9 * metric(1 - 80e-6) * THICKNESS * WIDTH, rel=1e-6)
    strain = gx.fields.field_values(equilibrium, scene.bodies[0], field="strain1")[1]
    # Across the fibres it is free.
    np.testing.assert_allclose(strain, metric(1 + 30e-6 * 80), rtol=1e-6)


def test_axes_that_are_turned_expand_in_their_own_directions(comm) -> None:
    angle = 0.4
    axis = (math.cos(angle), math.sin(angle), 0.0)
    law = gx.LinearOrthotropic(
        10e9, 5e9, 0.1, 2e9, density=1400.0, thickness=THICKNESS, direction=axis
    )
    film = gx.Membrane(
        sheet(comm, 2, 2), law, thermal=ThermalExpansion((1e-5, 4e-5), T0 + 100.0, reference=T0)
    )
    drag = gx.Damping(film, mass_factor=1.0)
    run = at_rest(film, drag, gx.Fixed(film, "bottom", components=(2,)))
    both = [gx.fields.field_values(run, film, field=name)[1] for name in ("strain1", "strain2")]
    # Larger and smaller principal strain, whatever the axes.
    np.testing.assert_allclose(both[0], metric(1 + 4e-3), rtol=1e-6)
    np.testing.assert_allclose(both[1], metric(1 + 1e-3), rtol=1e-6)


def test_cables_and_beams_between_clamps(comm) -> None:
    curve = line(comm, [(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)], 4)
    cooled = ThermalExpansion(ALPHA, T0 - 40.0, reference=T0)
    cable = gx.Cable(curve, gx.CableLaw(1e4, 0.01), thermal=cooled)
    ends = [gx.Fixed(cable, group) for group in ("start", "end")]
    equilibrium = at_rest(cable, *ends)
    assert equilibrium.reaction(ends[1])[0][0] == pytest.approx(-1e4 * thermal(-40.0), rel=1e-6)

    section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
    beam = gx.Beam(curve, section, thermal=ThermalExpansion(ALPHA, T0 + 40.0, reference=T0))
    ends = [gx.Fixed(beam, group) for group in ("start", "end")]
    equilibrium = at_rest(beam, *ends)
    force = equilibrium.reaction(ends[1])[0][0]
    # The strain of a beam is its elongation, not that of Green: α ΔT.
    assert force == pytest.approx(-section.EA * ALPHA * 40.0, rel=1e-8)


@pytest.mark.mpi
def test_a_group_that_is_hot_relieves_the_others(comm) -> None:
    mesh = crossed_sheet(comm, 4, 1, LENGTH, WIDTH)
    hot = locate_entities(mesh.domain, 2, lambda x: x[0] < LENGTH / 2 + 1e-9)
    named = gx.Mesh(mesh.domain, {**mesh.groups, "hot": (2, hot)})
    law = gx.Linear(2e9, 0.0, density=1400.0, thickness=THICKNESS)
    expansion = ThermalExpansion(ALPHA, {"hot": T0 - 60.0}, reference=T0)
    film = gx.Membrane(named, law, thermal=expansion)
    end = gx.Fixed(film, "right")
    others = [gx.Fixed(film, "left"), gx.Fixed(film, "bottom", components=(2,))]
    equilibrium = at_rest(film, end, *others)
    # Two springs in series; both halves shrink across as well, which changes their widths by 1e-3.
    force = equilibrium.reaction(end)[0][0]
    # Half of the strip shrinks by 60 K: 30 K in the mean.
    assert force == pytest.approx(2e9 * ALPHA * 30.0 * THICKNESS * WIDTH, rel=2e-3)
    temperature = gx.fields.field_values(equilibrium, film, field="temperature")[1]
    assert comm.allreduce(temperature.min(initial=T0), op=min) == pytest.approx(T0 - 60.0)


def test_a_string_that_is_cooled_sounds_higher(comm) -> None:
    """f = √(N/μ)/(2 L), with the tension N of the cold string."""
    tones = []
    stretch = 1 + 1e-3
    for ΔT in (0.0, -30.0):
        curve = line(comm, [(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)], 40)
        string = gx.Cable(
            curve,
            gx.CableLaw(1e4, 0.01),
            thermal=ThermalExpansion(ALPHA, T0 + ΔT, reference=T0),
            displacement=lambda X: (stretch - 1) * X,
        )
        equilibrium = at_rest(string, gx.Fixed(string, "start"), gx.Fixed(string, "end"))
        tension = 1e4 * (metric(stretch) - thermal(ΔT)) * stretch
        # The mass belongs to the natural length, the wave to the stretched one.
        line_density = 0.01 / stretch
        expected = math.sqrt(tension / line_density) / (2 * stretch * LENGTH)
        tone = gx.analysis.modes(equilibrium, 1)[0].frequency
        assert tone == pytest.approx(expected, rel=2e-3)
        tones.append(tone)
    # 30 K raise the tension by half.
    assert tones[1] > 1.2 * tones[0]


# ---- plates --------------------------------------------------------------------------------------


@pytest.mark.mpi(1)
@pytest.mark.parametrize(("cells", "tolerance"), [(8, 3e-3), (16, 1e-3)])
def test_a_plate_that_is_hot_on_its_front_rolls_up(comm, cells: int, tolerance: float) -> None:
    """A cantilever with the curvature κ = α (T_back - T_front)/t is an arc of the angle κ L."""
    law = gx.LinearOrthotropic(
        2e9, 2e9, 0.0, 1e9, density=1400.0, thickness=1e-3, direction=(1.0, 0.0, 0.0)
    )
    expansion = ThermalExpansion((1e-4, 0.0), reference=T0, gradient=lambda X, t: -10.0 * t)
    plate = gx.Plate(sheet(comm, cells, 2, LENGTH, WIDTH), law, thermal=expansion)
    equilibrium = gx.Equilibrium(gx.Scene(plate, gx.Fixed(plate, "left", rotation=True)))
    result = equilibrium.find(at=1.0)
    # α × 10 K over 1 mm.
    curvature = 1e-4 * 10.0 / 1e-3
    x = gx.fields.positions(equilibrium, plate)
    height = comm.allreduce(x[:, 2].max(), op=max)
    # Rise of an arc of 1 rad.
    assert height == pytest.approx((1 - math.cos(curvature)) / curvature, rel=tolerance)
    # Heat has bent the plate before it was free to bend: what it stored then is what was lost.
    stiffness = 2e9 * 1e-9 / 12
    stored = stiffness * curvature**2 / 2 * LENGTH * WIDTH
    assert result.totals.supplied == pytest.approx(stored, rel=1e-6)
    assert result.totals.energy < 3e-3 * stored


def test_a_free_plate_with_a_gradient_is_a_shallow_sphere(comm) -> None:
    law = gx.Linear(2e9, 0.3, density=1400.0, thickness=1e-3)
    κ = 0.002  # 1/m: the plate bends by a tenth of its thickness, and stretches little
    expansion = ThermalExpansion(1e-5, reference=T0, gradient=lambda X, t: -κ * 1e-3 / 1e-5 * t)
    plate = gx.Plate(crossed_sheet(comm, 8, 8, 0.2, 0.2), law, thermal=expansion)
    scene = gx.Scene(
        plate,
        gx.Fixed(plate, "left", components=(0,), direction=(1.0, 0.0, 0.0)),
        gx.Fixed(plate, "bottom", components=(1,), direction=(0.0, 1.0, 0.0)),
    )
    equilibrium = gx.Equilibrium(scene)
    result = equilibrium.find(at=1.0)
    x = gx.fields.positions(equilibrium, plate)
    square = x[:, 0] ** 2 + x[:, 1] ** 2
    lowest = comm.allreduce(x[:, 2].min(initial=np.inf), op=min)
    # Heights above the middle of the sphere, of which this is a quarter.
    np.testing.assert_allclose(x[:, 2] - lowest, κ / 2 * square, atol=0.01 * κ / 2 * 0.08)
    # It bends freely: held flat, it would store ½ ∫ M0:κ0 = D (1 + ν) κ² A.
    stiffness = 2e9 * 1e-9 / (12 * (1 - 0.09))
    held_flat = stiffness * 1.3 * κ**2 * 0.04
    # The heat at the clamped edges is that of the path of the continuation, see
    # `EquilibriumResult`.
    assert result.totals.supplied == pytest.approx(held_flat, rel=0.03)
    assert abs(result.totals.energy) < 0.06 * held_flat


def test_a_linear_temperature_needs_no_stress_in_a_free_plate(comm) -> None:
    """u = ½ α a (X² - Y², 2 X Y) has the strain α a X in both directions."""
    law = gx.Linear(2e9, 0.3, density=1400.0, thickness=1e-3)
    expansion = ThermalExpansion(ALPHA, lambda X, t: T0 + 50.0 * X[0], reference=T0)
    film = gx.Membrane(crossed_sheet(comm, 3, 3), law, order=2, thermal=expansion)
    equilibrium = at_rest(
        film, gx.Fixed(film, "bottom", components=(1, 2)), gx.Fixed(film, "top", components=(2,))
    )
    stress = gx.fields.field_values(equilibrium, film, field="stress1")[1]
    assert abs(stress).max(initial=0.0) < 2 * ALPHA * 50.0 * (2e9 * ALPHA * 50.0)


# ---- gradients -----------------------------------------------------------------------------------


def cooled_drum(comm, law) -> tuple[gx.Membrane, gx.Equilibrium]:
    """A film under pressure that was cooled by 100 K between its edges."""
    expansion = ThermalExpansion(ALPHA, T0 - 100.0, reference=T0)
    film = gx.Membrane(crossed_sheet(comm, 3, 3, 0.5, 0.5), law, thermal=expansion)
    rim = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
    return film, at_rest(film, gx.Pressure(film, 50.0), *rim)


@pytest.mark.parametrize("name", ["alpha", "reference_temperature", "thickness"])
def test_derivatives_of_a_cooled_drum(comm, name: str) -> None:
    """The volume under a film that cooling stretches, against central differences."""
    law = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-2)
    film, equilibrium = cooled_drum(comm, law)
    volume = gx.analysis.EnclosedVolume(film)
    result = gx.analysis.gradient(equilibrium, of=volume, by=[f"film.{name}"])
    derivative = float(result[f"film.{name}"].values.sum())
    term = next(t for t in equilibrium.system.unknowns.terms_of(film) if hasattr(t, "thermal"))
    parameter = next(p for p in term.parameters if p.name == name)
    value = float(parameter.source.value)
    volumes = []
    for factor in (1 + 1e-4, 1 - 1e-4):
        parameter.source.value = factor * value
        equilibrium.system.parameters_changed()
        equilibrium.find()
        volumes.append(volume(equilibrium))
    difference = (volumes[0] - volumes[1]) / (2e-4 * value)
    assert derivative == pytest.approx(difference, rel=1e-5)


def test_a_field_of_temperatures_is_a_variable(comm) -> None:
    """The sum of the derivatives by all temperatures is minus that by the reference temperature."""
    law = gx.Linear(2.5e9, 0.34, density=1420.0, thickness=25e-6)
    film, equilibrium = cooled_drum(comm, law)
    volume = gx.analysis.EnclosedVolume(film)
    names = ["film.temperature", "film.reference_temperature"]
    result = gx.analysis.gradient(equilibrium, of=volume, by=names)
    by_temperature = float(result[names[0]].values.sum())
    assert by_temperature == pytest.approx(-float(result[names[1]].values.sum()), rel=1e-9)
    assert by_temperature > 0  # warmer film is less taut


# ---- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"alpha": 17.0}, "alpha is 17.0 1/K; give a number between -0.01 and 0.01"),
        ({"alpha": 1e-5, "temperature": {"film": -5.0}}, "temperature is {'film': -5.0}"),
        ({"alpha": math.nan}, "alpha"),
    ],
)
def test_expansions_that_make_no_sense_are_refused(arguments, words: str) -> None:
    with pytest.raises(gx.InputError, match=re.escape(words)):
        ThermalExpansion(**arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"alpha": (1e-5, 2e-5)}, "alpha has two numbers, but its law has no axes"),
        ({"alpha": 1e-5, "gradient": 3.0}, "only a Plate bends by it"),
    ],
)
def test_films_refuse_expansions_of_other_bodies(comm, arguments, words: str) -> None:
    law = gx.Linear(2e9, 0.3, density=1400.0, thickness=THICKNESS)
    with pytest.raises(gx.InputError, match=re.escape(words)):
        gx.Membrane(sheet(comm, 2, 2), law, thermal=ThermalExpansion(**arguments))


@pytest.mark.parametrize(
    ("temperature", "words"),
    [
        ({"nowhere": 5.0}, "its temperature: the mesh has no group 'nowhere'"),
        ({"left": 5.0}, "the group 'left' has dimension 1; name a group of the cells"),
        (lambda X, t: np.zeros(3), "it must return finite numbers"),
        (lambda X, t: np.nan * X[0], "finite numbers"),
        (lambda X, t: -1.0 - X[0], "its temperature is below 0 K at t = 0 s"),
        (lambda X: X[0], "TypeError"),
    ],
)
def test_temperatures_that_make_no_sense_are_refused(comm, temperature, words: str) -> None:
    law = gx.Linear(2e9, 0.3, density=1400.0, thickness=THICKNESS)
    film = gx.Membrane(sheet(comm, 3, 3), law, thermal=ThermalExpansion(1e-5, temperature))
    with pytest.raises(gx.InputError, match=re.escape(words)):
        gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3))


def test_what_has_no_thermal_form_says_so(comm) -> None:
    law = gx.Linear(2e9, 0.3, density=1400.0, thickness=1e-3)
    warm = ThermalExpansion(1e-5, gradient=2.0)
    plate = gx.Plate(sheet(comm, 2, 2), law, thermal=warm)
    turned = gx.Fixed(
        plate, "left", direction=lambda X, t: np.vstack([1 + 0 * X[0], 0 * X[0], t + 0 * X[0]])
    )
    with pytest.raises(gx.InputError, match="clamp it in a constant direction"):
        gx.Simulation(gx.Scene(plate, turned), gx.Midpoint(dt=1e-3))
    film = gx.Membrane(sheet(comm, 2, 2), law, thermal=ThermalExpansion(1e-5))
    with pytest.raises(gx.InputError, match="has a thermal expansion, which sampled cells"):
        from gossamer_fx.analysis.reduction.reduced_membrane import check_reducible

        check_reducible(film)
