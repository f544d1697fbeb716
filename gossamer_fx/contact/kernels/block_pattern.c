/* Where the blocks of coupled vectors stand: see blocks.py. */

/* n groups of `width` (n) vectors each, one after the other in `members`: vectors of a group couple with each other.
   rows, columns: of each block once, row after row; slots: the block of each two members of each group.
   Room to work: of_vectors (3 v + 2), of_members (4 members).  Returns the number of blocks. */
int lay_out(int n, int vectors, const int32_t *width, const int32_t *members, int32_t *slots, int32_t *rows,
            int32_t *columns, int32_t *of_vectors, int32_t *of_members)
{
    int32_t *start = of_vectors, *row = start + vectors + 2, *block = row + vectors;
    int total = 0, slot = 0, count = 0;
    for (int g = 0; g < n; ++g) total += width[g];
    int32_t *sorted = of_members, *first = sorted + total, *size = first + total, *place = size + total;
    memset(start, 0, (vectors + 2) * sizeof *start);
    for (int g = 0, m = 0; g < n; ++g) {
        const int begin = m;
        for (int a = 0; a < width[g]; ++a, ++m, slot += width[g]) {
            first[m] = begin, size[m] = width[g], place[m] = slot;
            ++start[members[m] + 2];
        }
    }
    for (int i = 0; i < vectors; ++i) start[i + 1] += start[i], row[i] = -1;
    for (int m = 0; m < total; ++m) sorted[start[members[m] + 1]++] = m;
    /* now start[i] is where the members that are vector i begin, and start[i + 1] where they end */
    for (int i = 0; i < vectors; ++i)
        for (int k = start[i]; k < start[i + 1]; ++k) {
            const int m = sorted[k];
            for (int b = 0; b < size[m]; ++b) {
                const int j = members[first[m] + b];
                if (row[j] != i) row[j] = i, block[j] = count, rows[count] = i, columns[count++] = j;
                slots[place[m] + b] = block[j];
            }
        }
    return count;
}

/* Which of some blocks are not zero: kept (n). */
void which_count(int n, const int32_t *block, const double *values, uint8_t *kept)
{
    for (int i = 0; i < n; ++i) {
        const double *value = values + 9 * (int64_t)block[i];
        kept[i] = 0;
        for (int k = 0; k < 9 && !kept[i]; ++k) kept[i] = value[k] != 0;
    }
}
