"""Stresses, tensions and states of films are means over the last step, as its stress rule used
them: of paths that pass from slack to taut, whose means are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, sheet
from tests.small_scenes import LINEAR, MATERIAL

COMM = MPI.COMM_WORLD
# Stretches at the ends of the step, slack and taut, and the strains there.
SLACK, TAUT = 0.9, 1.2
E0, E1 = (SLACK**2 - 1) / 2, (TAUT**2 - 1) / 2
TAUT_SHARE = E1 / (E1 - E0)
DT = 0.1
STIFFNESS = 1e3  # of lines [N], or [N/m] of ropes of 1 m

STEPPERS: dict[str, Any] = {
    "mean": gx.Midpoint(dt=DT),
    "middle": gx.steppers.VariationalMidpoint(dt=DT),
    "end": gx.GeneralizedAlpha(dt=DT),
}


def stretched(X: np.ndarray, t: float) -> np.ndarray:
    """The displacement from the origin that goes from slack to taut within a step."""
    return (SLACK - 1 + (TAUT - SLACK) * t / DT) * X


def sheet_in_motion(law: gx.extend.FilmLaw | Any) -> tuple[gx.Membrane, gx.Scene]:
    """A film of two triangles, all nodes of which are moved."""
    film = gx.Membrane(sheet(COMM, 1, 1), law, displacement=lambda X: stretched(X, 0.0))
    edges = [gx.Fixed(film, edge, motion=stretched) for edge in ("left", "right")]
    return film, gx.Scene(film, *edges)


def after_a_step(scene: gx.Scene, stepper: Any, **further: Any) -> gx.Simulation:
    run = gx.Simulation(scene, stepper, **further)
    run.run(until=DT)
    assert run.step == 1
    return run


def stress_of(strain: float) -> float:
    """The stress [Pa] of the film at a strain in all its directions."""
    return MATERIAL["E"] / (1 - MATERIAL["nu"]) * max(strain, 0.0)


ORTHOTROPIC = gx.Orthotropic(
    E1=MATERIAL["E"],
    E2=MATERIAL["E"],
    nu12=MATERIAL["nu"],
    G12=MATERIAL["E"] / 2 / (1 + MATERIAL["nu"]),
    density=MATERIAL["density"],
    thickness=MATERIAL["thickness"],
    direction=(1.0, 0.0, 0.0),
)


# The law in C is summed over twenty points of the path.
@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("law", "accuracy"), [(gx.TensionField(**MATERIAL), 1e-7), (ORTHOTROPIC, 0.03)]
)
def test_a_film_that_becomes_taut_is_taut_for_a_part_of_the_step(law: Any, accuracy: float) -> None:
    film, scene = sheet_in_motion(law)
    run = after_a_step(scene, gx.Midpoint(dt=DT))
    mean_stress = stress_of(E1) * TAUT_SHARE / 2
    for at, share, stress in (("mean", TAUT_SHARE, mean_stress), ("end", 1.0, stress_of(E1))):
        taut = gx.probes.AreaFraction(film, "taut", at=at)(run)
        slack = gx.probes.AreaFraction(film, "slack", at=at)(run)
        assert taut == pytest.approx(share, rel=accuracy)
        assert slack == pytest.approx(1 - share, abs=accuracy)
        _, state = gx.fields.field_values(run, film, field="state", at=at)
        assert state == pytest.approx(2 * share, rel=accuracy)
        _, stress1 = gx.fields.field_values(run, film, field="second_piola_stress1", at=at)
        assert stress1 == pytest.approx(stress, rel=accuracy)
        _, displacement = gx.fields.field_values(run, film, field="displacement", at=at)
        largest = COMM.allreduce(float(displacement.max(initial=0.0)), op=MPI.MAX)
        assert largest == pytest.approx(TAUT - 1, rel=1e-12)


@pytest.mark.parametrize("rule", STEPPERS)
def test_other_rules_use_the_stress_of_one_strain(rule: str) -> None:
    film, scene = sheet_in_motion(gx.TensionField(**MATERIAL))
    run = after_a_step(scene, STEPPERS[rule])
    middle = (((SLACK + TAUT) / 2) ** 2 - 1) / 2
    stress = {
        "mean": stress_of(E1) * TAUT_SHARE / 2,
        "middle": stress_of(middle),
        "end": stress_of(E1),
    }
    _, stress1 = gx.fields.field_values(run, film, field="second_piola_stress1")
    assert stress1 == pytest.approx(stress[rule], rel=1e-7)
    taut = gx.probes.AreaFraction(film, "taut")(run)
    assert taut == pytest.approx({"mean": TAUT_SHARE}.get(rule, 1.0), rel=1e-7)


def cable() -> tuple[Any, list[Any], float]:
    body = gx.Cable(
        line(COMM, [(0, 0, 0), (1, 0, 0)], 1),
        gx.TensionOnly(STIFFNESS, 0.01),
        displacement=lambda X: stretched(X, 0.0),
    )
    ends = [gx.Fixed(body, end, motion=stretched) for end in ("start", "end")]
    # The force of the mean stress acts at the mean stretch.
    mean = STIFFNESS * E1 * TAUT_SHARE / 2 * (SLACK + TAUT) / 2
    return body, [body, *ends], mean


def between(connect: Callable[[Any, Any], Any]) -> tuple[Any, list[Any], float]:
    """A connector of 1 m from the ground to the end of a body that is moved."""
    body, parts, _ = cable()
    connector = connect(gx.Ground((0.0, 0.0, 0.0)), body.port("end"))
    # The tension of a rope is linear in its length where it is taut.
    mean = STIFFNESS * (TAUT - 1) ** 2 / 2 / (TAUT - SLACK)
    return connector, [*parts, connector], mean


def rope() -> tuple[Any, list[Any], float]:
    return between(
        lambda a, b: gx.connectors.Rope(a, b, stiffness=STIFFNESS, length=1.0, name="rope")
    )


def tether() -> tuple[Any, list[Any], float]:
    return between(
        lambda a, b: gx.connectors.Tether(
            a, b, stiffness=STIFFNESS, length=lambda t: 1.0, name="tether"
        )
    )


@pytest.mark.mpi(1)
@pytest.mark.parametrize("make", [cable, rope, tether])
def test_the_tension_of_a_line_is_the_mean_of_the_step(make: Any, tmp_path: Path) -> None:
    part, items, mean = make()
    tension = gx.probes.Tension(part)
    at_end = gx.probes.Tension(part, at="end")
    scene = gx.Scene(*items)
    run = gx.Simulation(scene, gx.Midpoint(dt=DT))
    # Before the first step both are those of the state.
    assert tension(run) == at_end(run) == 0
    run.run(until=DT)
    assert tension(run) == pytest.approx(mean, rel=1e-7)
    assert at_end(run) > 1.5 * mean
    values = gx.fields.line_values(run, part)
    assert values.tension == pytest.approx(mean, rel=1e-7)
    # Strain and length are those at the end.
    assert values.length == pytest.approx(TAUT, rel=1e-7)
    assert gx.fields.line_values(run, part, at="end").tension == pytest.approx(at_end(run))


@pytest.mark.mpi(1)
def test_a_restored_tether_has_the_mean_tension_of_the_step_before() -> None:
    part, items, mean = tether()
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=DT))
    run.run(until=DT)
    tension = gx.probes.Tension(part)
    before = tension(run)
    start = run.history.save()
    run.run(until=2 * DT)
    assert tension(run) > 1.1 * before
    run.history.restore(start)
    assert tension(run) == before == pytest.approx(mean, rel=1e-7)


@pytest.mark.mpi
def test_the_work_of_the_mean_tension_is_the_change_of_energy() -> None:
    mass = gx.PointMass(1.0, position=(0.3, 0.0, 0.0), comm=COMM, name="mass")
    rope = gx.connectors.Rope(gx.Ground((0.0, 0.0, 0.0)), mass.port(), stiffness=100.0, length=0.2)
    scene = gx.Scene(mass, rope)
    position = gx.probes.Position(mass.port(), "x")
    series = gx.Series({"tension": gx.probes.Tension(rope), "x": position, "energy": stored})
    # A step of half of the period.
    gx.Simulation(scene, gx.Midpoint(dt=0.1), outputs=[series]).run(until=2.0)
    work = series["tension"][1:] * np.diff(np.abs(series["x"]))
    assert work == pytest.approx(np.diff(series["energy"]), abs=1e-11)
    assert np.abs(work).max() > 0.1


def stored(run: gx.Simulation) -> float:
    return run.totals.stored["rope"]


def test_thermal_stress_is_the_mean_of_the_step() -> None:
    warming = gx.materials.ThermalExpansion(1e-5, temperature=lambda X, t: 293.15 - 100 * t / DT)
    film = gx.Membrane(sheet(COMM, 1, 1), LINEAR, thermal=warming)
    held = [gx.Fixed(film, edge) for edge in ("left", "right")]
    run = after_a_step(gx.Scene(film, *held), gx.Midpoint(dt=DT))
    thermal = 1e-5 * -100 * (1 + 1e-5 * -100 / 2)
    at_end = -MATERIAL["E"] / (1 - MATERIAL["nu"]) * thermal
    for at, stress in (("mean", at_end / 2), ("end", at_end)):
        _, stress1 = gx.fields.field_values(run, film, field="second_piola_stress1", at=at)
        assert stress1 == pytest.approx(stress, rel=1e-7)


@pytest.mark.mpi
def test_a_restarted_run_knows_the_means_of_its_last_step(comm: Any, tmp_path: Path) -> None:
    folder = comm.bcast(tmp_path)
    film, scene = sheet_in_motion(gx.TensionField(**MATERIAL))
    run = after_a_step(scene, STEPPERS["mean"], checkpoints=gx.Checkpoints(folder / "kept"))
    again, same_scene = sheet_in_motion(gx.TensionField(**MATERIAL))
    restarted = gx.Simulation(same_scene, STEPPERS["mean"], restart=folder / "kept")
    for body, now in ((film, run), (again, restarted)):
        assert gx.probes.AreaFraction(body, "taut")(now) == pytest.approx(TAUT_SHARE, rel=1e-7)


@pytest.mark.mpi
def test_a_restarted_run_knows_the_temperatures_before_its_last_step(
    comm: Any, tmp_path: Path
) -> None:
    """The mean stress of the step in which a film cools by 100 K is that of 50 K."""
    folder = comm.bcast(tmp_path)

    def scene() -> tuple[gx.Membrane, gx.Scene]:
        cooling = gx.materials.ThermalExpansion(
            1e-5, temperature=lambda X, t: 293.15 - 100 * t / DT
        )
        film = gx.Membrane(sheet(COMM, 2, 2), LINEAR, thermal=cooling)
        return film, gx.Scene(*(gx.Fixed(film, edge) for edge in EDGES))

    film, first = scene()
    run = after_a_step(first, gx.Midpoint(dt=DT), checkpoints=gx.Checkpoints(folder / "kept"))
    again, same_scene = scene()
    restarted = gx.Simulation(same_scene, gx.Midpoint(dt=DT), restart=folder / "kept")
    stress = MATERIAL["E"] / (1 - MATERIAL["nu"]) * 1e-5 * 50
    for body, now in ((film, run), (again, restarted)):
        # The thermal strain is not linear in the temperature.
        assert gx.probes.LargestStress(body)(now) == pytest.approx(stress, rel=2e-3)
    assert gx.probes.LargestStress(again)(restarted) == pytest.approx(
        gx.probes.LargestStress(film)(run), rel=1e-12
    )


def test_the_moment_of_a_step_is_that_of_the_mean_difference_of_temperature() -> None:
    """A clamped plate whose front is heated by 100 K in a step: D (1 + ν) α ΔT/t with half of
    it."""
    heated = gx.materials.ThermalExpansion(1e-5, gradient=lambda X, t: 100 * t / DT)
    plate = gx.Plate(sheet(COMM, 2, 2), LINEAR, thermal=heated)
    held = [gx.Fixed(plate, edge, rotation=True) for edge in EDGES]
    still = gx.Fixed(plate, "film", name="still")
    run = after_a_step(gx.Scene(still, *held), gx.Midpoint(dt=DT))
    E, t, nu = MATERIAL["E"], MATERIAL["thickness"], MATERIAL["nu"]
    stiffness = E * t**3 / 12 / (1 - nu**2)
    at_end = stiffness * (1 + nu) * 1e-5 * 100 / t
    for at, moment in (("mean", at_end / 2), ("end", at_end)):
        _, moment1 = gx.fields.field_values(run, plate, field="moment1", at=at)
        assert moment1 == pytest.approx(moment, rel=1e-9)


def test_an_output_says_which_values_it_has(tmp_path: Path) -> None:
    _, scene = sheet_in_motion(gx.TensionField(**MATERIAL))
    shares = {}
    for at in ("mean", "end"):
        folder = tmp_path / at
        after_a_step(scene, gx.Midpoint(dt=DT), outputs=[gx.Recording(folder, at=at, every=1)])
        reader = gx.plot.RunReader(folder)
        assert reader.about["at"] == at
        shares[at] = reader.table("states.csv")["film taut"][-1]
        (state,) = reader.values("state", 1)
        assert state == pytest.approx(2 * shares[at], rel=1e-6)
    assert shares == pytest.approx({"mean": TAUT_SHARE, "end": 1.0}, rel=1e-7)
    with pytest.raises(gx.InputError, match="at"):
        gx.Recording(tmp_path / "middle", at="middle")  # type: ignore[arg-type]
