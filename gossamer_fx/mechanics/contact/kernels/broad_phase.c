/* Broad phase: a binary tree of boxes, and the pairs of boxes that overlap.  See contact.h. */
#include <math.h>
#include <string.h>

#include "stencil.h"

/* Nodes that wait in a search: one a level of the tree, and its sibling; there are at most 2^31
   leaves. */
enum { STACK_SIZE = 64 };

static int boxes_overlap(const double *a, const double *b)
{
    for (int c = 0; c < 3; ++c)
        if (a[c] > b[3 + c] || b[c] > a[3 + c]) return 0;
    return 1;
}

void build_box_tree(const box_tree *tree, const double *boxes)
{
    for (ptrdiff_t i = 0; i < tree->leaf_count; ++i) {
        double *box = tree->nodes + 6 * (tree->leaf_count + i);
        if (i < tree->box_count) {
            memcpy(box, boxes + 6 * (ptrdiff_t)tree->order[i], 6 * sizeof *box);
            continue;
        }
        for (int c = 0; c < 3; ++c) { /* an empty box overlaps with nothing */
            box[c] = INFINITY;
            box[3 + c] = -INFINITY;
        }
    }
    for (ptrdiff_t i = tree->leaf_count - 1; i > 0; --i) {
        const double *left = tree->nodes + 12 * i, *right = left + 6;
        double *box = tree->nodes + 6 * i;
        for (int c = 0; c < 3; ++c) {
            box[c] = left[c] < right[c] ? left[c] : right[c];
            box[3 + c] = left[3 + c] > right[3 + c] ? left[3 + c] : right[3 + c];
        }
    }
}

/* Whether primitive i of `a` and primitive j of `b` are connected. */
static int have_common_label(const primitive_filter *a, int32_t i, const primitive_filter *b,
                             int32_t j)
{
    const int32_t *first = a->labels + a->label_count * i, *second = b->labels + b->label_count * j;
    int is_common = 0;
    for (ptrdiff_t k = 0; k < a->label_count; ++k)
        for (ptrdiff_t l = 0; l < b->label_count; ++l) is_common |= first[k] == second[l];
    return is_common;
}

/* Whether primitive i that is asked for and primitive j of the tree may form a pair at all. */
static int is_candidate(const box_query *query, int32_t i, int32_t j,
                        const primitive_filter *of_query, const primitive_filter *of_tree)
{
    if (query->in_tree && j <= i) return 0;
    if (of_query->is_fixed[i] && of_tree->is_fixed[j]) return 0;
    return !have_common_label(of_query, i, of_tree, j);
}

/* Whether primitive i that is asked for and primitive j of the tree can come near. */
static int can_come_near(const nearness *near, int32_t i, int32_t j)
{
    int32_t points[4];
    const stencil *of = STENCILS + near->kind;
    const int first_count = of->first_count;
    for (int k = 0; k < first_count; ++k) points[k] = near->query_points[first_count * (ptrdiff_t)i + k];
    const int second_count = 4 - first_count;
    for (int k = 0; k < second_count; ++k)
        points[first_count + k] = near->tree_points[second_count * (ptrdiff_t)j + k];
    double radius[2] = {0, 0}, parameters[2];
    for (int k = 0; k < 4; ++k) {
        const int side = k >= first_count;
        radius[side] = fmax(radius[side], near->radius[points[k]]);
    }
    const pair_vectors vectors = vectors_at(of->coefficients, near->x0, points);
    const double gap = of->length_of(of->closest(&vectors, 0, parameters)) - (radius[0] + radius[1]);
    const double approach = approach_bound(first_count, near->x0, near->x1, points)
                            + margin_of_pair(first_count, near->margin, points);
    return gap < near->distance + approach;
}

int64_t find_overlaps(const box_tree *tree, const box_query *query,
                      const primitive_filter *of_query,
                      const primitive_filter *of_tree, const nearness *near, int64_t room,
                      int32_t *pairs)
{
    int64_t found = 0;
    for (ptrdiff_t k = 0; k < query->count; ++k) {
        const int32_t i = query->primitive[k];
        const double *box = query->boxes + 6 * (ptrdiff_t)i;
        ptrdiff_t stack[STACK_SIZE];
        int depth = 0;
        stack[depth++] = 1;
        while (depth) {
            const ptrdiff_t node = stack[--depth];
            if (!boxes_overlap(tree->nodes + 6 * node, box)) continue;
            if (node < tree->leaf_count) {
                stack[depth++] = 2 * node;
                stack[depth++] = 2 * node + 1;
                continue;
            }
            const ptrdiff_t leaf = node - tree->leaf_count;
            if (leaf >= tree->box_count) continue;
            const int32_t j = tree->order[leaf];
            if (!is_candidate(query, i, j, of_query, of_tree)) continue;
            if (near && !can_come_near(near, i, j)) continue;
            if (found < room) {
                pairs[2 * found] = i;
                pairs[2 * found + 1] = j;
            }
            ++found;
        }
    }
    return found;
}
