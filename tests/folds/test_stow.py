"""A film that is stowed by tools: pressed, folded over a line, packed and let go."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.sheet import sheet

SPACING = 4e-3
FILM = gx.Miyazaki(E=1e8, nu=0.3, density=1000.0, thickness=1e-4, residual_stiffness=1e-2)


def strip(comm, up="z"):
    """A strip of 0.2 m by 0.1 m in the plane z = 0, or turned so that `up` is its normal."""
    turned = {"z": lambda X: 0 * X, "x": lambda X: np.stack([X[2] - X[0], 0 * X[0], -X[0] - X[2]])}
    return gx.Membrane(sheet(comm, 2, 1, 0.2, 0.1), FILM, displacement=turned[up], name="strip")


def stowing(film, stow, **options):
    control = gx.StepControl(max_step=stow.longest_step, max_factor=1.3)
    return gx.Simulation(
        gx.Scene(film, stow), gx.Midpoint(dt=stow.first_step), control=control, **options
    )


def test_a_strip_is_folded_over_a_line_and_stays_in_its_box(comm):
    """Half as long and two layers high, without a crossing; what the tools do is supplied."""
    film = strip(comm)
    stow = gx.fold.Stow(film, spacing=SPACING, layers=1).press()
    stow = stow.fold((0.1, 0.05, 0.0), (1.0, 0.0, 0.0)).release()
    assert stow.layers_at_end == 2 and len(stow.ends) == 3
    run = stowing(film, stow)
    assert stow.box(run) == pytest.approx([0.2, 0.1, 0.0])
    run.run(until=stow.end)
    long, wide, high = stow.box(run)
    assert 0.09 < long < 0.12 and 0.09 < wide < 0.12
    # The gap between the layers and a bend round the blade
    assert 0.5 * SPACING < high < 3 * SPACING
    assert gx.probes.Penetrations(stow.contact)(run) == 0
    assert gx.probes.Crossings(film)(run) == 0
    assert abs(run.energy_error) < 1e-10
    # The side over which the other one was laid has not moved, as grips hold it.
    state = run.system.unknowns.state
    for corner in ((0.2, 0.0, 0.0), (0.2, 0.1, 0.0)):
        moved = state.vector(film.port_at(corner)) - corner
        assert np.abs(moved[:2]).max() < SPACING
    assert stow.slip(run) < SPACING


def test_a_fold_that_has_slipped_is_warned_of(comm, caplog):
    """Film that nothing lifts lies behind the line when the fold is said to be made."""
    film = strip(comm)
    stow = gx.fold.Stow(film, spacing=SPACING, layers=1).fold((0.1, 0.05, 0.0), (1.0, 0.0, 0.0))
    run = stowing(film, stow)
    assert stow.slip(run) == 0.0
    run.system.unknowns.previous_time = stow.end - 1e-3
    run.system.unknowns.time = stow.end
    assert stow.slip(run) > 0.08
    stow.before_step(run, 1e-3)
    assert "after fold 1 film lies up to 0.08" in caplog.text


@pytest.mark.mpi
def test_grips_hold_what_no_fold_lifts(comm):
    """Two folds across each other leave a quarter of a sheet, in which two far nodes are held."""
    film = gx.Membrane(sheet(comm, 4, 4, 0.2, 0.2), FILM, name="sheet")
    stow = gx.fold.Stow(film, spacing=SPACING, layers=1)
    halves = stow.fold((0.1, 0.1, 0.0), (1.0, 0.0, 0.0))
    quarters = halves.fold((0.1, 0.1, 0.0), (0.0, -1.0, 0.0))
    held = {
        item.origin for item in quarters.requires() if isinstance(item, gx.connectors.AxialSpring)
    }
    # The corner is furthest from both lines.
    assert (0.2, 0.0, 0.0) in {tuple(np.round(point, 12)) for point in held}
    assert len(held) == 2
    for x, y, _ in held:
        assert x > 0.1 and y < 0.1
    assert not any(isinstance(item, gx.connectors.AxialSpring) for item in stow.press().requires())


def test_stowing_does_not_depend_on_the_directions_of_space(comm):
    film = strip(comm)
    stow = gx.fold.Stow(film, spacing=SPACING, layers=1).press()
    run = stowing(film, stow)
    turned = strip(comm, "x")
    turned_stow = gx.fold.Stow(turned, spacing=SPACING, layers=1, up=(1.0, 0.0, 0.0)).press()
    turned_run = stowing(turned, turned_stow)
    for each in (run, turned_run):
        each.run(until=stow.end)
    assert turned_stow.box(turned_run)[::-1][1:] == pytest.approx([0.1, 0.2], abs=1e-6)
    x = run.system.unknowns.state[film].positions()
    turned_x = turned_run.system.unknowns.state[turned].positions()
    assert turned_x[:, 0] == pytest.approx(x[:, 2], abs=1e-9)


@pytest.mark.mpi
def test_a_scene_starts_from_a_film_that_another_process_has_stowed(comm, tmp_path):
    """The stow is made again, and its run restarted from checkpoints: the stress-free shape stays
    that of the film, and its shape is the stowed one."""
    folder = comm.bcast(tmp_path)

    def stowed(**options):
        film = strip(comm)
        stow = gx.fold.Stow(film, spacing=SPACING, layers=1).press().pack((0.19, 0.1, SPACING * 3))
        return film, stow, stowing(film, stow, **options)

    film, stow, run = stowed(checkpoints=gx.Checkpoints(folder / "saves", every=None))
    run.run(until=stow.end)
    there = run.system.unknowns.state[film].positions().copy()
    assert stow.box(run)[0] < 0.19
    film, stow, again = stowed(restart=folder / "saves")
    assert again.time == run.time
    contact = gx.Contact(film, distance=SPACING)
    start = gx.StartFrom(again.system)
    deployed = gx.Simulation(gx.Scene(film, contact, start), gx.Midpoint(dt=1e-3))
    assert deployed.time == 0.0
    assert np.array_equal(deployed.system.unknowns.state[film].positions(), there)
    stored = deployed.totals.stored["strip"]
    assert stored == pytest.approx(run.totals.stored["strip"], rel=1e-9)


@pytest.mark.mpi
def test_tools_wait_outside_of_the_film_as_it_was_made(comm):
    """The second blade comes over where the first third of the strip lay, whose end is as high as
    the blade."""
    raised = 3.25 * SPACING

    def displacement(X):
        return np.stack([0 * X[0], 0 * X[0], raised * np.maximum(1 - X[0] / 0.1, 0.0)])

    film = gx.Membrane(sheet(comm, 3, 1, 0.3, 0.1), FILM, displacement=displacement, name="strip")
    stow = gx.fold.Stow(film, spacing=SPACING, layers=1).fold((0.1, 0.05, 0.0), (1.0, 0.0, 0.0))
    stow = stow.fold((0.2, 0.05, 0.0), (-1.0, 0.0, 0.0)).pack((0.12, 0.12, 0.05))
    assert stow.layers_at_end == 4
    # Contact refuses layers that intersect at the start.
    stowing(film, stow)


@pytest.mark.mpi
def test_a_box_that_is_too_small_for_its_film_is_warned_of(comm):
    """0.02 m² at 4 mm need 8e-5 m³."""
    stow = gx.fold.Stow(strip(comm), spacing=SPACING, layers=1).press()
    small = stow.pack((0.1, 0.1, 7e-3))
    (warning,) = small.warnings([])
    assert "the box has 7e-05 m³, and the film, at its spacing of 0.004 m, needs 8e-05" in warning
    assert not list(stow.pack((0.1, 0.1, 9e-3)).warnings([]))
    assert not list(stow.warnings([]))


def test_folds_that_cannot_be_made_are_refused(comm):
    film = strip(comm)
    stow = gx.fold.Stow(film, spacing=SPACING, layers=1)
    assert stow.end == 0.0
    with pytest.raises(gx.InputError, match="encloses no gas"):
        stow.evacuate(10.0)
    half = stow.fold((0.1, 0, 0), (1, 0, 0))
    # The film then lies from 0.1 to 0.2 m.
    with pytest.raises(gx.InputError, match=r"fold 2: the line .* does not cross the film"):
        half.fold((0.05, 0, 0), (1, 0, 0)).end  # noqa: B018
    assert half.fold((0.15, 0, 0), (1, 0, 0)).layers_at_end == 4
    with pytest.raises(gx.InputError, match="has no part along the floor"):
        stow.fold((0.1, 0, 0), (0, 0, 1)).end  # noqa: B018
    with pytest.raises(gx.InputError, match="up is"):
        gx.fold.Stow(film, spacing=SPACING, up=(0, 0, 0))


@pytest.mark.slow
def test_an_airbag_that_was_stowed_inflates_to_the_shape_of_one_that_was_not(comm):
    """Emptied, pressed, folded, and let go; volume and potential then agree to round-off, with a
    residual stiffness of 1e-6.  Half a minute."""
    half = 0.1
    film = gx.Miyazaki(E=1e8, nu=0.3, density=1000.0, thickness=1e-4, residual_stiffness=1e-6)
    spacing = 3e-3

    def opened(side):
        """The layers are opened in the middle."""

        def displacement(X):
            height = 2 * spacing * (1 - (X[0] / half) ** 2) * (1 - (X[1] / half) ** 2)
            return np.stack([0 * X[0], 0 * X[0], side * height])

        return displacement

    sides = {"top": opened(1), "bottom": opened(-1)}
    bag = gx.Membrane(airbag(comm, 2 * half, 4), film, displacement=sides)
    stow = gx.fold.Stow(bag, spacing=spacing).evacuate(2.0).press().fold((0, 0, 0), (1, 0, 0))
    stow = stow.release()
    run = stowing(bag, stow)
    run.run(until=stow.end)
    assert stow.box(run)[0] < 1.05 * half
    assert gx.probes.Crossings(bag)(run) == 0
    assert abs(run.energy_error) < 1e-12
    volume = gx.analysis.EnclosedVolume(bag)
    pressure = 2000.0
    found = []
    for start in ([gx.StartFrom(run.system)], []):
        rising = gx.Pressure(bag, lambda t: pressure * min(t / 0.2, 1.0))
        damping = gx.Damping(bag, mass_factor=20.0, stiffness_factor=1e-3)
        scene = gx.Scene(bag, rising, damping, gx.Contact(bag, distance=spacing), *start)
        control = gx.StepControl(max_step=1e-2, max_factor=1.3)
        inflated = gx.Simulation(scene, gx.Midpoint(dt=1e-3), control=control)
        inflated.run(until=0.5)
        assert abs(inflated.energy_error) < 1e-12
        at_rest = gx.Scene(bag, gx.Pressure(bag, pressure), gx.StartFrom(inflated.system))
        equilibrium = gx.Equilibrium(at_rest)
        result = equilibrium.find()
        enclosed = volume(equilibrium)
        found.append((enclosed, result.totals.stored["film"] - pressure * enclosed))
    assert found[0] == pytest.approx(found[1], rel=1e-10)
