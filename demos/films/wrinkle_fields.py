"""State of a film and direction of its wrinkles in two static problems.

    bent strip       a tensioned film, bent in its plane until two fifths of its height wrinkle
    square airbag    two square sheets under pressure, seen from above

Cells are coloured by their state.  A line in each wrinkled cell has the direction of tension, which
is that of crests and troughs; its width grows with the shortening of the film across it.

    ./gossamer demo wrinkle_fields
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import new_figure, save
from demos.studies import airbag, bending_strip
from gossamer_fx.extend import STATE_COLOURS, STATES, Array, FieldFunctions

LAW = "Miyazaki 1e-6"  # name of a law in both studies
K = 3.0  # curvature of the strip, E t H² κ/(2 P)
# Signs of x and y by which a quarter of the airbag becomes the whole.
MIRRORS = ((1, 1), (-1, 1), (1, -1), (-1, -1))


@dataclass(frozen=True)
class Wrinkles:
    """Of n cells: corners (n, 3, 3) [m], state (n,), direction of tension (n, 3), smaller principal
    strain (n,)."""

    corners: Array
    state: Array
    direction: Array
    strain2: Array

    def mirrored(self, x: int, y: int) -> Wrinkles:
        """The image in the planes x = 0 and y = 0 where a sign is -1."""
        flip = np.array([x, y, 1])
        return Wrinkles(self.corners * flip, self.state, self.direction * flip, self.strain2)


def wrinkles(film: gx.Membrane, search: gx.Equilibrium) -> Wrinkles:
    """Fields of a film of order 1 on one rank."""
    fields = FieldFunctions(search.system, film, ["state", "direction", "strain2"])
    fields.update()
    x = search.system.unknowns.q0.array_r.reshape(-1, 3)
    # Each field has one vector a cell.
    by_cell = []
    for function in fields.functions:
        dofs = function.function_space.dofmap
        by_cell.append(function.x.array.reshape(-1, dofs.bs)[dofs.list[:, 0]])
    state, direction, strain2 = by_cell
    return Wrinkles(x[film.space.dofmap.list], state[:, 0], direction, strain2[:, 0])


def bent_strip(cells: int = 32) -> Wrinkles:
    """The strip of the study, with `cells` cells over its height."""
    law = bending_strip.LAWS[LAW]
    moved, search = bending_strip.bent_strip(MPI.COMM_SELF, law, 1, K, cells)
    search.find()
    return wrinkles(moved.body, search)


def square_airbag(cells: int = 16) -> list[Wrinkles]:
    """The four quarters of the upper sheet."""
    film, search = airbag.airbag(MPI.COMM_SELF, airbag.LAWS[LAW], 1, cells)
    search.find()
    quarter = wrinkles(film, search)
    return [quarter.mirrored(*signs) for signs in MIRRORS]


def draw(scenes: dict[str, list[Wrinkles]], path: Path) -> None:
    """The films from above, side by side, each with its title."""
    from matplotlib.patches import Patch

    figure = new_figure(11.0, 5.3)
    aspect_ratios = []
    for parts in scenes.values():
        corners = np.concatenate([part.corners.reshape(-1, 3) for part in parts])
        width, height, _ = np.ptp(corners, axis=0)
        aspect_ratios.append(width / height)
    panels = figure.subplots(1, len(scenes), width_ratios=aspect_ratios)
    for axes, (title, parts) in zip(panels, scenes.items(), strict=True):
        for part in parts:
            _draw_part(axes, part)
        axes.set(aspect="equal")
        axes.autoscale_view()
        axes.set_axis_off()
        axes.set_title(title, fontsize=11)
    key = [Patch(color=_pale(STATES[name]), label=name) for name in ("taut", "wrinkled", "slack")]
    figure.legend(handles=key, loc="outside lower center", ncols=3, frameon=False)
    # The first drawing computes the layout that the second one uses.
    figure.draw_without_rendering()
    save(figure, path)


def _draw_part(axes: Any, part: Wrinkles) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    corners = part.corners[:, :, :2]
    colours = [_pale(round(state)) for state in part.state]
    axes.add_collection(
        PolyCollection(corners, facecolors=colours, edgecolors="white", linewidths=0.3)
    )

    is_wrinkled = part.state == STATES["wrinkled"]
    edge_lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    cell_size = edge_lengths.mean(axis=1)
    # A line is two thirds as long as the edges of its cell.
    half_line = 0.33 * (part.direction[:, :2] * cell_size[:, None])[is_wrinkled]
    centre = corners.mean(axis=1)[is_wrinkled]
    lines = np.stack([centre - half_line, centre + half_line], axis=1)
    # The largest tenth of the shortening has the full line width.
    shortening = -part.strain2[is_wrinkled]
    weight = np.clip(shortening / np.percentile(shortening, 90), 0.1, 1.0)
    axes.add_collection(
        LineCollection(lines, colors=(0.30, 0.14, 0.0), linewidths=0.3 + 0.8 * weight)
    )


def _pale(state: int) -> tuple[float, ...]:
    return tuple(1 - 0.62 * (1 - c) for c in STATE_COLOURS[state])


def main(output: str | Path | None = None) -> dict[str, float]:
    """Return the share of wrinkled cells of both films; with `output`, a folder, draw a picture."""
    strip = bent_strip()
    bag = square_airbag()
    if output is not None:
        scenes = {f"Tensioned film, bent by K = {K:g}": [strip], "Square airbag under 5 kPa": bag}
        draw(scenes, Path(output) / "wrinkle_fields.png")
    return {
        "strip wrinkled": float((strip.state == STATES["wrinkled"]).mean()),
        "airbag wrinkled": float((bag[0].state == STATES["wrinkled"]).mean()),
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/wrinkle_fields"))
