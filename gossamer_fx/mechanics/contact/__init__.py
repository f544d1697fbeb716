"""Contact of films, cables, beams and obstacles, and its public names.

Stages, in the vocabulary of the field (for instance of the IPC Toolkit), each a file or folder:

    geometry/        points, edges and triangles that may touch; the collision filter of connected
                     parts
    broad_phase/     bounds of trajectories, a tree of boxes, candidate pairs
    pairs            kinds of pairs, the tables that the stages hand on, closest points and gaps
    narrow_phase/    continuous collision detection, intersections
    active_set       candidates that take part in a step, their activation distances and stiffness,
                     and what is taken over from step to step
    contact_step     the step of a contact, which does not change: forces, tangents, derivatives
    friction/        Coulomb friction of the active pairs
    assembly         which blocks the pairs of a step add to the tangent, and where they go
    contact_set      one contact in a step, which calls the stages; `contact` adds what gradients
                     and outputs ask
    contact_gradient what a gradient of a run or an equilibrium asks of a contact
    obstacles, cone  what bodies touch: of which stencils it is made, and how it is drawn
    kernels/         what is done pair by pair, in C

Numberings:

    node         of a body's mesh, global over all ranks: by it bodies and outputs know their
                 positions
    point        of a contact, the same on every rank: first the nodes of its bodies, then the
                 points and directions of obstacles; x[point] is where it is
    block row    a vector of three unknowns of the system.  Block row i is the position of point i
                 of a body; more block rows belong to rigid bodies that obstacles are parts of
    block index  of a 3 x 3 block between two block rows, in one step, on one rank
    identifier   of a pair, the same on every rank and in every search

Names of arrays and numbers, in all of contact:

    x, x0, x1        the points (m, 3) [m] that a rank knows; at the start and end of a step
    v, step, time    their velocities (m, 3) [m/s]; the length of a step and a time [s]
    μ                adjoint displacements (m, 3) of the points; else a coefficient of friction [-]
    pairs            a table of n pairs, with their kind (n,) and points (n, 4)
    parameters       (u, v) (n, 2) [-] of closest points along both sides
    lower, upper     least and greatest coordinates (m, 3) [m] of points; boxes (n, 6) [m] have both
    alpha            weight of the end in the configuration where forces act; 1: a state alone
    found            an array that results are added to
    w                sliding (n, 2) [m] of pairs, or a vector of the system by which residuals are
                     multiplied

What exchanges data between ranks is collective.

Distances, all in metres unless they are called squared:

    gap                  distance of the two sides of a pair less their radii; signed of a boundary
    activation distance  gap below which a pair has energy
    squared distance s   of the closest points, without radii; see `pairs`
    scaled distance x    (s - offset)/width: zero where the two sides meet, one at the activation
                         distance
    approach             upper bound of how much closer a pair can come
"""

from gossamer_fx.core.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
