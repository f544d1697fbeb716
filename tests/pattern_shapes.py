"""Surfaces from which tests cut patterns."""

from __future__ import annotations

import numpy as np

import gossamer_fx as gx


def grid(position, along, across):
    """Points and triangles of a surface x(u, v) (3,), u and v from 0 to 1, with normals along
    ∂x/∂u × ∂x/∂v."""
    u, v = np.meshgrid(np.linspace(0, 1, along + 1), np.linspace(0, 1, across + 1), indexing="ij")
    points = np.stack(np.broadcast_arrays(*position(u, v)), axis=-1).reshape(-1, 3)
    rows = np.arange(len(points)).reshape(u.shape)
    a = rows[:-1, :-1].ravel()
    b = rows[1:, :-1].ravel()
    c = rows[1:, 1:].ravel()
    d = rows[:-1, 1:].ravel()
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def surface_of(position, along, across):
    """A surface x(u, v), see `grid`."""
    return gx.patterns.surface(grid(position, along, across))


def CYLINDER(u, v):
    """Half a cylinder of radius and height 1 m, normals outwards."""
    return np.cos(np.pi * u), np.sin(np.pi * u), v


def CONE(u, v):
    """A part of a cone with the tip in the origin, 1 to 2 m from it."""
    s = 1 + v
    return 0.6 * s * np.cos(2.5 * u), 0.6 * s * np.sin(2.5 * u), 0.8 * s
