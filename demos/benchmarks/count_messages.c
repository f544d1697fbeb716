/* Counts what a process sends through MPI.  It is loaded before the MPI library, and hands each
   call on by MPI's profiling interface.

   `counts` are messages and their bytes, then collective operations and the bytes that this process
   gives to each; first those of C, Python and C++, then those of Fortran, which is MUMPS here. */

#include <mpi.h>

enum { MESSAGES, MESSAGE_BYTES, COLLECTIVES, COLLECTIVE_BYTES, KINDS };
enum { OF_C = 0, OF_FORTRAN = KINDS };
double counts[2 * KINDS];

static double size_of(double number, MPI_Datatype type) {
  int bytes;
  PMPI_Type_size(type, &bytes);
  return number * bytes;
}

static void message(double bytes, int caller) {
  counts[caller + MESSAGES] += 1;
  counts[caller + MESSAGE_BYTES] += bytes;
}

static void collective(double bytes, MPI_Comm c, int caller) {
  int ranks;
  PMPI_Comm_size(c, &ranks);
  if (ranks == 1) return;
  counts[caller + COLLECTIVES] += 1;
  counts[caller + COLLECTIVE_BYTES] += bytes;
}

/* ---- messages ---- */

int MPI_Send(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c) {
  message(size_of(n, t), OF_C);
  return PMPI_Send(b, n, t, to, tag, c);
}

int MPI_Isend(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c, MPI_Request *r) {
  message(size_of(n, t), OF_C);
  return PMPI_Isend(b, n, t, to, tag, c, r);
}

int MPI_Issend(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c, MPI_Request *r) {
  message(size_of(n, t), OF_C);
  return PMPI_Issend(b, n, t, to, tag, c, r);
}

/* Persistent requests are made once and started again and again.  A request that receives replaces
   one that has sent and was freed, as MPI may use its handle again. */
enum { MAX_REQUESTS = 100000, RECEIVES = -1 };
static MPI_Request requests[MAX_REQUESTS];
static double bytes_of[MAX_REQUESTS];
static int request_count;

static int find(MPI_Request request) {
  int k = 0;
  while (k < request_count && requests[k] != request) k++;
  return k;
}

static void remember(MPI_Request request, double bytes) {
  int k = find(request);
  if (k == request_count) {
    if (k == MAX_REQUESTS) MPI_Abort(MPI_COMM_WORLD, 1);
    requests[request_count++] = request;
  }
  bytes_of[k] = bytes;
}

static void start(MPI_Request request) {
  int k = find(request);
  if (k < request_count && bytes_of[k] != RECEIVES) message(bytes_of[k], OF_C);
}

int MPI_Send_init(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c,
                  MPI_Request *r) {
  int code = PMPI_Send_init(b, n, t, to, tag, c, r);
  remember(*r, size_of(n, t));
  return code;
}

int MPI_Recv_init(void *b, int n, MPI_Datatype t, int from, int tag, MPI_Comm c, MPI_Request *r) {
  int code = PMPI_Recv_init(b, n, t, from, tag, c, r);
  remember(*r, RECEIVES);
  return code;
}

int MPI_Start(MPI_Request *r) {
  start(*r);
  return PMPI_Start(r);
}

int MPI_Startall(int n, MPI_Request *r) {
  for (int k = 0; k < n; k++) start(r[k]);
  return PMPI_Startall(n, r);
}

/* Exchanges among neighbours are messages, of which empty ones are not sent. */
static void neighbours(const int *n, MPI_Datatype t, MPI_Comm c) {
  int in, out, weighted;
  PMPI_Dist_graph_neighbors_count(c, &in, &out, &weighted);
  for (int k = 0; k < out; k++)
    if (n[k]) message(size_of(n[k], t), OF_C);
}

int MPI_Neighbor_alltoallv(const void *s, const int *sn, const int *sd, MPI_Datatype st, void *r,
                           const int *rn, const int *rd, MPI_Datatype rt, MPI_Comm c) {
  neighbours(sn, st, c);
  return PMPI_Neighbor_alltoallv(s, sn, sd, st, r, rn, rd, rt, c);
}

int MPI_Ineighbor_alltoallv(const void *s, const int *sn, const int *sd, MPI_Datatype st, void *r,
                            const int *rn, const int *rd, MPI_Datatype rt, MPI_Comm c,
                            MPI_Request *request) {
  neighbours(sn, st, c);
  return PMPI_Ineighbor_alltoallv(s, sn, sd, st, r, rn, rd, rt, c, request);
}

/* ---- collective operations ---- */

int MPI_Allreduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c) {
  collective(size_of(n, t), c, OF_C);
  return PMPI_Allreduce(s, r, n, t, o, c);
}

int MPI_Reduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, int root, MPI_Comm c) {
  collective(size_of(n, t), c, OF_C);
  return PMPI_Reduce(s, r, n, t, o, root, c);
}

int MPI_Bcast(void *b, int n, MPI_Datatype t, int root, MPI_Comm c) {
  collective(size_of(n, t), c, OF_C);
  return PMPI_Bcast(b, n, t, root, c);
}

int MPI_Exscan(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c) {
  collective(size_of(n, t), c, OF_C);
  return PMPI_Exscan(s, r, n, t, o, c);
}

int MPI_Allgather(const void *s, int n, MPI_Datatype t, void *r, int m, MPI_Datatype u,
                  MPI_Comm c) {
  collective(size_of(n, t), c, OF_C);
  return PMPI_Allgather(s, n, t, r, m, u, c);
}

int MPI_Allgatherv(const void *s, int n, MPI_Datatype t, void *r, const int *m, const int *d,
                   MPI_Datatype u, MPI_Comm c) {
  collective(size_of(n, t), c, OF_C);
  return PMPI_Allgatherv(s, n, t, r, m, d, u, c);
}

int MPI_Iallgatherv(const void *s, int n, MPI_Datatype t, void *r, const int *m, const int *d,
                    MPI_Datatype u, MPI_Comm c, MPI_Request *request) {
  collective(size_of(n, t), c, OF_C);
  return PMPI_Iallgatherv(s, n, t, r, m, d, u, c, request);
}

int MPI_Barrier(MPI_Comm c) {
  collective(0, c, OF_C);
  return PMPI_Barrier(c);
}

/* ---- the same, called by Fortran, whose arguments are addresses ---- */

#define SIZE size_of(*(MPI_Fint *)n, PMPI_Type_f2c(*(MPI_Fint *)t))
#define RANKS PMPI_Comm_f2c(*(MPI_Fint *)c)
#define FORTRAN(NAME, COUNT, DECLARED, GIVEN) \
  void pmpi_##NAME##_ DECLARED;               \
  void mpi_##NAME##_ DECLARED {               \
    COUNT;                                    \
    pmpi_##NAME##_ GIVEN;                     \
  }

FORTRAN(send, message(SIZE, OF_FORTRAN),
        (void *b, void *n, void *t, void *to, void *tag, void *c, void *e),
        (b, n, t, to, tag, c, e))
FORTRAN(isend, message(SIZE, OF_FORTRAN),
        (void *b, void *n, void *t, void *to, void *tag, void *c, void *r, void *e),
        (b, n, t, to, tag, c, r, e))
FORTRAN(allreduce, collective(SIZE, RANKS, OF_FORTRAN),
        (void *s, void *r, void *n, void *t, void *o, void *c, void *e), (s, r, n, t, o, c, e))
FORTRAN(reduce, collective(SIZE, RANKS, OF_FORTRAN),
        (void *s, void *r, void *n, void *t, void *o, void *root, void *c, void *e),
        (s, r, n, t, o, root, c, e))
FORTRAN(bcast, collective(SIZE, RANKS, OF_FORTRAN),
        (void *b, void *n, void *t, void *root, void *c, void *e), (b, n, t, root, c, e))
