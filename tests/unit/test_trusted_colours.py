"""Colours can be read back: the number of a pixel is that of the film there."""

from __future__ import annotations

import math
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from PIL import Image

import gossamer_fx as gx
from gossamer_fx.app.cli.command import main
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.plot.camera import View, aim, render
from gossamer_fx.records.plot.colours import MISSING_COLOUR, Limits, by_state, colouring
from gossamer_fx.records.plot.colours import scale as scale_of
from gossamer_fx.records.plot.page import Views, write_page
from gossamer_fx.records.plot.plot import strip_views
from gossamer_fx.records.plot.shapes import Shape

LAW = gx.Miyazaki(1e9, 0.3, density=1400.0, thickness=1e-5, residual_stiffness=1e-3)
LIFT = 0.6  # m at the far edge of the film, and along the other film


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> gx.plot.RunReader:
    """A film that is bent up to the parabola u = LIFT x² and slack where x < ½, and a flat one
    whose only field is its displacement, 2 LIFT."""

    def bent(X: np.ndarray) -> np.ndarray:
        # Slack: both directions are shortened by 5 %.
        shorter = -0.05 * np.minimum(X[0] - 0.5, 0)
        return np.vstack([shorter, -0.05 * X[1] * (X[0] < 0.5), LIFT * X[0] ** 2])

    def beside(X: np.ndarray) -> np.ndarray:
        return np.vstack([0 * X[0], 2 * LIFT + 0 * X[0], 0 * X[0]])

    bent_film = gx.Membrane(sheet(MPI.COMM_SELF, 16, 16), LAW, displacement=bent, name="bent")
    flat_film = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2), LAW, displacement=beside, name="flat")
    folder = tmp_path_factory.mktemp("colours") / "run"
    fields = {"bent": ("displacement", "stress1", "state"), "flat": ("displacement",)}
    recording = gx.Recording(folder, fields, every=1)
    scene = gx.Scene(bent_film, flat_film)
    gx.Simulation(scene, gx.Midpoint(dt=1e-6), outputs=[recording]).run(until=2e-6)
    return gx.plot.RunReader(folder)


def drawn(run: gx.plot.RunReader, field: str, limits: Limits) -> tuple[np.ndarray, Any]:
    """The picture (height, width, 3) of the first state, and its colours."""
    colours = colouring(run, field, limits, [0])
    shape = colours.shape(run, 0)
    image = next(render(aim([shape], FLAT), [shape], 150.0, colours))
    return image, colours


# Of pictures whose colours are read back.
FLAT = View(flat=True)


def is_inside(image: np.ndarray) -> np.ndarray:
    """Pixels whose neighbours have about their colour: no edges, outlines or hatches."""
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), constant_values=1.0)
    height, width = image.shape[:2]
    inside = (image < 0.999).any(axis=2)
    for row in range(3):
        for column in range(3):
            neighbour = padded[row : row + height, column : column + width]
            inside &= abs(neighbour - image).max(axis=2) < 0.05
    return inside


def nearest(image: np.ndarray, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the table that are nearest to pixels (n, 3), and the distances of their channels."""
    distances = abs(image[:, None] - table[None]).max(axis=2)
    return distances.argmin(axis=1), distances.min(axis=1)


@pytest.mark.parametrize("low", [0.0, -2 * LIFT])
def test_every_pixel_of_a_bent_film_has_a_colour_of_the_bar(
    recorded: gx.plot.RunReader, low: float
) -> None:
    """Light and shade would leave it: a lit film is bright on one side and dark on the other."""
    image, colours = drawn(recorded, "displacement", Limits(low=low, high=2 * LIFT))
    pixels = image[is_inside(image)]
    assert len(pixels) > 5000
    _, distance = nearest(pixels, colours.table[:-1])
    # A pixel may be the mean of two neighbours on the bar.
    assert distance.max() < 0.02


def test_an_animation_keeps_the_colours_of_the_bar(
    recorded: gx.plot.RunReader, tmp_path: Path
) -> None:
    """Within four of 255 steps: a GIF has 255 colours besides white, which stays white."""
    gx.plot.animate(recorded, "displacement", path=tmp_path / "a.gif", seconds=0.2, view=FLAT)
    with Image.open(tmp_path / "a.gif") as frames:
        frames.seek(1)
        image = np.asarray(frames.convert("RGB")) / 255
    assert image[-2, 1] == pytest.approx(1.0)
    is_coloured = is_inside(image) & (np.ptp(image, axis=2) > 0.1)
    _, distance = nearest(image[is_coloured], colouring(recorded, "displacement").table[:-1])
    assert distance.max() < 4.5 / 255 + 0.01


def test_numbers_are_read_back_from_a_picture(recorded: gx.plot.RunReader) -> None:
    """The flat film has one number, 1.2 m of the bar to 1.5 m, within half of a colour."""
    image, colours = drawn(recorded, "displacement", Limits(low=0.0, high=1.5, part="flat"))
    is_coloured = is_inside(image) & (np.ptp(image, axis=2) > 0.1)
    rows, _ = nearest(image[is_coloured], colours.table[:-1])
    count = len(colours.table) - 1
    assert np.unique(rows / (count - 1)) == pytest.approx([2 * LIFT / 1.5], abs=0.5 / count)


def test_a_part_without_the_field_is_grey_and_the_legend_says_so(
    recorded: gx.plot.RunReader,
) -> None:
    _, colours = drawn(recorded, "stress1", Limits())
    assert colours.has_missing
    shape = colours.shape(recorded, 0)
    grey = shape.kinds == len(colours.table) - 1
    # The flat film is the one with y > 1.2.
    assert (grey == (shape.corners[:, :, 1].mean(axis=1) > 2 * LIFT)).all()
    assert grey.any() and not grey.all()
    assert colours.table[-1] == pytest.approx(MISSING_COLOUR)
    assert not drawn(recorded, "displacement", Limits())[1].has_missing
    # Also of the states, of which the flat film has none.
    states = colouring(recorded, "state")
    assert states.has_missing and (states.shape(recorded, 0).kinds == len(states.table) - 1).any()


def test_one_part_alone_is_coloured_on_its_own_limits(recorded: gx.plot.RunReader) -> None:
    _, both = drawn(recorded, "displacement", Limits())
    _, bent = drawn(recorded, "displacement", Limits(part="bent"))
    assert both.scale.high == pytest.approx(2 * LIFT)
    assert bent.scale.high == pytest.approx(LIFT, rel=0.01)
    assert bent.has_missing
    assert (bent.shape(recorded, 0).kinds == len(bent.table) - 1).any()


@pytest.mark.parametrize("field", ["stress1", "displacement"])
def test_slack_film_is_hatched_in_every_field(recorded: gx.plot.RunReader, field: str) -> None:
    image, colours = drawn(recorded, field, Limits())
    assert colours.has_slack
    shape = colours.shape(recorded, 0)
    middles = shape.corners.mean(axis=1)
    is_bent = middles[:, 1] < 2 * LIFT
    # Green strain along x: -0.05 + 0.05²/2 + (1.2 X)²/2 < 0 for X < 0.26, which is at x = 0.27.
    assert (shape.is_slack[is_bent] == (middles[is_bent, 0] < 0.27)).mean() > 0.9
    assert not shape.is_slack[~is_bent].any()
    # Lines of the hatch on the slack part only, which is a quarter of the bent film.
    plain = replace(shape, is_slack=np.zeros_like(shape.is_slack))
    without = next(render(aim([plain], FLAT), [plain], 150.0, colours))
    is_line = abs(image - without).max(axis=2) > 0.1
    assert 100 < is_line.sum() < 0.2 * is_inside(without).sum()


def test_states_have_a_colour_for_slack_film_and_no_hatch(recorded: gx.plot.RunReader) -> None:
    colours = colouring(recorded, "state")
    assert not colours.has_slack and "slack" in colours.names
    assert not colours.shape(recorded, 0).is_slack.any()


# ---- limits --------------------------------------------------------------------------------------


def test_a_scale_ends_at_the_largest_value(recorded: gx.plot.RunReader) -> None:
    """Not at a percentile; the values of the two films are x² LIFT and 2 LIFT."""
    scale = drawn(recorded, "displacement", Limits())[1].scale
    assert scale.high == scale.largest == pytest.approx(2 * LIFT)
    assert scale.clipped == (False, False) and scale.beyond == ""


def test_single_values_far_beyond_are_clipped_and_told() -> None:
    """One value of 50 among 999 from 0 to 1, as at a corner where the stress has no bound."""
    values = np.append(np.linspace(0, 1, 999), 50.0)
    scale = scale_of("strain1", values, (0.0, 50.0), Limits())
    assert scale.high == pytest.approx(0.996, abs=1e-3)
    assert scale.clipped == (False, True)
    assert "largest 50" in scale.beyond


@pytest.mark.parametrize(
    ("limits", "clipped"),
    [
        (Limits(0.0, 1.5), (False, False)),
        (Limits(0.0, 0.5), (False, True)),
        (Limits(0.2, 1.5), (True, False)),
    ],
)
def test_values_beyond_given_limits_are_marked(
    recorded: gx.plot.RunReader, limits: Limits, clipped: tuple[bool, bool]
) -> None:
    """By triangles at the ends of the bar, which are wider than the bar."""
    colours = drawn(recorded, "displacement", limits)[1]
    scale = colours.scale
    assert (scale.low, scale.high) == (limits.low, limits.high)
    assert scale.clipped == clipped
    widths = []
    for one in (colours, by_state(has_films=False)):
        file = BytesIO()
        views = Views([" "], (1.0, 1.0), lambda scale: [np.ones((2, 2, 3))], one)
        write_page(file, "", views)
        page = np.asarray(Image.open(file).convert("RGB")).astype(int)
        is_coloured = (np.ptp(page, axis=2) > 40).any(axis=0)
        widths.append(int(is_coloured.sum()))
    bar = 0.25 * 12.0 * 150
    tip = 0.12 * 150
    assert widths[0] == pytest.approx(bar + sum(clipped) * tip, abs=0.7 * tip)
    assert widths[1] == 0


def test_the_first_and_the_last_tick_are_the_ends(recorded: gx.plot.RunReader) -> None:
    from matplotlib.figure import Figure

    from gossamer_fx.records.plot.page import _draw_bar

    colours = drawn(recorded, "displacement", Limits(low=0.013, high=0.777))[1]
    axes = Figure().subplots()
    _draw_bar(axes, colours, 3.0)
    labels = [label.get_text() for label in axes.get_xticklabels()]
    assert labels[0] == "13" and labels[-1] == "777"
    assert len(labels) > 2


def test_each_time_has_its_own_limits_in_its_caption(recorded: gx.plot.RunReader) -> None:
    views = strip_views(recorded, "displacement", 3, gx.plot.View(), Limits(each_time=True))
    assert len(views.captions) == 3
    for caption in views.captions:
        assert caption.endswith("0 to 1.2 m")
    assert set(views.colours.scales) == {0, 1, 2}


def test_a_logarithmic_scale_has_equal_colours_for_equal_ratios() -> None:
    scale = scale_of("stress1", np.geomspace(1.0, 1e4, 99), (1.0, 1e4), Limits(1.0, 1e4, log=True))
    assert scale.parts(np.array([1.0, 10.0, 100.0, 1e3, 1e4])) == pytest.approx(
        [0.0, 0.25, 0.5, 0.75, 1.0]
    )
    # Zero has no logarithm; it is below the scale.
    assert scale.parts(np.array([0.0, -5.0])) == pytest.approx([0.0, 0.0])


def test_zero_has_the_middle_colour_on_a_scale_that_is_not_symmetric() -> None:
    scale = scale_of("stress1", np.zeros(1), (0.0, 0.0), Limits(-1.0, 4.0))
    zero = scale.table[np.rint(scale.parts(np.zeros(1)) * (len(scale.table) - 1)).astype(int)]
    symmetric = scale_of("stress1", np.zeros(1), (0.0, 0.0), Limits(-4.0, 4.0)).table
    assert zero[0] == pytest.approx(symmetric[len(symmetric) // 2], abs=0.02)


def test_shades_of_kinds_stay() -> None:
    """States are told apart in light and shade: only numbers are drawn without."""
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0.5]], [[1, 0, 0], [1, 1, 9], [0, 1, 0.5]]])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.repeat(
        normals[:, None] / np.linalg.norm(normals, axis=1)[:, None, None], 3, axis=1
    )
    shape = Shape(0.0, corners, normals, np.array([1, 1]), is_slack=np.array([False, False]))
    image = next(render(aim([shape]), [shape], 100.0, by_state(has_films=True)))
    assert np.ptp(image[is_inside(image)][:, 0]) > 0.05


# ---- what is wrong is told -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("field", "limits", "words"),
    [
        ("state", {"high": 1.0}, "not a scale of numbers"),
        ("displacement", {"part": "sail"}, "no field 'displacement' of a part 'sail'"),
        ("stress1", {"part": "flat"}, "the parts with it are: bent"),
        ("displacement", {"low": 5.0}, "would go from 5 to 1.2"),
        ("displacement", {"low": 5.0, "high": 1.0}, "give a larger high"),
        ("displacement", {"low": math.nan}, "low"),
        ("displacement", {"low": 0.0, "high": 1.0, "log": True}, "give positive numbers"),
    ],
)
def test_limits_that_cannot_be_drawn(
    recorded: gx.plot.RunReader, field: str, limits: dict[str, Any], words: str
) -> None:
    with pytest.raises(gx.InputError, match=words):
        colouring(recorded, field, Limits(**limits))


def test_the_command_takes_limits(
    recorded: gx.plot.RunReader, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.png"
    words = ["plot", str(recorded.folder), "-f", "stress1", "-s", "2", "-o", str(file)]
    assert main([*words, "--range", "-1e5", "2e6", "--part", "bent"]) == 0
    assert file.is_file()
    assert main([*words, "--range", "2", "1"]) == 2
    assert "give a larger high" in capsys.readouterr().err


def test_a_lit_film_has_the_colours_of_the_bar_darkened(recorded: gx.plot.RunReader) -> None:
    """By one factor for red, green and blue, from 0.55 on; where it faces the eye by none."""
    colours = colouring(recorded, "displacement", Limits(low=0.0, high=1.5, part="flat"))
    shape = colours.shape(recorded, 0)
    for elevation in (0.5 * np.pi, 0.3):
        image = next(render(aim([shape], View(0.0, elevation)), [shape], 150.0, colours))
        pixels = image[is_inside(image) & (np.ptp(image, axis=2) > 0.1)]
        colour = colours.table[round(2 * LIFT / 1.5 * (len(colours.table) - 2))]
        # Of a flat film the sine of the elevation is the cosine between normal and eye.
        expected = colour * (0.55 + 0.45 * np.sin(elevation))
        assert abs(pixels - expected).max() < 0.02


def test_edges_of_the_mesh_are_drawn_on_request(recorded: gx.plot.RunReader) -> None:
    """Dark lines; each edge of the mesh is one."""
    colours = colouring(recorded, "displacement")
    shape = colours.shape(recorded, 0)
    mesh, _ = recorded.bodies["flat"].at(0)
    corners = len(np.unique(mesh.vertices))
    # Of a sheet Euler's number of points less edges and triangles is one.
    of_flat = mesh.edges_of(mesh.positions(0)[mesh.pieces])
    assert corners - len(of_flat) + len(mesh.pieces) == 1
    images = [
        next(render(aim([shape], View(edges=edges)), [shape], 150.0, colours))
        for edges in (False, True)
    ]
    dark = [(image.max(axis=2) < 0.45).sum() for image in images]
    assert dark[1] > dark[0] + 300
