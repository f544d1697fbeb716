"""The model of braided tori: surface, cables, waves, and the radius under more pressure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import gossamer_fx as gx
from demos.validation.__main__ import CASES, MODELS
from demos.validation.engine.case import read_case
from demos.validation.models import braided_torus

CASE = read_case(CASES / "hiad_torus.toml", MODELS)
TORUS = braided_torus.Torus.read(CASE.tests[1].inputs)


def test_the_mesh_is_a_closed_torus_with_its_cords(comm):
    along = 16
    around = 6
    line = np.column_stack([np.full(2 * along, 1.5), np.zeros(2 * along)])
    φ = braided_torus.section_angles(TORUS, around)
    mesh = braided_torus.torus_mesh(comm, braided_torus.surface(line, 0.17, φ), [0, 4])
    # Normals outwards: pressure acts from inside.  The curved cells are near the torus.
    volume = 2 * math.pi**2 * 1.5 * 0.17**2
    assert mesh.enclosed_volume() == pytest.approx(volume, rel=5e-3)
    film = gx.Membrane(mesh, gx.Linear(1e9, 0.3, density=1e3, thickness=1e-4), order=2)
    scene = gx.Scene(film, gx.Pressure(film, 1.0))
    load = gx.Equilibrium(scene).system
    # A closed surface: the pressure has no resultant.
    total = np.abs(load.equations.load_forces().array.reshape(-1, 3).sum(axis=0)).max()
    assert total < 1e-12
    law = gx.CableLaw(1.0, 1.0)
    for name in ("cord 0", "cord 1"):
        tape = gx.connectors.Tape.along_edges(film, law, edges=name)
        # Both cords are half of the minor radius further in than the centre line.
        circle = 2 * math.pi * (1.5 - 0.17 / 2)
        assert float(sum(tape.lengths)) == pytest.approx(circle, rel=2e-3)


def test_cells_of_a_section_go_from_cord_to_cord():
    """Two cords at 240° and one each at 210, 300 and 330°: columns of nodes at each, and parts of
    the perimeter that add up to it."""
    angles = np.deg2rad([240.0, 330.0, 240.0, 300.0, 210.0])
    torus = replace(TORUS, tube=replace(TORUS.tube, cord_angles=angles))
    φ = braided_torus.section_angles(torus, 12)
    cells = [1, 2, 1, 8]
    at_cords = np.concatenate([[0], np.cumsum(cells)[:-1]]) * 2
    assert np.rad2deg(φ[at_cords]) == pytest.approx([210, 240, 300, 330])
    parts = braided_torus.section_parts(φ)
    assert parts.sum() == pytest.approx(2 * math.pi)
    # The centre of gravity of a circle is its centre, whatever the cells.
    assert parts @ np.cos(φ) == pytest.approx(0.0, abs=0.05)


def test_four_cords_on_two_lines_bear_what_two_strong_ones_do(comm):
    """A torus with pairs of cords at 240° and 300° has the tapes of two, with twice the force."""
    angles = np.deg2rad([240.0, 300.0, 300.0, 240.0])
    torus = replace(TORUS, tube=replace(TORUS.tube, cord_angles=angles, cord_force=2000.0))
    line = np.column_stack([np.full(32, 1.5), np.zeros(32)])
    model = braided_torus.build(torus, comm, line, 6, torus.tube.pressure)
    tapes = [item for item in model.search.scene.items if isinstance(item, gx.connectors.Tape)]
    assert len(tapes) == 2
    one = np.interp(0.01, torus.tube.cord_strain, torus.tube.cord_table)
    for tape in tapes:
        assert float(tape.law.force_at(np.array(0.01))) == pytest.approx(2 * one)


def test_a_cable_pulls_along_its_line_with_its_stiffness():
    # Two points without a common coordinate: no component of the force is zero.
    pulley = np.array([0.6, 0.0, -0.2])
    X = np.array([1.5, 0.1, -0.1])
    cable = braided_torus.Cable(None, pulley, 45.0, 1e6)
    assert cable.tension(X + 1.0) == 45.0
    cable.hold(X)
    cable.begin(1e-3, 0.0, X, 0 * X)
    # 45 N of pretension, and 1e6 N/m for 1 mm.
    assert cable.tension(X) == pytest.approx(45.0 + 1e3)
    force = cable.force(X)
    # The force is parallel to the cable.
    assert np.cross(force, pulley - X) == pytest.approx(np.zeros(3), abs=1e-9)
    differences = np.zeros((3, 3))
    for j, step in enumerate(1e-6 * np.eye(3)):
        # Central differences with 1 µm.
        differences[:, j] = (cable.force(X + step) - cable.force(X - step)) / 2e-6
    assert cable.tangent(X) == pytest.approx(differences, rel=1e-6, abs=1.0)
    # A slack cable does not push.
    cable.begin(-1.0, 0.0, X, 0 * X)
    assert cable.tension(X) == 0.0


def test_amplitudes_are_those_of_a_wave():
    # 96 points resolve five waves.
    θ = np.arange(96) * 2 * math.pi / 96
    radius = 1.5 + 4e-3 * np.cos(3 * θ + 1) + 1e-3 * np.sin(5 * θ)
    # Amplitudes of the waves 3, 4 and 5, by orthogonality to round-off.
    assert braided_torus.amplitudes(radius) == pytest.approx([4e-3, 0.0, 1e-3], abs=1e-12)


def test_the_torus_grows_with_the_pressure_as_its_cords_do(comm):
    """Two cords carry p π r² (1 - 2 cot²β), and the radius follows their strain; coarse."""
    case = read_case(CASES / "hiad_torus_growth.toml", MODELS)
    inputs = case.tests[0].inputs
    prediction = braided_torus.predict(inputs, comm, True)
    growth = float(prediction.quantities["growth of the mean radius"].y)
    torus = braided_torus.Torus.read(inputs)
    tube = torus.tube
    later = replace(tube, cord_force=tube.cord_force * 137.9 / 34.5)
    strain = later.cord_strain_after_inflation() - tube.cord_strain_after_inflation()
    # The cords are on a circle that is half a minor radius smaller; the wall and the section count,
    # too.
    assert growth == pytest.approx(strain * torus.shape_radius.mean(), rel=0.2)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"first_forces": {"value": [1.0], "unit": "N"}}, "first_forces 1 numbers"),
        ({"cord_angles": {"value": [210, 213], "unit": "deg"}}, "5 degrees apart"),
        ({"cord_unloading_force": {"value": [1, 2], "unit": "N"}}, "cord_unloading_force 2"),
        ({"cells_along": {"value": 20, "unit": "1"}}, "cells_around' is missing"),
        ({"shape": {"value": [[1.5, 0.0]], "unit": "m"}}, "shape has 1 points"),
        ({"pulleys": {"value": [[0.6, -0.2]], "unit": "m"}}, "pulleys has 1 rows"),
        ({"largest_load": {"value": 10, "unit": "N"}}, "above the sum of first_forces"),
        ({"braid_angle": {"value": 95, "unit": "deg"}}, "give one below 90"),
        ({"cord_force": {"value": 90, "unit": "kN"}}, "give a smaller force"),
        ({"pulleys": {"value": [[1, 2, 3]], "unit": "m"}}, "pulleys has 3 columns"),
    ],
)
def test_bad_inputs_are_refused_in_one_sentence(changes, words):
    inputs = CASE.tests[0].inputs
    with pytest.raises(gx.InputError, match=words):
        braided_torus.Torus.read(replace(inputs, values={**inputs.values, **changes}))
