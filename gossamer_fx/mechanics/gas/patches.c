/* Volumes of chambers, their gradients and the tangent of their pressures.  See patches.h. */
#include "patches.h"

#include <math.h>
#include <string.h>

/* The tangent x,s or x,r of a patch at a point, from the slopes (k) of its nodes' functions. */
static void tangent_at(const gas_patches *kind, const int32_t *nodes, const double *slopes,
                       const double *x, double *tangent)
{
    tangent[0] = tangent[1] = tangent[2] = 0;
    for (ptrdiff_t j = 0; j < kind->node_count; ++j) {
        const double *position = x + nodes[j];
        for (int c = 0; c < 3; ++c) tangent[c] += slopes[j] * position[c];
    }
}

static void cross(const double *a, const double *b, double *product)
{
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

/* Add G of (1) of all patches of a kind at the positions x, times a sign, to a gradient (u). */
static void add_gradient(const gas_patches *kind, double sign, const double *x, double *gradient)
{
    const ptrdiff_t k = kind->node_count;
    for (ptrdiff_t patch = 0; patch < kind->count; ++patch) {
        const int32_t *nodes = kind->nodes + patch * k;
        for (ptrdiff_t point = 0; point < kind->point_count; ++point) {
            const ptrdiff_t row = patch * kind->table_stride + point * k;
            double along[3], across[3], normal[3];
            tangent_at(kind, nodes, kind->along + row, x, along);
            tangent_at(kind, nodes, kind->across + row, x, across);
            cross(along, across, normal);
            for (ptrdiff_t i = 0; i < k; ++i) {
                const double weight = sign * kind->test[row + i];
                for (int c = 0; c < 3; ++c) gradient[nodes[i] + c] += weight * normal[c];
            }
        }
    }
}

void patches_gradients(const gas_surfaces *all)
{
    const ptrdiff_t u = all->unknown_count;
    const size_t size = (size_t)(all->chamber_count * u) * sizeof(double);
    memset(all->at_mid, 0, size);
    memset(all->at_end, 0, size);
    for (ptrdiff_t i = 0; i < u; ++i)
        all->mid[i] = (1 - all->alpha) * all->start[i] + all->alpha * all->end[i];
    for (ptrdiff_t number = 0; number < all->kind_count; ++number) {
        const gas_patches *kind = all->kinds[number];
        const double sign = kind->sign * all->orientation[kind->chamber];
        add_gradient(kind, sign, all->end, all->at_end + kind->chamber * u);
        /* One array stands for both where forces act at the end of the step. */
        if (all->at_mid != all->at_end)
            add_gradient(kind, sign, all->mid, all->at_mid + kind->chamber * u);
    }
}

void patches_sums(const gas_surfaces *all)
{
    const ptrdiff_t chambers = all->chamber_count;
    memset(all->sums, 0, (size_t)(3 * chambers) * sizeof(double));
    for (ptrdiff_t chamber = 0; chamber < chambers; ++chamber) {
        const double *at_mid = all->at_mid + chamber * all->unknown_count;
        const double *at_end = all->at_end + chamber * all->unknown_count;
        double volume = 0, size = 0, swept = 0;
        for (ptrdiff_t i = 0; i < all->owned_count; ++i) {
            const double term = at_end[i] * all->end[i];
            volume += term;
            size += fabs(term);
            swept += at_mid[i] * (all->end[i] - all->start[i]);
        }
        all->sums[chamber] = volume / 3;
        all->sums[chambers + chamber] = size;
        all->sums[2 * chambers + chamber] = swept;
    }
}

/* Add the cross product with a vector, as a matrix, to a block (3, 3), column by column. */
static void add_cross_matrix(const double *a, double *block)
{
    block[1] += a[2];
    block[2] -= a[1];
    block[3] -= a[2];
    block[5] += a[0];
    block[6] += a[1];
    block[7] -= a[0];
}

/* Add the derivative of G of all patches of a kind by the positions x, times a scale, to the blocks
   of the tangent. */
static void add_tangent(const gas_patches *kind, double scale, const double *x, double *blocks)
{
    const ptrdiff_t k = kind->node_count;
    for (ptrdiff_t patch = 0; patch < kind->count; ++patch) {
        const int32_t *nodes = kind->nodes + patch * k;
        const int32_t *numbers = kind->blocks + patch * k * k;
        for (ptrdiff_t point = 0; point < kind->point_count; ++point) {
            const ptrdiff_t row = patch * kind->table_stride + point * k;
            const double *slopes_along = kind->along + row;
            const double *slopes_across = kind->across + row;
            double along[3], across[3];
            tangent_at(kind, nodes, slopes_along, x, along);
            tangent_at(kind, nodes, slopes_across, x, across);
            for (ptrdiff_t i = 0; i < k; ++i) {
                const double weight = scale * kind->test[row + i];
                for (ptrdiff_t j = 0; j < k; ++j) {
                    /* x,s x dx,r - x,r x dx,s = a x dx with the slopes of node j's function. */
                    double a[3];
                    for (int c = 0; c < 3; ++c)
                        a[c] = weight * (slopes_across[j] * along[c] - slopes_along[j] * across[c]);
                    add_cross_matrix(a, blocks + 9 * (ptrdiff_t)numbers[i * k + j]);
                }
            }
        }
    }
}

void patches_tangent(const gas_surfaces *all)
{
    memset(all->blocks, 0, (size_t)(9 * all->block_count) * sizeof(double));
    for (ptrdiff_t number = 0; number < all->kind_count; ++number) {
        const gas_patches *kind = all->kinds[number];
        const double force = kind->sign * all->orientation[kind->chamber] *
                             all->pressure[kind->chamber];
        add_tangent(kind, -force * all->alpha, all->mid, all->blocks);
    }
}
