/* Contact kernels: the data that Python hands over, and the functions that it calls.

   The C compiler reads this file, and so does cffi, without the preprocessor's lines
   (forms/c_source.py): no prototype is written twice.  Python checks lengths, types and writability
   of all arrays, and the range of all indices, before it calls a function.  Shapes stand in
   brackets; arrays are stored row by row.

   n pairs, m points; lengths in metres, forces in newtons, energies in joules. */
#ifndef GOSSAMER_CONTACT_H
#define GOSSAMER_CONTACT_H

#include <stddef.h>
#include <stdint.h>

/* A pair has four points: of a triangle pair the point and three corners, of an edge pair the ends
   of both edges. Of boundaries they are the point, an origin and two directions.  Its kind is a row
   of the table of stencils (stencil.h); kind_name is the name of one of the kind_count() kinds. */
int kind_count(void);
const char *kind_name(int kind);

/* Make a kind that of boundaries whose distance is a law (core/laws): the address of its function of
   (r.r, r.a, r.b, a.a, a.b, b.b, shape), with two orders of derivatives by the first six. */
void set_boundary_law(int kind, uintptr_t law);

enum contact_law { BARRIER, PENALTY };

/* What a pair does in a step: nothing, it has a force, or it is pushed back since it passed
   through. */
enum pair_state { NO_CONTACT, TOUCHES, PASSED };

/* What is known of an edge and a triangle: UNSURE where round-off may hide the answer. */
enum intersection { SEPARATE, INTERSECTS, UNSURE };

typedef struct {
    ptrdiff_t count;       /* n */
    const int32_t *points; /* (n, 4) */
    const uint8_t *kind;   /* (n) */
    const double *shape;   /* (n) number that the stencil of a pair needs, or NULL: none does */
} pair_list;

/* Pairs that may have energy k b(x) in a step, x = (s - offset)/width of the squared distance s. */
typedef struct {
    pair_list list;
    const double *stiffness; /* (n) k */
    const double *width;     /* (n) [m^2]; where s is a distance [m] */
    const double *offset;    /* (n) [m^2]; where s is a distance [m] */
    /* (n, 4) at the start: parameters u, v; distance [m]; s of rounded edges */
    const double *start;
    double rounding;         /* of the distance of two edges, over their width */
    int law;                 /* of enum contact_law */
} active_pairs;

typedef struct {
    const double *x0;       /* (m, 3) points at the start */
    const double *x1;       /* (m, 3) points at the end */
    double alpha;           /* weight of the end where forces act */
    int is_state;           /* whether they are the forces of the state x1 alone */
    double geometric_share; /* share of the geometric stiffness in tangents */
    /* stiffness of pairs that passed through, over their own; 0: a step that is accepted */
    double push_back;
} contact_step;

/* Results of `evaluate_pairs`.  Forces and tangents are wanted by pairs, or summed over pairs;
   NULL: not wanted. */
typedef struct {
    uint8_t *state;             /* (n) of enum pair_state */
    int state_is_known;         /* whether `state` comes from an earlier call for the same step */
    double *point_forces;       /* (m, 3) to which forces are added */
    const int32_t *block_index; /* (n, 16) rows of `blocks` for each two points of a pair */
    double *blocks;             /* (blocks, 9) to which tangents are added */
    double *pair_forces;        /* (n, 12) */
    double *pair_tangents;      /* (n, 144) */
} contact_response;

/* Squared distances (n) of pairs at points x (m, 3); of planes the signed distance, of spheres and
   cylinders minus the squared distance from the middle.  parameters (n, 2): (u, v) of the closest
   points, zero for boundaries. */
void closest_points(const pair_list *pairs, const double *x, double *squared_distance,
                    double *parameters);

/* `start` (n, 4) of active pairs at points x, given squared distance (n) and parameters (n, 2) of the
   closest points. */
void pair_starts(const active_pairs *pairs, const double *x, const double *squared_distance,
                 const double *parameters, double *start);

/* Upper bounds (n) of how much closer pairs can come on straight lines from x0 to x1; infinite for
   boundaries. */
void approach_bounds(const pair_list *pairs, const double *x0, const double *x1, double *bound);

/* Forces and tangents of a step; returns the number of pairs that have any. */
ptrdiff_t evaluate_pairs(const active_pairs *pairs, const contact_step *step,
                         const contact_response *response);

/* Stored energy [J] at points x, given the parameters (n, 2) of the closest points; scaled_distance
   (n): x of each. */
double stored_energy(const active_pairs *pairs, const double *x, const double *parameters,
                     double *scaled_distance);

/* Energies (n) of pairs with the scaled distances x (n), over their stiffness. */
void unit_energies(const active_pairs *pairs, const double *scaled_distance, double *energy);

/* Straight motion of pairs from x0 to x1, on which they shall keep a least gap. */
typedef struct {
    const double *x0;     /* (m, 3) */
    const double *x1;     /* (m, 3) */
    const double *radius; /* (n) of both sides together, taken off the distance */
    const double *gap;    /* (n) at x0 */
    const double *min_gap; /* (n) */
    int max_advances;
} pair_motion;

/* Whether pairs keep their least gap: keeps_gap (n) is 1 or 0; returns the number of those that may
   not. */
ptrdiff_t check_motion(const pair_list *pairs, const pair_motion *motion, uint8_t *keeps_gap);

/* A complete binary tree of boxes (least coordinates, greatest coordinates), root 1, children 2 i
   and 2 i + 1. */
typedef struct {
    ptrdiff_t box_count;  /* number of boxes that were put in */
    ptrdiff_t leaf_count; /* the next power of two */
    const int32_t *order; /* (box_count) which box is at each leaf */
    double *nodes;        /* (2 leaf_count, 6) */
} box_tree;

/* Primitives that are asked for, or in a tree: those with a label in common are connected, and no
   candidate pair. */
typedef struct {
    ptrdiff_t label_count;
    const int32_t *labels;   /* (primitives, label_count) */
    const uint8_t *is_fixed; /* (primitives) whether contact does not move it */
} primitive_filter;

typedef struct {
    ptrdiff_t count;
    const int32_t *primitive; /* (count) which primitives are asked for */
    const double *boxes;      /* (primitives, 6) */
    /* whether the primitives are those of the tree: then pairs i < j are found once */
    int in_tree;
} box_query;

/* Set the nodes of a tree from its boxes (box_count, 6). */
void build_box_tree(const box_tree *tree, const double *boxes);

/* Which pairs of overlapping boxes can come near: those whose gap, less what they can come closer
   while points go from x0 to within their margin of x1, is below a distance. */
typedef struct {
    int kind;                    /* of all pairs: that of a point and a triangle, or of two edges */
    const int32_t *query_points; /* (primitives, 1 or 2) of those that are asked for */
    const int32_t *tree_points;  /* (primitives, 3 or 2) of those in the tree */
    const double *x0;            /* (m, 3) */
    const double *x1;            /* (m, 3) */
    const double *margin;        /* (m) */
    const double *radius;        /* (m) of the body at a point; of a primitive the largest counts */
    double distance;
} nearness;

/* Pairs (room, 2) of a primitive that is asked for and one of the tree whose boxes overlap, unless
   they are connected or both fixed, or cannot come near (`near` may be NULL: all can).  Returns
   their number, of which at most `room` are written. */
int64_t find_overlaps(const box_tree *tree, const box_query *query,
                      const primitive_filter *of_query,
                      const primitive_filter *of_tree, const nearness *near, int64_t room,
                      int32_t *pairs);

typedef struct {
    ptrdiff_t count;
    const int32_t *pairs;     /* (count, 2) numbers of an edge and a triangle */
    const int32_t *edges;     /* (., 2) points */
    const int32_t *triangles; /* (., 3) points */
    const double *x;          /* (m, 3) */
} edge_triangle_pairs;

/* Whether edges intersect triangles: found (count) of enum intersection. */
void find_intersections(const edge_triangle_pairs *candidates, uint8_t *found);

/* Groups of block rows, one after the other in `members`: all rows of a group are coupled with each
   other. */
typedef struct {
    ptrdiff_t group_count;
    ptrdiff_t row_count;       /* number of block rows */
    const int32_t *group_size; /* (group_count) */
    const int32_t *members;    /* (sum of group_size) */
} block_groups;

typedef struct {
    int32_t *block_index; /* (sum of group_size^2) block of each two members of each group */
    int32_t *rows;        /* (sum of group_size^2) row of each block */
    int32_t *columns;     /* (sum of group_size^2) column of each block */
    int32_t *row_work;    /* (3 row_count + 2) */
    int32_t *member_work; /* (4 sum of group_size) */
} block_pattern;

/* Number the blocks that groups couple, each once, row by row; returns how many there are. */
ptrdiff_t number_blocks(const block_groups *groups, const block_pattern *pattern);

/* Which of some blocks (count) are not zero: is_nonzero (count). */
void find_nonzero_blocks(ptrdiff_t count, const int32_t *block, const double *blocks,
                         uint8_t *is_nonzero);

#endif
