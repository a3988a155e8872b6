/* Hand-vectorised bound for the 9-parameter invariant problem: two full Gauss-Newton steps, then steps with
   the kept factor until all lanes settle. W devices at a time in the vector lanes, no covariance.
   outputs: [devices / W][3][n][W] in g; weights: [n]; result: [devices / W][9][W]. */
#include <math.h>
#define W 8
typedef double lane __attribute__((vector_size(8 * W)));

static inline lane lsqrt(lane x) { for (int i = 0; i < W; i++) x[i] = sqrt(x[i]); return x; }

static inline void rows(const lane *p, lane a0, lane a1, lane a2, lane *size, lane *g) {
  lane d0 = 1.0 / (1.0 + p[3]), d1 = 1.0 / (1.0 + p[5]), d2 = 1.0 / (1.0 + p[8]);
  lane f0 = (a0 - p[0]) * d0, f1 = (a1 - p[1] - p[4] * f0) * d1;
  lane f2 = (a2 - p[2] - p[6] * f0 - p[7] * f1) * d2;
  lane n = lsqrt(f0 * f0 + f1 * f1 + f2 * f2), r = 1.0 / n;
  lane v2 = f2 * r * d2, v1 = (f1 * r - p[7] * v2) * d1, v0 = (f0 * r - p[4] * v1 - p[6] * v2) * d0;
  *size = n;
  g[0] = v0; g[1] = v1; g[2] = v2;
  g[3] = v0 * f0; g[4] = v1 * f0; g[5] = v1 * f1; g[6] = v2 * f0; g[7] = v2 * f1; g[8] = v2 * f2;
}

static void solve(lane l[9][9], const lane *b, lane *x) {
  lane y[9];
  for (int i = 0; i < 9; i++) { lane t = b[i]; for (int k = 0; k < i; k++) t -= l[i][k] * y[k]; y[i] = t * l[i][i]; }
  for (int i = 8; i >= 0; i--) { lane t = y[i]; for (int k = i + 1; k < 9; k++) t -= l[k][i] * x[k]; x[i] = t * l[i][i]; }
}

void fit(const double *outputs, const double *weights, double *result, long blocks, long n, double tolerance) {
  for (long block = 0; block < blocks; block++) {
    const lane *a = (const lane *)(outputs + block * 3 * n * W);
    lane p[9] = {0}, l[9][9], scale[9], b[9], x[9], g[9], size;
    for (int full = 0; full < 2; full++) {
      lane m[9][9] = {0};
      for (int i = 0; i < 9; i++) b[i] = (lane){0};
      for (long k = 0; k < n; k++) {
        double w2 = weights[k] * weights[k];
        rows(p, a[k], a[n + k], a[2 * n + k], &size, g);
        lane r = (size - 1.0) * w2;
        for (int i = 0; i < 9; i++) { lane s = g[i] * w2; b[i] += g[i] * r; for (int j = 0; j <= i; j++) m[i][j] += s * g[j]; }
      }
      for (int i = 0; i < 9; i++) scale[i] = lsqrt(m[i][i]);
      for (int j = 0; j < 9; j++) {
        lane s = m[j][j];
        for (int k = 0; k < j; k++) s -= l[j][k] * l[j][k];
        l[j][j] = 1.0 / lsqrt(s);
        for (int i = j + 1; i < 9; i++) { lane t = m[i][j]; for (int k = 0; k < j; k++) t -= l[i][k] * l[j][k]; l[i][j] = t * l[j][j]; }
      }
      solve(l, b, x);
      for (int i = 0; i < 9; i++) p[i] += x[i];
    }
    for (int step = 0; step < 20; step++) {
      for (int i = 0; i < 9; i++) b[i] = (lane){0};
      for (long k = 0; k < n; k++) {
        rows(p, a[k], a[n + k], a[2 * n + k], &size, g);
        lane r = (size - 1.0) * (weights[k] * weights[k]);
        for (int i = 0; i < 9; i++) b[i] += g[i] * r;
      }
      solve(l, b, x);
      double largest = 0;
      for (int i = 0; i < 9; i++) { p[i] += x[i]; for (int q = 0; q < W; q++) largest = fmax(largest, fabs(x[i][q]) * scale[i][q]); }
      if (largest < tolerance) break;
    }
    for (int i = 0; i < 9; i++) for (int q = 0; q < W; q++) result[(block * 9 + i) * W + q] = p[i][q];
  }
}
