"""Responses of an equilibrium to harmonic and random loads and motions of the ground.

`modal_model` has the equations.  A random load is the load times a stationary random factor with
the one-sided density G(f) [1/Hz]; a result with the frequency response H(f) has the density
|H|² G, and the mean square

    σ² = ∫ |H|² G df                                                                          (1)

over the band.  |H|² has narrow peaks.  The band is therefore cut at the frequencies of the modes
and at distances from them that double from a quarter of their bandwidth on; each piece is
integrated by Gauss's rule.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.modal_model import (
    Complex,
    ModalModel,
    ModalResponse,
)
from gossamer_fx.analysis.vibration.natural_modes import Mode
from gossamer_fx.core.checks.arguments import (
    Band,
    at_least,
    check_arguments,
    collective,
    not_negative,
)
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import exactly_one
from gossamer_fx.core.checks.short_repr import short_repr
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.model.body import Array, Vector
from gossamer_fx.records.plot.written_panels import written_panels
from gossamer_fx.records.probes.objective import Objective

AT_REST = (0.0, 0.0, 0.0)

# Frequencies per piece of a band, and largest ratio of the ends of a piece.
POINTS = 6
LARGEST_RATIO = 1.5

# Share of a bandwidth at which a band is cut on both sides of a resonance.
FIRST_CUT = 0.25
# Least bandwidth over the frequency, so that modes without damping have a finite number of pieces.
LEAST_BANDWIDTH = 1e-6

# The highest mode should be at least this multiple of the highest frequency.
MODES_BEYOND = 1.5

# Size of a picture [inch].
_WIDTH = 8.0
_PANEL_HEIGHT = 2.4

LOG = logging.getLogger("gossamer_fx")

# A density [1/Hz]: the same at all frequencies, corners (f [Hz], G) of straight lines on
# logarithmic axes, or a function of the frequency.
Density = float | Sequence[Sequence[float]] | Callable[[float], float]


@check_arguments
@dataclass(frozen=True, eq=False)
class HarmonicResponse:
    """Steady vibrations of results: each is its value in the equilibrium plus Re(v e^(2πi f t)).

    Attributes:
        frequencies: f [Hz], (m,).
        values: complex amplitudes v by the names of the results, (m,) each, in the unit of the
            probe; as seen from the ground if that moves.
        ground: amplitudes of the results in a translation by the acceleration of the ground, by
            name, in their unit over s²; zero if it stands.
        states: the state of vibration at a frequency; `at` asks for it.

    Example:
        >>> response = gx.analysis.HarmonicResponse(np.array([1.0]), {"z [m]": np.array([-0.5j])})
        >>> response.amplitude("z [m]"), response.phase("z [m]").round(3)
        (array([0.5]), array([-1.571]))
    """

    frequencies: Array
    values: Mapping[str, Complex]
    ground: Mapping[str, float] = field(default_factory=dict)
    states: Callable[[float], Mode] | None = None

    __repr__ = short_repr

    def amplitude(self, name: str) -> Array:
        """Amplitude of a result, (m,)."""
        return np.abs(self.values[name])

    def phase(self, name: str) -> Array:
        """Angle [rad] by which a result is ahead of the load, (m,), -π to π."""
        return np.angle(self.values[name])

    def acceleration(self, name: str) -> Complex:
        """Complex amplitude of the second derivative in time of a result, (m,), in its unit over
        s²: of a `Position` what an accelerometer shows, the motion of the ground included."""
        ω = 2 * math.pi * self.frequencies
        return -(ω**2) * self.values[name] + self.ground.get(name, 0.0)

    def peak(self, name: str) -> tuple[float, float]:
        """Frequency [Hz] at which a result is largest, among those of the response, and its
        amplitude there."""
        amplitude = self.amplitude(name)
        largest = int(amplitude.argmax())
        return float(self.frequencies[largest]), float(amplitude[largest])

    @check_arguments
    def at(self, frequency: Annotated[float, not_negative("Hz")]) -> Mode:
        """The complex shape of the vibration at a frequency [Hz], of any modal mass, e.g. for
        `gx.outputs.record_modes`.  Collective."""
        check(self.states is not None, "HarmonicResponse: it was made without states.")
        assert self.states is not None
        return self.states(frequency)

    @check_arguments
    def plot(self, path: str | Path) -> None:
        """Write a PNG of amplitudes and phases over the frequency.

        Args:
            path: of the file.

        Raises:
            OutputFailure: the file cannot be written.
        """
        curves = {name: self.amplitude(name) for name in self.values}
        phases = {name: np.degrees(self.phase(name)) for name in self.values}
        _draw(path, self.frequencies, curves, phases)


@check_arguments
@dataclass(frozen=True, eq=False)
class RandomResponse:
    """Stationary random vibrations of results.

    Attributes:
        frequencies: [Hz], (m,), between which the densities are smooth.
        densities: one-sided power spectral densities by the names of the results, (m,) each, in the
            square of their unit per Hz.
        rms: standard deviation of each result about its value in the equilibrium, in its unit.
        crossings: mean number of upward crossings of that value in a second of each result [Hz]:
            the number of its cycles.
        acceleration_rms: as `rms`, of the second derivative in time of each result, the motion of
            the ground included.

    Example:
        >>> response = gx.analysis.RandomResponse(
        ...     np.array([1.0]), {"z [m]": np.array([1e-6])}, {"z [m]": 2e-3}, {"z [m]": 1.5}
        ... )
        >>> round(response.largest("z [m]", 600.0), 5)
        0.00738
    """

    frequencies: Array
    densities: Mapping[str, Array]
    rms: Mapping[str, float]
    crossings: Mapping[str, float]
    acceleration_rms: Mapping[str, float] = field(default_factory=dict)

    __repr__ = short_repr

    @check_arguments
    def largest(self, name: str, duration: Annotated[float, not_negative("s")]) -> float:
        """The largest deviation of a Gaussian result that is expected in a time [s]:
        σ √(2 ln(ν T)) with its crossings ν, and σ at least."""
        cycles = self.crossings[name] * duration
        return self.rms[name] * math.sqrt(max(2 * math.log(max(cycles, 1.0)), 1.0))

    @check_arguments
    def plot(self, path: str | Path) -> None:
        """Write a PNG of the densities over the frequency.

        Args:
            path: of the file.

        Raises:
            OutputFailure: the file cannot be written.
        """
        _draw(path, self.frequencies, self.densities, None)


Modes = Annotated[Sequence[Mode], at_least(1)]
Probes = Annotated[Mapping[str, Objective], at_least(1)]


@check_arguments(exactly_one("frequencies", "band"), exactly_one("loads", "base_acceleration"))
@collective
def harmonic_response(
    equilibrium: Equilibrium,
    modes: Modes,
    *,
    of: Probes,
    frequencies: Sequence[Annotated[float, not_negative("Hz")]] = (),
    band: Band = (),
    loads: Sequence[Any] = (),
    base_acceleration: Vector = AT_REST,
    loss_factor: Annotated[float, not_negative()] = 0.0,
    damping_ratio: Annotated[float, not_negative()] | Sequence[float] = 0.0,
) -> HarmonicResponse:
    """The steady response of an equilibrium to harmonic loads or motion of the ground, by modes.

    Small vibrations are linear, so that responses to several loads with different phases are sums
    of responses to each.  The displacements of the modes that are left out are static, so that a
    response far below them is exact.

    Dampers and `Damping` of the scene act, and what `loss_factor` and `damping_ratio` say is added.

    Args:
        equilibrium: of which `find` was called; gas and contact as in `modes`.
        modes: of this equilibrium, from `modes`; up to some 1.5 times the highest frequency.
        of: results by name, e.g. {"tip z [m]": gx.probes.Position(port, "z")}: probes of positions,
            velocities, volumes, reactions, and others that have derivatives.
        frequencies: [Hz], (m,); or give a `band`.
        band: lowest and highest frequency [Hz]; frequencies between are chosen that show each
            resonance.
        loads: loads with their amplitudes, e.g. [gx.Pressure(film, 5.0)]; all in phase.  They need
            not be in the scene.
        base_acceleration: amplitude of the acceleration of the ground along x, y, z, with all
            supports (3,) [m/s²]; results are seen from the ground.
        loss_factor: η of the whole structure; its stiffness is K (1 + iη).
        damping_ratio: ζ of all modes, or of each; η/2 at the frequency of the mode.

    Raises:
        InputError: neither loads nor an acceleration, not one of `frequencies` and `band`, an item
            that is not a load, a probe without derivatives, a scene that turns or relaxes, whose
            loads make the stiffness unsymmetric or that is not stable, a load along a free motion
            that is not among the modes, or a frequency at which the response has no bound.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> found = gx.analysis.harmonic_response(
        ...     equilibrium,
        ...     gx.analysis.modes(equilibrium, 3),
        ...     of={"z [m]": gx.probes.Position(mass.port(), "z")},
        ...     frequencies=[0.0, 1.0],
        ...     loads=[gx.loads.Force(mass.port(), (0.0, 0.0, 1.0))],
        ... )
        >>> found.values["z [m]"].real.round(5)
        array([0.01   , 0.01652])
    """
    what = "harmonic_response"
    model = ModalModel(
        equilibrium, modes, loss_factor=loss_factor, damping_ratio=damping_ratio, what=what
    )
    response, translation = _respond(model, loads, base_acceleration, what)
    if len(band):
        points, _ = _points_and_weights(_cuts(band, response))
    else:
        points = np.asarray(frequencies, dtype=float)
    check(
        float(points.min()) > 0 or not response.has_rigid_motions,
        f"{what}: at 0 Hz what moves freely has no amplitude; give frequencies above.",
    )
    _warn_of_few_modes(equilibrium, response, float(points.max()), what)
    amplitudes = response.amplitudes(points)
    values = {}
    ground = {}
    for name, probe in of.items():
        values[name] = response.seen(probe, points, amplitudes)
        ground[name] = response.seen_of(probe, translation)

    def state(frequency: float) -> Mode:
        shape = response.shapes @ response.amplitudes(np.array([frequency]))[0]
        displacements = {}
        for body in equilibrium.system.unknowns.bodies:
            owned = equilibrium.system.unknowns.block(body).owned
            of_nodes = shape[owned].reshape(-1, body.block.size // 3, 3)
            displacements[body.name] = of_nodes[:, 0]
        return replace(Mode(frequency, 0.0, shape), displacements=displacements)

    return HarmonicResponse(points, values, ground, state)


@check_arguments(exactly_one("loads", "base_acceleration"))
@collective
def random_response(
    equilibrium: Equilibrium,
    modes: Modes,
    *,
    of: Probes,
    density: Density,
    band: Band = (),
    loads: Sequence[Any] = (),
    base_acceleration: Vector = AT_REST,
    loss_factor: Annotated[float, not_negative()] = 0.0,
    damping_ratio: Annotated[float, not_negative()] | Sequence[float] = 0.0,
) -> RandomResponse:
    """The stationary response of an equilibrium to random loads or motion of the ground, by modes.

    Loads or accelerations are multiplied by one random factor.  Of several that are independent,
    e.g. along x, y and z, the squares of the rms values add up.

    Args:
        equilibrium: as in `harmonic_response`.
        modes: as in `harmonic_response`.
        of: results by name, as in `harmonic_response`.
        density: one-sided power spectral density of the factor: a number for white noise, corners
            [(f [Hz], G), ...] of straight lines on logarithmic axes, or a function of f.  With a
            `base_acceleration` of 1 m/s² it is in (m/s²)²/Hz, with one of 9.81 in g²/Hz.
        band: lowest and highest frequency [Hz]; default: those of the corners.
        loads: as in `harmonic_response`; with a pressure of 1 Pa the density is in Pa²/Hz.
        base_acceleration: as in `harmonic_response`.
        loss_factor: as in `harmonic_response`.
        damping_ratio: as in `harmonic_response`.

    Raises:
        InputError: as in `harmonic_response`; a density that is negative, corners that do not rise,
            or no band.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> found = gx.analysis.random_response(
        ...     equilibrium,
        ...     gx.analysis.modes(equilibrium, 3),
        ...     of={"z [m]": gx.probes.Position(mass.port(), "z")},
        ...     density=[(0.1, 1e-3), (20.0, 1e-3)],
        ...     base_acceleration=(0.0, 0.0, 1.0),
        ...     damping_ratio=0.01,
        ... )
        >>> round(found.rms["z [m]"], 4), round(found.crossings["z [m]"], 2)
        (0.0035, 1.59)
    """
    what = "random_response"
    model = ModalModel(
        equilibrium, modes, loss_factor=loss_factor, damping_ratio=damping_ratio, what=what
    )
    spectrum = _Spectrum(equilibrium, density, what)
    response, translation = _respond(model, loads, base_acceleration, what)
    cuts = _cuts(band if len(band) else spectrum.band, response, spectrum.corners)
    points, weights = _points_and_weights(cuts)
    G = spectrum(points)
    _warn_of_few_modes(equilibrium, response, float(points[-1]), what)
    is_inside = (response.frequencies > cuts[0]) & (response.frequencies < cuts[-1])
    undamped = np.flatnonzero(is_inside & (response.forces != 0) & (response.bandwidths == 0))
    check(
        not len(undamped),
        f"{what}: mode {undamped[0] + 1 if len(undamped) else 0} has no damping, so that its rms "
        "has no bound; give a loss_factor or damping_ratio.",
    )
    amplitudes = response.amplitudes(points)
    densities = {}
    rms = {}
    crossings = {}
    acceleration_rms = {}
    for name, probe in of.items():
        values = response.seen(probe, points, amplitudes)
        ground = response.seen_of(probe, translation)
        densities[name] = np.abs(values) ** 2 * G
        square = float(weights @ densities[name])
        rate = float(weights @ (densities[name] * points**2))
        rms[name] = math.sqrt(square)
        crossings[name] = math.sqrt(rate / square) if square > 0 else 0.0
        accelerations = -((2 * math.pi * points) ** 2) * values + ground
        acceleration_rms[name] = math.sqrt(float(weights @ (np.abs(accelerations) ** 2 * G)))
    return RandomResponse(points, densities, rms, crossings, acceleration_rms)


def _respond(
    model: ModalModel, loads: Sequence[Any], acceleration: Vector, what: str
) -> tuple[ModalResponse, Array]:
    """The response to loads, or to an acceleration of the ground, and this acceleration as a
    translation of all bodies (unknowns of this rank,).  Collective."""
    translation = model.translation(acceleration)
    forces = model.forces_of(loads) if len(loads) else model.inertia_of(translation)
    return model.response_to(forces), translation


class _Spectrum:
    """A density G(f) [1/Hz]: a number, corners or a function."""

    def __init__(self, equilibrium: Equilibrium, density: Density, what: str) -> None:
        self._comm = equilibrium.comm
        self._density = density
        self._what = what
        self.corners: Array = np.zeros(0)
        if callable(density) or isinstance(density, int | float):
            return
        table = np.array([np.ravel(corner) for corner in density], dtype=float)
        check(
            table.ndim == 2 and table.shape[1] == 2 and len(table) >= 2,
            f"{what}: the density has the shape {table.shape}; give two or more corners (f, G).",
        )
        check(
            bool((np.diff(table[:, 0]) > 0).all() and (table > 0).all()),
            f"{what}: the corners of the density do not rise, or are not positive; give them from "
            "the lowest frequency to the highest, above zero.",
        )
        self.corners = table[:, 0]
        self._logarithms = np.log(table)

    @property
    def band(self) -> tuple[float, ...]:
        """The first and the last corner [Hz]; empty without corners."""
        return (float(self.corners[0]), float(self.corners[-1])) if len(self.corners) else ()

    def __call__(self, frequencies: Array) -> Array:
        """G (m,) at frequencies (m,) [Hz], zero outside of its corners."""
        density = self._density
        if len(self.corners):
            f, G = self._logarithms.T
            values = np.exp(np.interp(np.log(frequencies), f, G))
            outside = (frequencies < self.corners[0]) | (frequencies > self.corners[-1])
            values[outside] = 0.0
            return values
        if callable(density):
            source = f"{self._what}: the density"
            asked = lambda: [density(float(f)) for f in frequencies]  # noqa: E731
            values = ask_numbers(self._comm, source, asked, frequencies.shape)
        else:
            values = np.full(len(frequencies), float(density))  # type: ignore[arg-type]
        check(bool((values >= 0).all()), f"{self._what}: the density is negative; give G >= 0.")
        return values


def _cuts(
    band: Sequence[float], response: ModalResponse, corners: Sequence[float] | Array = ()
) -> Array:
    """Frequencies [Hz] at which a band is cut, so that responses are smooth in each piece."""
    low, high = band
    number = math.ceil(math.log(high / low) / math.log(LARGEST_RATIO)) + 1
    cuts = [low, high, *corners, *np.geomspace(low, high, number)]
    for centre, width in zip(response.frequencies, response.bandwidths, strict=True):
        if centre == 0 or math.isinf(centre):
            continue
        distance = FIRST_CUT * max(float(width), LEAST_BANDWIDTH * float(centre))
        cuts.append(centre)
        while distance < centre:
            cuts += [centre - distance, centre + distance]
            distance *= 2
    inside = np.unique([cut for cut in cuts if low <= cut <= high])
    # Cuts that round-off tells apart would be pieces of no length.
    is_apart = np.diff(inside, prepend=-1.0) > np.finfo(float).eps * high
    found: Array = inside[is_apart]
    return found


def _points_and_weights(cuts: Array) -> tuple[Array, Array]:
    """Frequencies [Hz] of Gauss's rule between cuts, in ascending order, and their weights [Hz]."""
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    halves = np.diff(cuts) / 2
    centres = (cuts[1:] + cuts[:-1]) / 2
    points = centres[:, None] + halves[:, None] * nodes
    return points.ravel(), (halves[:, None] * weights).ravel()


def _warn_of_few_modes(
    equilibrium: Equilibrium, response: ModalResponse, highest: float, what: str
) -> None:
    """Warn if residual vectors stand for modes that are not far above the highest frequency
    [Hz]."""
    last = float(response.frequencies[: response.modes].max())
    is_complete = response.modes == len(response.mass)
    if last < MODES_BEYOND * highest and not is_complete and equilibrium.comm.rank == 0:
        LOG.warning(
            "%s: the modes reach %.4g Hz and the response %.4g Hz; resonances above the last mode "
            "are missing, ask gx.analysis.modes for modes to %.4g Hz.",
            what,
            last,
            highest,
            MODES_BEYOND * highest,
        )


def _draw(
    path: str | Path,
    frequencies: Array,
    curves: Mapping[str, Array],
    phases: Mapping[str, Array] | None,
) -> None:
    """Write a PNG with a panel for each curve over the frequency, and one for its phase [°]."""
    columns = 1 if phases is None else 2
    size = (_WIDTH, _PANEL_HEIGHT * len(curves))
    with written_panels(path, size, len(curves), columns, sharex=True) as panels:
        for row, (name, values) in enumerate(curves.items()):
            axes = panels[row, 0]
            axes.semilogy(frequencies, values, color="#0072B2")
            title = f"{name}: amplitude"
            if phases is None:
                title = f"{name}: density, square of the unit per Hz"
            axes.set_title(title, fontsize=9, loc="left")
            if phases is not None:
                panels[row, 1].plot(frequencies, phases[name], color="#D55E00")
                panels[row, 1].set_title("phase [°]", fontsize=9, loc="left")
                panels[row, 1].set_yticks([-180, -90, 0, 90, 180])
        for axes in panels.ravel():
            if frequencies.min() > 0 and frequencies.max() > 10 * frequencies.min():
                axes.set_xscale("log")
            axes.tick_params(labelsize=8)
            axes.grid(alpha=0.3)
            axes.spines[["top", "right"]].set_visible(False)
        for axes in panels[-1]:
            axes.set_xlabel("frequency [Hz]", fontsize=8)
