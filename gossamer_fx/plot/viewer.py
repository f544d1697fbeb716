"""The data of the turnable view in a report: surfaces, lines and colours at some times, in few bytes."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.model.body import Array
from gossamer_fx.plot.colours import NAMES, Scale
from gossamer_fx.plot.curve_panels import scaled
from gossamer_fx.plot.plot import Colouring, colouring, default_field
from gossamer_fx.plot.run_reader import RunReader, Segment
from gossamer_fx.plot.view import Integers

_BYTES = 6_000_000  # of positions and colours, about
_MOST_FRAMES, _MOST_VERTICES = 80, 20_000


@dataclass
class _Surface:
    """A body's segment with few vertices: `points` are those of the segment that they stand for."""

    segment: Segment
    points: Integers
    pieces: Integers
    of: Integers  # the pieces of the segment that are kept


def view_data(run: RunReader) -> dict[str, Any]:
    """What `viewer.js` shows.

    Positions are 16-bit fractions of the box around the whole run, colours are rows of a table for each field;
    surfaces of more than 20 000 vertices are thinned out, and frames left out beyond about six megabytes.
    """
    first = default_field(run)
    names = [first, *(name for name in run.known_fields() if name not in (first, "velocity"))]
    fields = [(name, colouring(run, name)) for name in (names if run.films else names[:1])]
    bodies = list(run.meshes)
    groups: dict[tuple[int, ...], list[int]] = {}
    for frame in range(len(run.times)):
        groups.setdefault(tuple(id(run.meshes[name].at(frame)[0]) for name in bodies), []).append(
            frame
        )
    share = max(_MOST_VERTICES // max(len(bodies), 1), 100)
    thin = {id(s): _thinned(s, share) for name in bodies for s in run.meshes[name].segments}
    bytes_a_frame = sum(
        6 * len(s.points) + len(fields) * len(s.pieces) for s in thin.values()
    ) / len(groups)
    count = int(
        np.clip(_BYTES / max(bytes_a_frame, 1), 2, min(_MOST_FRAMES, max(len(run.times), 2)))
    )
    chosen = set(np.unique(np.rint(np.linspace(0, len(run.times) - 1, count)).astype(int)).tolist())
    low, span = _box(run, sorted(chosen))
    parts: list[dict[str, Any]] = []
    labels: list[str] = []
    factor, prefix = scaled(float(run.times[-1]))
    for frames in groups.values():
        kept = [frame for frame in frames if frame in chosen]
        if kept:
            surfaces = [(name, thin[id(run.meshes[name].at(kept[0])[0])]) for name in bodies]
            parts.append(_part(run, surfaces, kept, fields, low, span) | {"first": len(labels)})
            labels += [f"t = {run.times[frame] / factor:.4g} {prefix}s" for frame in kept]
    return {
        "low": low.tolist(),
        "span": span.tolist(),
        "labels": labels,
        "fields": [_field(name, found) for name, found in fields],
        "parts": parts,
    }


def _part(
    run: RunReader,
    surfaces: list[tuple[str, _Surface]],
    frames: list[int],
    fields: list[tuple[str, Colouring]],
    low: Array,
    span: Array,
) -> dict[str, Any]:
    offsets = np.cumsum(
        [0, *(len(s.points) for _, s in surfaces), *(len(solid.X) for solid in run.solids)]
    )
    triangles: list[Integers] = [np.zeros((0, 3), dtype=np.int64)]
    lines: list[Integers] = [np.zeros((0, 2), dtype=np.int64)]
    for (name, s), offset in zip(surfaces, offsets, strict=False):
        (triangles if run.meshes[name].is_film else lines).append(s.pieces + offset)
    lines += [
        solid.lines + offset
        for solid, offset in zip(run.solids, offsets[len(surfaces) :], strict=False)
    ]
    positions, kinds = [], [[] for _ in fields]  # type: ignore[var-annotated]

    def keep(x: Array) -> None:
        positions.append(np.rint((x - low) / np.where(span > 0, span, 1.0) * 65535).clip(0, 65535))

    for frame in frames:
        for name, s in surfaces:
            _, k = run.meshes[name].at(frame)
            keep(s.segment.positions(k)[s.points])
            if run.meshes[name].is_film:
                for found, (field, colours) in zip(kinds, fields, strict=True):
                    known = field in run.fields[name]
                    corners = s.segment.pieces[s.of]
                    values = (
                        s.segment.read(field, k)[corners].mean(axis=1)
                        if known
                        else np.full(len(s.of), np.nan)
                    )
                    found.append(colours.kinds(values))
        for x in run.places(float(run.times[frame])):
            keep(x)
    return {
        "frames": len(frames),
        "vertices": int(offsets[-1]),
        "triangles": _packed(np.concatenate(triangles), np.uint32),
        "lines": _packed(np.concatenate(lines), np.uint32),
        "positions": _packed(np.concatenate(positions), np.uint16),
        "kinds": [_packed(np.concatenate([np.zeros(0), *found]), np.uint8) for found in kinds],
    }


def _thinned(segment: Segment, most: int) -> _Surface:
    """The pieces between some vertices: those that stay near to each other become one, until few are left."""
    vertices, at = np.unique(segment.vertices.ravel(), return_index=True)
    points = segment.pieces.ravel()[at]
    last = len(segment.times) - 1
    looks = np.concatenate(
        [segment.positions(k)[points] for k in sorted({0, last // 2, last})], axis=1
    )
    cluster: Integers = np.arange(len(vertices))
    pitch = float(np.ptp(looks, axis=0).max(initial=0.0)) / 1000
    while len(np.unique(cluster)) > most and pitch > 0:
        cluster = np.unique(np.rint(looks / pitch).astype(np.int64), axis=0, return_inverse=True)[
            1
        ].ravel()
        pitch *= 1.25
    found, first = np.unique(cluster, return_index=True)
    pieces = np.searchsorted(found, cluster[np.searchsorted(vertices, segment.vertices)])
    whole = np.ones(len(pieces), dtype=bool)
    for i in range(pieces.shape[1]):
        whole &= pieces[:, i] != pieces[:, i - 1]
    of = np.flatnonzero(whole)
    once = np.sort(np.unique(np.sort(pieces[of], axis=1), axis=0, return_index=True)[1])
    return _Surface(segment, points[first], pieces[of[once]], of[once])


def _box(run: RunReader, frames: list[int]) -> tuple[Array, Array]:
    looks = [
        segment.positions(k) for mesh in run.meshes.values() for segment, k in map(mesh.at, frames)
    ]
    looks += [x for frame in frames for x in run.places(float(run.times[frame]))]
    low, high = (f([f(x, axis=0) for x in looks], axis=0) for f in (np.min, np.max))
    return low, high - low


def _field(name: str, found: Colouring) -> dict[str, Any]:
    about: dict[str, Any] = {
        "name": NAMES.get(name, name),
        "table": np.rint(255 * found.table).astype(int).tolist(),
    }
    if isinstance(found.key, Scale):
        factor, label = found.key.label
        about |= {
            "low": f"{found.key.low / factor:.4g}",
            "high": f"{found.key.high / factor:.4g}",
            "unit": label[label.find("[") + 1 : -1],
        }
    else:
        about["names"] = [
            [key, int(abs(found.table - np.asarray(colour)).sum(axis=1).argmin())]
            for key, colour in found.key.items()
        ]
    return about


def _packed(values: npt.NDArray[Any], kind: type) -> str:
    return b64encode(
        np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<")).tobytes()
    ).decode()
