"""A form is found, cut into strips, laid flat, sewn and tensioned: how far it is from the form."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.revolved import torus
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


def largest_tension(equilibrium, films):
    """The largest principal tension [N/m] in films of 0.1 mm."""
    stresses = [gx.fields.field_values(equilibrium, film, field="stress1")[1] for film in films]
    return 1e-4 * max(float(stress.max()) for stress in stresses)


def pressures(films, value):
    return [gx.Pressure(film, value, name=f"pressure on {film.name}") for film in films]


def planes_round_the_axis(count, shift=0.0):
    """Points and normals of planes through the z axis that make `count` sectors."""
    angle = np.pi * np.arange(count // 2) / (count // 2) + shift
    normals = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    return np.zeros_like(normals), normals


def test_gores_of_an_inflated_dish_give_its_paraboloid():
    """z = r²/4f, f = 1 m, of 12 gores that meet in one point; the tension p f of its curvature 1/2f
    keeps the form, and the cord along the held rim has its force."""
    angle = 2 * np.pi * (np.arange(48) + 0.5) / 48
    circle = 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    form = gx.patterns.height_surface(lambda x, y: (x**2 + y**2) / 4, outline=circle, size=0.08)
    strips = form.cut(form.by_planes(*planes_round_the_axis(12)))
    assert len(strips) == len(strips.seams) == 12
    film = gx.Linear(E=3e9, nu=0.3, density=1400.0, thickness=25e-6)
    rims = [name for name in form.groups if name.startswith("rim")]
    panels = strips.flatten(film, tension=50.0, edge_cables=dict.fromkeys(rims, (CORD, 5.0)))
    films = panels.films(size=0.09)
    held = [gx.Fixed(f, name) for f in films for name in rims if name in f.mesh.groups]
    cords = panels.cables(films)
    seams = panels.seams(films)
    scene = gx.Scene(*films, *seams, *cords, *held, *pressures(films, -50.0))
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    # 0.2 mm of 1 m
    assert panels.deviation(films, at=equilibrium).rms < 4e-4
    forces = [gx.probes.Tension(cord)(equilibrium) for cord in cords]
    assert forces == pytest.approx([5.0] * len(forces), rel=1e-6)


def test_rings_of_a_torus_are_sewn_and_inflated(comm):
    """Each ring is one panel that is sewn to itself on the inside, and to both neighbours.  Rings
    are straight along the torus: they are off it by about the sagitta w²/8(R + r)."""
    form = gx.patterns.surface(torus(comm, 0.5, 0.1, 40, 10))
    inside = form.by_planes([[0, 0, 1e-3]], (0, 0, 1))
    inside.sort(key=lambda line: line.length)
    # Not through corners of the mesh
    strips = form.cut([*form.by_planes(*planes_round_the_axis(20, shift=0.01)), inside[0]])
    assert len(strips) == 20 and len(strips.seams) == 40
    pressure = 2000.0
    film = gx.Linear(E=3e9, nu=0.3, density=1400.0, thickness=25e-6)
    panels = strips.flatten(film, tension=(pressure * 0.1 / 2, pressure * 0.1))
    around = 2 * np.pi * 0.1
    assert [panel.width for panel in panels] == pytest.approx([around] * 20, rel=0.03)
    films = panels.films(size=0.08)
    scene = gx.Scene(*films, *panels.seams(films), *pressures(films, pressure))
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    width = 2 * np.pi * 0.6 / 20
    assert panels.deviation(films, at=equilibrium).rms < width**2 / 8 / 0.6


def test_a_pillow_roof_of_geodesic_strips_has_the_found_form(comm):
    """The form of a film of 1000 N/m under 300 Pa over a square of 2 m, cut into four strips."""
    tension = 1000.0
    law = gx.analysis.Prestress(1e9, 0.3, density=1750.0, thickness=1e-4, tension=tension)
    film = gx.Membrane(sheet(comm, 12, 12, 2.0, 2.0, crossed=True), law)
    points = film.space.mesh.geometry.x
    points[:, 2] = 0.1 * np.sin(np.pi * points[:, 0] / 2) * np.sin(np.pi * points[:, 1] / 2)

    def scene():
        held = [gx.Fixed(film, edge) for edge in EDGES]
        return gx.Scene(film, *held, gx.Pressure(film, 300.0))

    gx.analysis.find_form(film, scene)
    form = gx.patterns.surface(film)
    across = np.array([[0.5, 0, 0], [1.0, 0, 0], [1.5, 0, 0]])
    lines = form.geodesics(across, across + np.array([0, 2, 0]))
    etfe = gx.Linear(E=1.6e9, nu=0.45, density=1750.0, thickness=1e-4)
    panels = form.cut(lines).flatten(etfe, tension=tension)
    films = panels.films(size=0.16)
    held = [gx.Fixed(f, edge) for f in films for edge in EDGES if edge in f.mesh.groups]
    sewn_roof = gx.Scene(*films, *panels.seams(films), *held, *pressures(films, 300.0))
    equilibrium = gx.Equilibrium(sewn_roof)
    equilibrium.find()
    # 0.7 mm of 89 mm, and 9 % more than the tension
    assert panels.deviation(films, at=equilibrium).rms < 1e-3
    assert largest_tension(equilibrium, films) < 1.15 * tension


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
