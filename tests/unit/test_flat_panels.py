"""Flat panels of strips: exact where these can be developed, else nearest to the tension."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sphere import sphere
from tests.pattern_shapes import CONE, CYLINDER, surface_of

FILM = gx.Linear(E=3e7, nu=0.3, density=1000.0, thickness=1e-4)
WOVEN = {"density": 1000.0, "thickness": 1e-4}
LAWS = {
    "isotropic": FILM,
    "woven": gx.LinearOrthotropic(4e7, 1e7, 0.2, 1e6, direction=(1, 0, 0), **WOVEN),
    "woven on the bias": gx.Orthotropic(4e7, 1e7, 0.2, 1e6, direction=(1, 1, 0), **WOVEN),
    "rubber": gx.materials.NeoHooke(1e7, **WOVEN),
}


def cut_across(form):
    return form.cut(form.by_planes([[0, 0, 1.3], [0, 0, 1.1]], (0, 0, 1)))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("tension", [0.0, 30.0, (50.0, 10.0)])
def test_strips_of_a_cone_become_panels_without_error(law, tension):
    """The strain from the panel to the form is that of the tension everywhere, to 1e-12."""
    strips = cut_across(surface_of(CONE, 30, 12))
    panels = strips.flatten(LAWS[law], tension=tension)
    assert np.abs(panels.flat.strain - panels.tensioned.strain).max() < 1e-12
    # Distances on the panel are those on the cone, less the strain.
    for panel, strip in zip(panels, strips, strict=True):
        stretch = np.linalg.det(np.eye(2) + strain_matrix(panels.tensioned.strain))
        assert panel.area == pytest.approx(strip.area / np.sqrt(stretch), rel=1e-12)


def strain_matrix(e):
    """2 E (2, 2) of (E11, E22, 2 E12)."""
    return np.array([[2 * e[0], e[2]], [e[2], 2 * e[1]]])


def test_a_strip_round_a_cylinder_is_a_rectangle():
    """Of the length of its polygon, compensated by n (1 - ν)/(E t): S = n as both stretches are
    the same, E = S (1 - ν)/(E t), λ² = 1 + 2 E."""
    form = surface_of(CYLINDER, 40, 10)
    strips = form.cut(form.by_planes([[0, 0, 0.43]], (0, 0, 1)))
    panels = strips.flatten(FILM, tension=30.0)
    stretch = np.sqrt(1 + 2 * 30.0 * 0.7 / 3000.0)
    around = 80 * np.sin(np.pi / 80)
    assert [panel.length for panel in panels] == pytest.approx([around / stretch] * 2, rel=1e-12)
    assert [panel.width for panel in panels] == pytest.approx(
        [0.43 / stretch, 0.57 / stretch], rel=1e-12
    )
    assert panels.tensions == pytest.approx(30.0, rel=1e-9)


def test_tension_along_and_across_follows_the_panel():
    """n1 = 50 N/m acts along the seams, in both directions of cutting the cylinder."""
    form = surface_of(CYLINDER, 40, 20)
    around = form.cut(form.by_planes([[0, 0, 0.43]], (0, 0, 1)))
    along = form.cut(form.by_planes([[0.1, 0, 0]], (1, 0, 0)))
    for strips in (around, along):
        panels = strips.flatten(FILM, tension=(50.0, 10.0))
        S1, S2, S12 = panels.flat.tension.T
        l1, l2 = np.sqrt(1 + 2 * panels.flat.strain[:, :2].T)
        # Cauchy tension n1 = S1 λ1/λ2
        assert S1 * l1 / l2 == pytest.approx(50.0)
        assert S2 * l2 / l1 == pytest.approx(10.0)
        assert np.abs(S12).max() < 1e-9


def zone(count):
    """A zone of a sphere between the latitudes ±60 degrees, three of `count` gores wide."""

    def position(u, v):
        latitude = np.pi / 3 * (2 * v - 1)
        longitude = 3 * 2 * np.pi / count * (u - 0.5)
        return (
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        )

    return surface_of(position, 36, 40)


@pytest.mark.parametrize("equal_seams", [True, False])
def test_gores_of_a_sphere_have_the_width_of_the_sphere(equal_seams):
    """w = 2 π R cos φ/n at the latitude φ: the gore of least energy is narrower by a part of the
    order w², as its middle line is stretched and its seams are compressed."""
    errors = []
    for count in (12, 24):
        form = zone(count)
        angles = np.array([-np.pi / count, np.pi / count])
        normals = np.stack([-np.sin(angles), np.cos(angles), 0 * angles], axis=1)
        strips = form.cut(form.by_planes(np.zeros((2, 3)), normals))
        assert len(strips) == 3
        panels = strips.flatten(FILM, equal_seams=equal_seams)
        gore = panels[1]
        left, right = (part for part in gore.boundary if part.name.startswith("seam"))
        found = []
        for latitude in (0.0, 0.5):
            widths = []
            for part in (left, right):
                at = np.argsort(part.form[:, 2])
                along = part.form[at, 2]
                widths.append(np.interp(np.sin(latitude), along, part.flat[at, 1]))
            exact = 2 * np.pi * np.cos(latitude) / count
            found.append(abs(abs(widths[0] - widths[1]) / exact - 1))
        errors.append(max(found))
    # The facets of the sphere take 1e-4 of both.
    assert errors[0] < 0.004
    assert errors[1] < errors[0] / 2.5


def test_both_sides_of_a_seam_have_the_same_length_edge_by_edge():
    """Strips of a saddle, the seams of which are not in the middle, differ by 1e-4 without this."""

    def saddle(u, v):
        return u, v, 0.5 * u * (1 - u) * (1 + v)

    form = surface_of(saddle, 20, 20)
    strips = form.cut(form.by_planes([[0, 0.3, 0], [0, 0.45, 0]], (0, 1, 0)))

    def differences(panels):
        X = panels.flat.points
        found = []
        for seam in strips.seams:
            left = np.linalg.norm(np.diff(X[seam.left], axis=0), axis=1)
            right = np.linalg.norm(np.diff(X[seam.right], axis=0), axis=1)
            found += [*(left / right - 1)]
        return np.abs(found).max()

    assert differences(strips.flatten(FILM, tension=5.0)) < 1e-12
    assert differences(strips.flatten(FILM, tension=5.0, equal_seams=False)) > 1e-5


def test_a_panel_of_a_sphere_is_the_one_of_least_energy():
    """No small change of the panel has a smaller energy (1) of the module."""
    form = zone(12)
    strips = form.cut(form.by_planes([[0, 0, 0]], [[0, 1, 0]]))
    law = LAWS["woven"]
    panels = strips.flatten(law, tension=(30.0, 10.0), equal_seams=False)
    mesh = strips.mesh
    C = panels.tensioned.stiffness

    def energy(X):
        x = mesh.points[mesh.triangles]
        sides = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], axis=2)
        flat = X[mesh.triangles]
        flat_sides = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
        F = sides @ np.linalg.inv(flat_sides)
        G = np.swapaxes(F, 1, 2) @ F
        e = np.stack([(G[:, 0, 0] - 1) / 2, (G[:, 1, 1] - 1) / 2, G[:, 0, 1]], axis=1)
        e = e - panels.tensioned.strain
        areas = np.linalg.norm(np.cross(sides[:, :, 0], sides[:, :, 1]), axis=1) / 2
        return float((areas * np.einsum("ni,ij,nj->n", e, C, e)).sum() / 2)

    X = panels.flat.points
    least = energy(X)
    assert least > 0
    rng = np.random.default_rng(0)
    for _ in range(5):
        # The direction of a panel is given: changes across it have no part that turns.
        change = rng.normal(size=X.shape) * [1, 0] * 1e-6
        ahead = energy(X + change)
        back = energy(X - change)
        assert abs(ahead - back) < 1e-3 * (ahead + back - 2 * least)


def test_gores_of_a_whole_sphere_are_laid_flat():
    """Their seams pass through corners of an irregular mesh, or nearly, which leaves narrow
    triangles."""
    form = gx.patterns.surface(sphere(MPI.COMM_SELF, 1.0, 40))
    angles = np.pi * np.arange(6) / 6
    normals = np.stack([-np.sin(angles), np.cos(angles), 0 * angles], axis=1)
    panels = form.cut(form.by_planes(np.zeros((6, 3)), normals)).flatten(FILM, tension=30.0)
    assert [panel.length for panel in panels] == pytest.approx([np.pi] * 12, rel=0.02)
    assert [panel.width for panel in panels] == pytest.approx([np.pi / 6] * 12, rel=0.03)


def test_strips_that_cannot_be_laid_flat_are_refused():
    angle = 2 * np.pi * np.arange(24) / 24
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([ring + np.array([0, 0, z]) for z in (0.0, 0.5, 1.0)])
    triangles = []
    for level in range(2):
        for k in range(24):
            a, b = 24 * level + k, 24 * level + (k + 1) % 24
            triangles += [(a, b, b + 24), (a, b + 24, a + 24)]
    tube = gx.patterns.surface((points, triangles))
    rings = tube.cut(tube.by_planes([[0, 0, 0.3]], (0, 0, 1)))
    with pytest.raises(gx.InputError, match="strip 0 is closed in itself"):
        rings.flatten(FILM)
    # A line along the tube opens it: one panel that is sewn to itself.
    open_tube = tube.cut([tube.along([[1, 0, 0], [1, 0, 1]])])
    panels = open_tube.flatten(FILM)
    assert panels[0].area == pytest.approx(tube.area, rel=1e-12)
    films = panels.films(size=0.3)
    (seam,) = panels.seams(films)
    assert seam.a is seam.b and abs(seam.ease) < 1e-12


def test_laws_and_cables_that_do_not_fit_are_refused():
    form = surface_of(CYLINDER, 8, 4)
    strips = form.cut(form.by_planes([[0, 0, 0.4]], (0, 0, 1)))
    law = gx.analysis.Prestress(1e7, 0.3, density=1e3, thickness=1e-4, tension=10.0)
    with pytest.raises(gx.InputError, match="Prestress has no strain"):
        strips.flatten(law, tension=10.0)
    with pytest.raises(gx.InputError, match="strains the film by"):
        strips.flatten(FILM, tension=3000.0)
    around = gx.LinearOrthotropic(
        1e7, 1e7, 0.3, 1e6, direction=gx.materials.AroundAxis((0, 0, 1)), **WOVEN
    )
    with pytest.raises(gx.InputError, match="not one vector"):
        strips.flatten(around)
    cord = (gx.TensionOnly(EA=1e4, line_density=1e-3), 10.0)
    with pytest.raises(gx.InputError, match="no edge 'top'"):
        strips.flatten(FILM, edge_cables={"top": cord})
