/* What percuss is measured against: hand-written loops over two bars that meet, the second fixed at its far end.

   One function a pair of integrator and contact law, for three ways to store and march the bars:

   blocked_*   displacement and half-step velocity updated in place, block by block, dt over mass a node, stiffness an
               element; unlike bars and meshes would run at the same speed.
   levels_*    two displacement levels and one constant a bar: the least memory traffic of a step, uniform bars only.
   tiled_*     the same, tiles of the bars by several steps at a time; bars of more than 2 TOGETHER nodes only.

   All store the contact force of every `every`-th step. */

#define BLOCK 1024
#define TILE 1024
#define TOGETHER 16

enum { CENTRAL, WU };
enum { PENALTY, BIPENALTY, LAGRANGE };

struct contact {
    double dt, stiffness, mass, inverse_mass_a, inverse_mass_b; /* stiffness and mass of the penalty */
};

/* The force of a contact with gap and gap acceleration before, and gap after the step of the free bars. */
static inline __attribute__((always_inline)) double force_of(
    int integrator, int law, const struct contact *c, double gap, double acceleration, double predicted)
{
    double s = c->inverse_mass_a + c->inverse_mass_b;
    if (law == LAGRANGE)
        return predicted < 0.0 ? -predicted / (c->dt * c->dt * s) : 0.0;
    double seen = integrator == WU ? predicted : gap;
    if (!(seen < 0.0))
        return 0.0;
    if (law == PENALTY)
        return -c->stiffness * seen;
    double push = -c->stiffness * seen - (integrator == WU ? 0.0 : c->mass * acceleration);
    return push / (1.0 + c->mass * s);
}

static void advance(
    long n, double *restrict u, double *restrict v, const double *restrict dt_over_mass, const double *restrict k, double dt)
{
    double axial[BLOCK + 2]; /* of the elements to the left of each node of the block, and of the last one to its right */
    axial[0] = 0.0;
    for (long lo = 0; lo < n; lo += BLOCK) {
        long hi = lo + BLOCK < n ? lo + BLOCK : n, m = hi == n ? hi - lo - 1 : hi - lo;
        double *restrict U = u + lo, *restrict V = v + lo;
        const double *restrict K = k + lo, *restrict W = dt_over_mass + lo;
        for (long i = 0; i < m; i++)
            axial[i + 1] = K[i] * (U[i + 1] - U[i]);
        if (hi == n)
            axial[m + 1] = 0.0;
        for (long i = 0; i < hi - lo; i++) {
            V[i] += W[i] * (axial[i + 1] - axial[i]);
            U[i] += dt * V[i];
        }
        axial[0] = axial[m];
    }
}

static inline __attribute__((always_inline)) void blocked(
    int integrator, int law, long n, double *u, double *v, const double *w, const double *k, const struct contact *c,
    long steps, long every, double *out)
{
    long a = n - 1, b = n, last = 2 * n - 1;
    double dt = c->dt;
    for (long step = 0; step < steps; step++) {
        double gap = u[b] - u[a], rate = v[b] - v[a];
        advance(n, u, v, w, k, dt);
        advance(n, u + n, v + n, w + n, k + n - 1, dt);
        u[last] -= dt * v[last];
        v[last] = 0.0;
        double force = force_of(integrator, law, c, gap, (v[b] - v[a] - rate) / dt, u[b] - u[a]);
        if (force != 0.0) {
            v[a] -= w[a] * force;
            u[a] -= dt * w[a] * force;
            v[b] += w[b] * force;
            u[b] += dt * w[b] * force;
        }
        if (step % every == 0)
            out[step / every] = force;
    }
}

/* Inner nodes from `lo` to `hi` one level on: `p` holds the level before `q` and then the one after it; `r` is the
   Courant number squared. */
static inline __attribute__((always_inline)) void inner(long lo, long hi, double *restrict p, const double *restrict q, double r)
{
    double twice = 2.0 - 2.0 * r;
    for (long i = lo; i < hi; i++)
        p[i] = twice * q[i] - p[i] + r * (q[i - 1] + q[i + 1]);
}

/* Both ends of a bar one level on. */
static inline __attribute__((always_inline)) void ends(long n, double *restrict p, const double *restrict q, double r)
{
    double twice = 2.0 - 2.0 * r;
    p[0] = twice * q[0] - p[0] + 2.0 * r * q[1];
    p[n - 1] = twice * q[n - 1] - p[n - 1] + 2.0 * r * q[n - 2];
}

static void level(long n, double *restrict p, const double *restrict q, double r)
{
    inner(1, n - 1, p, q, r);
    ends(n, p, q, r);
}

/* The inside of a bar `steps` levels on, tile by tile, in step k all nodes but k + 1 at either end. */
static void inside(long n, double *p, double *q, double r, long steps)
{
    for (long tile = 1; tile < n - 1; tile += TILE)
        for (long k = 0; k < steps; k++) {
            long lo = tile == 1 ? 1 + k : tile - k, hi = (tile + TILE < n - 1 ? tile + TILE : n - 1) - k;
            inner(lo, hi, k % 2 ? q : p, k % 2 ? p : q, r);
        }
}

/* What `inside` has left out in step k. */
static void outside(long n, double *p, const double *q, double r, long k)
{
    inner(1, k + 1, p, q, r);
    inner(n - 1 - k, n - 1, p, q, r);
    ends(n, p, q, r);
}

static inline __attribute__((always_inline)) void levels(
    int integrator, int law, long together, long n, double *p, double *q, double r, const struct contact *c, long steps,
    long every, double *out)
{
    long a = n - 1, b = n, last = 2 * n - 1;
    double dt2 = c->dt * c->dt;
    for (long step = 0; step < steps; step++) {
        long k = step % together;
        if (together > 1 && k == 0) {
            long ahead = step + together < steps ? together : steps - step;
            inside(n, p, q, r, ahead);
            inside(n, p + n, q + n, r, ahead);
        }
        double gap = q[b] - q[a], before = p[b] - p[a];
        if (together > 1) {
            outside(n, p, q, r, k);
            outside(n, p + n, q + n, r, k);
        } else {
            level(n, p, q, r);
            level(n, p + n, q + n, r);
        }
        p[last] = 0.0;
        double predicted = p[b] - p[a];
        double force = force_of(integrator, law, c, gap, (predicted - 2.0 * gap + before) / dt2, predicted);
        if (force != 0.0) {
            p[a] -= dt2 * c->inverse_mass_a * force;
            p[b] += dt2 * c->inverse_mass_b * force;
        }
        if (step % every == 0)
            out[step / every] = force;
        double *next = p;
        p = q;
        q = next;
    }
}

#define PAIR(name, integrator, law)                                                                                     \
    void blocked_##name(long n, double *u, double *v, const double *w, const double *k, const struct contact *c,        \
                        long steps, long every, double *out)                                                            \
    {                                                                                                                   \
        blocked(integrator, law, n, u, v, w, k, c, steps, every, out);                                                  \
    }                                                                                                                   \
    void levels_##name(long n, double *p, double *q, double r, const struct contact *c, long steps, long every,         \
                       double *out)                                                                                     \
    {                                                                                                                   \
        levels(integrator, law, 1, n, p, q, r, c, steps, every, out);                                                   \
    }                                                                                                                   \
    void tiled_##name(long n, double *p, double *q, double r, const struct contact *c, long steps, long every,          \
                      double *out)                                                                                      \
    {                                                                                                                   \
        levels(integrator, law, TOGETHER, n, p, q, r, c, steps, every, out);                                            \
    }

PAIR(central_difference_penalty, CENTRAL, PENALTY)
PAIR(central_difference_bipenalty, CENTRAL, BIPENALTY)
PAIR(central_difference_lagrange, CENTRAL, LAGRANGE)
PAIR(wu_predictor_corrector_penalty, WU, PENALTY)
PAIR(wu_predictor_corrector_bipenalty, WU, BIPENALTY)
PAIR(wu_predictor_corrector_lagrange, WU, LAGRANGE)
