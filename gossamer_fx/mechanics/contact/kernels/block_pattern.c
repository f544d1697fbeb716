/* Which 3 x 3 blocks of a matrix groups of block rows couple, and the numbers of these blocks.  See
   contact.h. */
#include <string.h>

#include "contact.h"

/* Members sorted by their row, and the group of each. */
typedef struct {
    int32_t *row_start;   /* (rows + 2) where the members of each row begin in `sorted` */
    int32_t *last_row;    /* (rows) of a column: the last row that was coupled with it */
    int32_t *last_block;  /* (rows) of a column: the block of that row and it */
    int32_t *sorted;      /* (members) members, row by row */
    int32_t *group_start; /* (members) the first member of the same group */
    int32_t *group_size;  /* (members) of the same group */
    int32_t *entry;       /* (members) where the blocks of a member stand in `block_index` */
} sorted_members;

/* Arrays of the right lengths in the work space, of which Python allocates two arrays. */
static sorted_members divide_work(const block_groups *groups, const block_pattern *pattern,
                                  ptrdiff_t member_count)
{
    sorted_members work;
    work.row_start = pattern->row_work;
    work.last_row = work.row_start + groups->row_count + 2;
    work.last_block = work.last_row + groups->row_count;
    work.sorted = pattern->member_work;
    work.group_start = work.sorted + member_count;
    work.group_size = work.group_start + member_count;
    work.entry = work.group_size + member_count;
    return work;
}

/* A counting sort: afterwards row_start[i] and row_start[i + 1] delimit the members of row i. */
static void sort_by_row(const block_groups *groups, ptrdiff_t member_count,
                        const sorted_members *work)
{
    int32_t member = 0, entry = 0;
    memset(work->row_start, 0, (size_t)(groups->row_count + 2) * sizeof *work->row_start);
    for (ptrdiff_t g = 0; g < groups->group_count; ++g) {
        const int32_t start = member, size = groups->group_size[g];
        for (int32_t a = 0; a < size; ++a, ++member, entry += size) {
            work->group_start[member] = start;
            work->group_size[member] = size;
            work->entry[member] = entry;
            ++work->row_start[groups->members[member] + 2];
        }
    }
    for (ptrdiff_t i = 0; i < groups->row_count; ++i) {
        work->row_start[i + 1] += work->row_start[i];
        work->last_row[i] = -1;
    }
    for (int32_t m = 0; m < member_count; ++m) work->sorted[work->row_start[groups->members[m] + 1]++] = m;
}

ptrdiff_t number_blocks(const block_groups *groups, const block_pattern *pattern)
{
    ptrdiff_t member_count = 0;
    int32_t count = 0;
    for (ptrdiff_t g = 0; g < groups->group_count; ++g) member_count += groups->group_size[g];
    const sorted_members work = divide_work(groups, pattern, member_count);
    sort_by_row(groups, member_count, &work);
    for (int32_t row = 0; row < groups->row_count; ++row)
        for (int32_t k = work.row_start[row]; k < work.row_start[row + 1]; ++k) {
            const int32_t member = work.sorted[k];
            /* All members of a group are columns in the row of each. */
            for (int32_t b = 0; b < work.group_size[member]; ++b) {
                const int32_t column = groups->members[work.group_start[member] + b];
                if (work.last_row[column] != row) { /* a new block */
                    work.last_row[column] = row;
                    work.last_block[column] = count;
                    pattern->rows[count] = row;
                    pattern->columns[count++] = column;
                }
                pattern->block_index[work.entry[member] + b] = work.last_block[column];
            }
        }
    return count;
}

void find_nonzero_blocks(ptrdiff_t count, const int32_t *block, const double *blocks,
                         uint8_t *is_nonzero)
{
    for (ptrdiff_t i = 0; i < count; ++i) {
        const double *values = blocks + 9 * (ptrdiff_t)block[i];
        is_nonzero[i] = 0;
        for (int k = 0; k < 9 && !is_nonzero[i]; ++k) is_nonzero[i] = values[k] != 0;
    }
}
