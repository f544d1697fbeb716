/* Search for near pairs in a tree of boxes, and motion check: see search.py. */

static int overlap(const double *a, const double *b)
{
    for (int c = 0; c < 3; ++c)
        if (a[c] > b[3 + c] || b[c] > a[3 + c]) return 0;
    return 1;
}

/* Boxes (2 size, 6) of a complete binary tree, root 1, whose leaves are `boxes` (n, 6) in the given order. */
void build_tree(int n, int size, const double *boxes, const int32_t *order, double *tree)
{
    for (int i = 0; i < size; ++i) {
        double *box = tree + 6 * (int64_t)(size + i);
        if (i < n) memcpy(box, boxes + 6 * (int64_t)order[i], 6 * sizeof *box);
        else
            for (int c = 0; c < 3; ++c) box[c] = INFINITY, box[3 + c] = -INFINITY;
    }
    for (int i = size - 1; i > 0; --i)
        for (int c = 0; c < 3; ++c) {
            const double *l = tree + 12 * (int64_t)i, *r = l + 6;
            tree[6 * (int64_t)i + c] = l[c] < r[c] ? l[c] : r[c];
            tree[6 * (int64_t)i + 3 + c] = l[3 + c] > r[3 + c] ? l[3 + c] : r[3 + c];
        }
}

/* Pairs (i, j) of a queried box and one of the tree that overlap; those with a common place, or both fixed, are
   left out, and of one set (`self`) those with j <= i.  Returns their number, of which at most `room` are written. */
int64_t overlaps(int n, int size, const double *tree, const int32_t *order, int queries, const int32_t *query,
                 const double *boxes, int self, int ka, const int32_t *a, int kb, const int32_t *b,
                 const uint8_t *fixed_a, const uint8_t *fixed_b, int64_t room, int32_t *pairs)
{
    int64_t found = 0;
    for (int k = 0; k < queries; ++k) {
        const int32_t i = query[k];
        const double *box = boxes + 6 * (int64_t)i;
        int stack[64], depth = 0;
        stack[depth++] = 1;
        while (depth) {
            const int node = stack[--depth];
            if (!overlap(tree + 6 * (int64_t)node, box)) continue;
            if (node < size) {
                stack[depth++] = 2 * node, stack[depth++] = 2 * node + 1;
                continue;
            }
            if (node - size >= n) continue;
            const int32_t j = order[node - size];
            if ((self && j <= i) || (fixed_a[i] && fixed_b[j])) continue;
            int common = 0;
            for (int l = 0; l < ka; ++l)
                for (int m = 0; m < kb; ++m) common |= a[ka * (int64_t)i + l] == b[kb * (int64_t)j + m];
            if (common) continue;
            if (found < room) pairs[2 * found] = i, pairs[2 * found + 1] = j;
            ++found;
        }
    }
    return found;
}

/* Whether pairs keep a least distance on the straight way of all points from x0 to x1: additive motion check.

   Li et al., "Codimensional incremental potential contact" (2021), section 4: a pair may advance by the part of its
   distance that its points can cover at most, again and again.  radius (n) is taken off the distances; gap (n) are
   those of x0, least (n) those to be kept.
   free (n): 1 yes, 0 no.  Returns the number of those that do not. */
int motion(int n, const int32_t *pairs, const uint8_t *kind, const double *x0, const double *x1, const double *radius,
           const double *gap, const double *least, int most, uint8_t *free)
{
    int refused = 0;
    const int32_t own[4] = {0, 1, 2, 3};
    for (int i = 0; i < n; ++i) {
        const int32_t *p = pairs + 4 * i;
        double x[12];
        free[i] = 1;
        const double way = approach(kind[i], x0, x1, p);
        const double d0 = gap[i];
        if (way <= d0 - least[i]) continue;
        double t = 0, d = d0;
        for (int step = 0; step < most; ++step) {
            const double advance = 0.9 * (d - least[i]) / way;
            if (t + advance >= 1) break;
            t += advance;
            for (int k = 0; k < 12; ++k) {
                const int j = 3 * p[k / 3] + k % 3;
                x[k] = x0[j] + t * (x1[j] - x0[j]);
            }
            d = sqrt(distance2(kind[i], x, own)) - radius[i];
            if (!(d > 1.01 * least[i]) || step == most - 1) {
                free[i] = 0;
                ++refused;
                break;
            }
        }
    }
    return refused;
}
