"""Waves that run around an axis, forward and backward, from the Fourier coefficients of points in
time.

Problem.  n waves around an axis, w = a(t) cos n θ + b(t) sin n θ, are the sum of waves that run in
the sense of positive rotation and against it, of unknown frequencies.

Algorithm.

1. With z = a + i b a forward wave F cos(n θ - ω t + φ) is z = F exp(i (ω t - φ)), a backward wave
   B cos(n θ + ω t + φ) is z = B exp(-i (ω t + φ)): the sign of the frequency tells them apart.
2. The series is interpolated linearly to even times, its mean is removed, and a Hann window
   applied.
3. The highest line of the Fourier transform on each side is the wave.  Its frequency lies between
   two lines: with the ratio r of the higher neighbour to the peak it is (2 r - 1)/(1 + r) lines
   away, exactly so for one wave under a Hann window.

Limits.  Waves that are less than two lines apart, i.e. two periods over the whole time, are not
resolved; waves of one sense that are weaker than another one of this sense are not reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.arguments import FLAT, RISING, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array

# Samples below which a spectrum has no two sides.
LEAST_SAMPLES = 16


@check_arguments
@dataclass(frozen=True)
class TravellingWaves:
    """The strongest wave in each sense.

    Attributes:
        forward, backward: amplitudes, in the unit of the coefficients.
        forward_frequency, backward_frequency: ω [rad/s], positive both.  The phase of n waves goes
            around with the speed ω/n [rad/s].

    Example:
        >>> waves = gx.analysis.TravellingWaves(
        ...     0.02, 0.0, forward_frequency=12.0, backward_frequency=0.0
        ... )
        >>> waves.forward_frequency / 2
        6.0
    """

    forward: float
    backward: float
    forward_frequency: float
    backward_frequency: float


@check_arguments
def travelling_waves(
    time: Annotated[npt.ArrayLike, FLAT, RISING], cosine: npt.ArrayLike, sine: npt.ArrayLike
) -> TravellingWaves:
    """Separate forward from backward waves.

    Args:
        time: (n,) [s], increasing.
        cosine, sine: coefficients (n,) of `gx.probes.Waves` at these times.

    Raises:
        InputError: fewer than 16 times, times that do not increase, or series of different lengths.

    Example:
        >>> t = np.linspace(0.0, 2.0, 400)
        >>> waves = gx.analysis.travelling_waves(t, 0.1 * np.cos(20 * t), 0.1 * np.sin(20 * t))
        >>> round(waves.forward, 3), round(waves.forward_frequency, 1)
        (0.1, 20.0)
    """
    t = np.asarray(time, dtype=float)
    a = np.asarray(cosine, dtype=float)
    b = np.asarray(sine, dtype=float)
    check(
        t.ndim == 1 and len(t) >= LEAST_SAMPLES and t.shape == a.shape == b.shape,
        f"travelling_waves: time, cosine and sine have the shapes {t.shape}, "
        f"{a.shape} and {b.shape}; give {LEAST_SAMPLES} or more values of each.",
    )
    even = np.linspace(t[0], t[-1], len(t))
    z = np.interp(even, t, a) + 1j * np.interp(even, t, b)
    window = np.hanning(len(z))
    # The window's mean is the factor by which it lowers the line of a wave.
    spectrum = np.fft.fft((z - z.mean()) * window) / window.sum()
    line = 2 * math.pi / (len(z) * float(even[1] - even[0]))

    half = (len(z) - 1) // 2
    forward = _strongest(np.abs(spectrum[: half + 1]))
    # The negative frequencies in the order of their sizes, after the mean.
    backward = _strongest(np.abs(spectrum[(-np.arange(half + 1)) % len(z)]))
    return TravellingWaves(
        forward=forward[0],
        backward=backward[0],
        forward_frequency=forward[1] * line,
        backward_frequency=backward[1] * line,
    )


def _strongest(lines: Array) -> tuple[float, float]:
    """Amplitude and number of periods in the window, which need not be whole, of the strongest wave
    of a one-sided spectrum (n,) under a Hann window; zeros if the spectrum is zero."""
    # Line 0 is the mean, which was removed.
    peak = 1 + int(np.argmax(lines[1:-1]))
    height = float(lines[peak])
    if height == 0:
        return 0.0, 0.0
    before = float(lines[peak - 1])
    after = float(lines[peak + 1])
    # Of a wave between two lines both are large: their ratio gives the distance from the larger
    # one.
    ratio = max(before, after) / height
    shift = (2 * ratio - 1) / (1 + ratio)
    if before > after:
        shift = -shift
    # The transform of a Hann window, over its value at 0: sin(π x)/(π x (1 - x²)).
    gain = float(np.sinc(shift)) / (1 - shift**2)
    return height / gain, peak + shift
