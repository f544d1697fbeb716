"""Figures of the demos that answer questions: a white figure, curves in it, films in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import gossamer_fx as gx
from gossamer_fx.extend import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours that remain different in print and for colour-blind readers.
BLUE = "#1f5fa8"
RED = "#c0392b"
GREEN = "#2e7d4f"
GREY = "#7a7a7a"

# Above and below a legend, of the height of the axes.
LEGEND_GAP = 0.02


def new_figure(width: float = 10.0, height: float = 3.9) -> Figure:
    """An empty figure of a size in inches, of a hundred pixels each."""
    # Imported here, as scipy is below: a scene that takes a colour only does not load them.
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=100, facecolor="white", layout="constrained")


def save(figure: Figure, path: Path, title: str = "") -> None:
    """Write a figure as PNG, with a title if one is given; missing folders are made."""
    if title:
        figure.suptitle(title)
    for axes in figure.axes:
        if axes.get_legend() is not None and axes.name != "3d":
            _uncover_curves(axes)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    print(f"picture written to {path}")


def _uncover_curves(axes: Any) -> None:
    """Make room above the curves of axes for their legend, if it covers one of them."""
    legend = axes.get_legend()
    # The layout of the whole figure decides where both are; axes may be those of a part of it.
    axes.figure.canvas.figure.draw_without_rendering()
    box = legend.get_window_extent()
    frame = axes.get_window_extent()
    curves = [line.get_transform().transform_path(line.get_path()) for line in axes.lines]
    if not any(curve.intersects_bbox(box, filled=False) for curve in curves):
        return
    share = (box.height + 2 * LEGEND_GAP * frame.height) / frame.height
    scale = axes.yaxis.get_transform()
    low, high = scale.transform(axes.get_ylim())
    # Labels for an axis of the whole range would name values that no curve has.
    ticks = [tick for tick in axes.get_yticks() if low <= scale.transform([tick])[0] <= high]
    axes.set_ylim(top=scale.inverted().transform([low + (high - low) / (1 - share)])[0])
    axes.set_yticks(ticks)
    legend.set_loc("upper center")


def finish(axes: Any, xlabel: str, ylabel: str, **legend: Any) -> None:
    """Label the axes of curves, with a grid, and a legend if a curve has a label.

    Args:
        axes: of the curves.
        xlabel, ylabel: quantities and units.
        legend: further arguments of the legend, e.g. `loc`.
    """
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**{"frameon": False, "fontsize": 8, **legend})


def triangles(system: Any, film: gx.Membrane) -> Array:
    """Present positions (n, 3, 3) [m] of the corners of the triangles that this rank owns."""
    return corners_at(film, system.unknowns.state[film].local_positions())


def corners_at(film: gx.Membrane, positions: Array) -> Array:
    """Corners (n, 3, 3) [m] of the triangles that this rank owns, for positions of the nodes (owned
    and ghost)."""
    # A reduced film has the positions of the film that was reduced.
    space = film.full.space
    owned = space.mesh.topology.index_map(2).size_local
    return positions[space.dofmap.list[:owned, :3]]


def flat_triangles(film: gx.Membrane) -> Array:
    """Corners (n, 3, 3) [m], in the mesh, of the triangles that this rank owns."""
    return corners_at(film, film.full.space.tabulate_dof_coordinates())


def area_vectors(corners: Array) -> Array:
    """Area vectors (n, 3) [m²] of triangles (n, 3, 3) [m]."""
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    return np.asarray(np.cross(first, second) / 2)


def petals_of(
    surfaces: Sequence[gx.orbit.Surface],
    root: Sequence[float] = (0.0, 0.0, 0.0),
    slope: float = 1.0,
    cells: int = 8,
) -> Array:
    """Trapezoids of the areas and centres of flat surfaces, as triangles (n, 3, 3) [m] in body
    axes.

    Args:
        surfaces: of a sail; each becomes a trapezoid, symmetric about the line from the root to its
            centre.
        root: where the sides of the trapezoids would meet [m].
        slope: half of the width over the distance from the root; 1 for the petals of a square sail.
        cells: along a side, each with two triangles.
    """
    across_ticks = np.linspace(-1.0, 1.0, cells + 1)
    found = []
    for surface in surfaces:
        normal = np.array(surface.normal) / np.linalg.norm(surface.normal)
        to_centre = np.array(surface.centre) - np.array(root)
        distance = float(np.linalg.norm(to_centre))
        outward = to_centre / distance
        across = np.cross(normal, outward)
        inner, outer = trapezoid(surface.area / slope, distance)
        reach = np.linspace(inner, outer, cells + 1)[:, None, None]
        # Points (cells + 1, cells + 1, 3): along the petal, then across.
        grid = root + reach * (outward + slope * across_ticks[None, :, None] * across)
        a = grid[:-1, :-1].reshape(-1, 3)
        b = grid[1:, :-1].reshape(-1, 3)
        c = grid[1:, 1:].reshape(-1, 3)
        d = grid[:-1, 1:].reshape(-1, 3)
        found += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return np.concatenate(found)


def trapezoid(area: float, centroid: float) -> tuple[float, float]:
    """Distances from the axis of both ends of a trapezoid whose half width is the distance from the
    axis.

    Its area is r₂² - r₁² [m²], its centroid at ⅔ (r₂³ - r₁³)/(r₂² - r₁²) [m]. A triangle has the
    nearest centroid that is possible, ⅔ r₂; it is taken if the given one is nearer.
    """
    if centroid <= 2 / 3 * area**0.5:
        return 0.0, area**0.5

    def excess(inner: float) -> float:
        outer = (area + inner**2) ** 0.5
        return 2 / 3 * (outer**3 - inner**3) / area - centroid

    from scipy.optimize import brentq

    # With the inner end at the centroid the trapezoid would be beyond it.
    inner = float(brentq(excess, 0.0, centroid))
    return inner, (area + inner**2) ** 0.5


def draw_film(
    axes: Any,
    corners: Array,
    colour: str = "#c9d8e8",
    view: tuple[float, float] = (20.0, -60.0),
    alpha: float = 1.0,
    zoom: float = 1.0,
) -> None:
    """Draw triangles (n, 3, 3) in axes of the projection "3d", at the same scale along x, y and z.

    Args:
        axes: what `figure.add_subplot(projection="3d")` returned; limits are set by the first film.
        corners: positions of the corners [m].
        colour: of the faces.
        view: elevation and azimuth of the eye [°].
        alpha: opacity.
        zoom: of the first film in its axes; below 1 for axes that are narrow.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    faces = Poly3DCollection(
        corners, facecolors=colour, edgecolors="#5b7188", linewidths=0.25, shade=True, alpha=alpha
    )
    is_first = not axes.collections
    axes.add_collection3d(faces)
    # The box of the axes is seen from its side, and would cut the corners of what is in it.
    faces.set_clip_on(False)
    if is_first:
        low = corners.min(axis=(0, 1))
        high = corners.max(axis=(0, 1))
        # A flat film has no extent across: a thin box is drawn around it.
        extent = (high - low).clip(min=0.05 * (high - low).max())
        middle = (high + low) / 2
        for name, centre, size in zip("xyz", middle, extent, strict=True):
            getattr(axes, f"set_{name}lim")(centre - size / 2, centre + size / 2)
        axes.set_box_aspect(extent, zoom=zoom)
    axes.view_init(elev=view[0], azim=view[1])
    axes.set_axis_off()


def draw_films(
    shapes: Mapping[str, Array], path: Path, view: tuple[float, float], height: float = 3.2
) -> None:
    """Write a picture of films (n, 3, 3) [m] side by side, each with its title."""
    figure = new_figure(10.5, height)
    for place, (title, corners) in enumerate(shapes.items(), start=1):
        axes = figure.add_subplot(1, len(shapes), place, projection="3d")
        draw_film(axes, corners, view=view)
        axes.set_title(title, fontsize=10)
    save(figure, path)


def arrow_of_flight(axes: Any, start: float, length: float) -> None:
    """An arrow along x in axes of space, from a point of the x axis [m]."""
    axes.quiver(start, 0, 0, length, 0, 0, color=RED, lw=2)
    axes.text(start + length / 2, 0, 0.35, "flight", color=RED, ha="center")
