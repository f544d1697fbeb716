"""A form is found, cut into strips, laid flat, sewn and tensioned: how far it is from the form."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import CORNERS, EDGES, sheet
from tests.pattern_shapes import CYLINDER, grid

TENSION = 10.0  # N/m
FORCE = 20.0  # N, of the edge cables
STIFFNESS = 3000.0  # N/m, E t
LAW = gx.Linear(E=STIFFNESS / 1e-4, nu=0.3, density=1000.0, thickness=1e-4)
CORD = gx.TensionOnly(EA=1e4, line_density=1e-3)


def saddle(comm, cells):
    """The form of a four-corner film of uniform tension with edge cables."""
    law = gx.analysis.Prestress(1e9, 0.3, density=1000.0, thickness=1e-5, tension=TENSION)
    film = gx.Membrane(sheet(comm, cells, cells, crossed=True), law)
    points = film.space.mesh.geometry.x
    x = points[:, 0].copy()
    y = points[:, 1].copy()
    points[:, 2] = 0.4 * (x + y - 2 * x * y)

    def scene():
        held = [gx.Fixed(film, corner) for corner in CORNERS]
        cables = [gx.analysis.EdgeCable(film, edge, force=FORCE) for edge in EDGES]
        return gx.Scene(film, *held, *cables)

    gx.analysis.find_form(film, scene)
    return gx.patterns.surface(film)


def cut_in(form, count):
    points = [[k / count, 0, 0] for k in range(1, count)]
    return form.cut(form.by_planes(points, (1, 0, 0)))


def sewn(panels, size):
    """Films, cables and the equilibrium of the sewn panels."""
    films = panels.films(size=size)
    cables = panels.cables(films)
    held = [
        gx.Fixed(film, corner) for film in films for corner in CORNERS if corner in film.mesh.groups
    ]
    scene = gx.Scene(*films, *panels.seams(films), *cables, *held)
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    return films, cables, equilibrium


def test_more_strips_are_nearer_to_the_form(comm):
    """The strain of a strip of width w is about K w²/8, with K = 0.8² of the middle of the saddle:
    its stress is the excess over the wanted tension, in the panels as laid flat and as sewn."""
    form = saddle(comm, 24)
    edge_cables = dict.fromkeys(EDGES, (CORD, FORCE))
    deviations = []
    for count in (3, 5):
        panels = cut_in(form, count).flatten(LAW, tension=TENSION, edge_cables=edge_cables)
        estimate = STIFFNESS * 0.8**2 / count**2 / 8
        assert 0.6 < (panels.tensions[:, 0].max() - TENSION) / estimate < 1.1
        films, cables, equilibrium = sewn(panels, 0.08)
        largest = 0.0
        smallest = np.inf
        for film in films:
            for field in ("stress1", "stress2"):
                _, stress = gx.fields.field_values(equilibrium, film, field=field)
                largest = max(largest, float(stress.max()) * 1e-4)
                smallest = min(smallest, float(stress.min()) * 1e-4)
        assert 0.4 < (largest - TENSION) / estimate < 1.0
        # Taut everywhere, as the panels are compensated.
        assert smallest > -0.1 * TENSION
        forces = [gx.probes.Tension(cable)(equilibrium) for cable in cables]
        assert forces == pytest.approx([FORCE] * len(forces), rel=0.03)
        deviations.append(panels.deviation(films, at=equilibrium).rms)
    # 0.6 and 0.2 mm of 1 m
    assert deviations[0] < 1e-3
    assert deviations[1] < deviations[0] / 2.5


@pytest.mark.mpi
def test_panels_of_a_cylinder_are_sewn_to_the_cylinder(comm):
    """Developed panels with a tension along and across, held at the form: nothing moves.  On two
    ranks the panels are the same."""
    form = gx.patterns.surface(grid(CYLINDER, 24, 8), comm=comm)
    strips = form.cut(form.by_planes([[0, 0, 0.43]], (0, 0, 1)))
    panels = strips.flatten(LAW, tension=(30.0, 10.0))
    films = panels.films(size=0.15)
    seams = panels.seams(films)
    assert [abs(seam.ease) < 1e-9 for seam in seams] == [True]
    groups = {name for film in films for name in film.mesh.groups}
    # In one order on all ranks
    names = sorted(name for name in groups if name.startswith("rim"))
    assert len(names) == 4
    held = [gx.Fixed(film, name) for film in films for name in names if name in film.mesh.groups]
    # Balances n1/R of the tension around
    bent = [gx.Pressure(film, 30.0, name=f"pressure on {film.name}") for film in films]
    equilibrium = gx.Equilibrium(gx.Scene(*films, *seams, *held, *bent))
    start = panels.deviation(films, at=equilibrium)
    assert np.abs(start.distances).max() < 1e-12
    equilibrium.find()
    # Facets of π/24: the film between the nodes is off by the sagitta of chords.
    assert abs(panels.deviation(films, at=equilibrium).largest) < 3e-3
    for film in films:
        _, stress = gx.fields.field_values(equilibrium, film, field="stress1")
        assert stress.mean() * 1e-4 == pytest.approx(30.0, rel=0.05)
