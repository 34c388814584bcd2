// The norms of a centrifuge with nine coefficients, one trial after another, as benchmarks/centrifuge.py
// states the problem: Gauss-Newton with the closed root of y = k0 + (1 + k1) f + k2 f^2, weights by
// the noise that belongs to the coefficients of the step, and the covariance of the last step.
#include <algorithm>
#include <cmath>

namespace {
constexpr int kSize = 9, kSteps = 30;

// Factor the packed-by-rows symmetric matrix in place, lower triangle; false where it is singular.
bool factor(double a[kSize][kSize]) {
  for (int j = 0; j < kSize; ++j) {
    for (int k = 0; k < j; ++k) a[j][j] -= a[j][k] * a[j][k];
    if (!(a[j][j] > 0)) return false;
    a[j][j] = std::sqrt(a[j][j]);
    for (int i = j + 1; i < kSize; ++i) {
      for (int k = 0; k < j; ++k) a[i][j] -= a[i][k] * a[j][k];
      a[i][j] /= a[j][j];
    }
  }
  return true;
}

void solve(const double a[kSize][kSize], double* b) {
  for (int i = 0; i < kSize; ++i) {
    for (int k = 0; k < i; ++k) b[i] -= a[i][k] * b[k];
    b[i] /= a[i][i];
  }
  for (int i = kSize - 1; i >= 0; --i) {
    for (int k = i + 1; k < kSize; ++k) b[i] -= a[k][i] * b[k];
    b[i] /= a[i][i];
  }
}
}  // namespace

extern "C" int fit_norms(const double* y, const double* norm, long trials, long rows, double sd,
                         double* values, double* covariances) {
  for (long t = 0; t < trials; ++t) {
    const double* reading = y + t * rows * 3;
    double* x = values + t * kSize;
    std::fill(x, x + kSize, 0.0);
    double a[kSize][kSize];
    bool done = false;
    for (int step = 0; step < kSteps && !done; ++step) {
      double g[kSize] = {};
      for (auto& line : a) std::fill(line, line + kSize, 0.0);
      for (long r = 0; r < rows; ++r) {
        double f[3], by[3], square = 0;
        for (int k = 0; k < 3; ++k) {
          const double u = reading[3 * r + k] - x[3 * k], s = 1 + x[3 * k + 1];
          by[k] = std::sqrt(s * s + 4 * x[3 * k + 2] * u);
          f[k] = 2 * u / (s + by[k]);
          square += f[k] * f[k];
        }
        const double length = std::sqrt(square);
        double noise = 0, j[kSize];
        for (int k = 0; k < 3; ++k) {
          by[k] = f[k] / (length * by[k]);
          noise += by[k] * by[k];
        }
        const double w = 1 / (sd * std::sqrt(noise)), residual = (length - norm[r]) * w;
        for (int k = 0; k < 3; ++k) {
          j[3 * k] = -by[k] * w;
          j[3 * k + 1] = j[3 * k] * f[k];
          j[3 * k + 2] = j[3 * k + 1] * f[k];
        }
        for (int i = 0; i < kSize; ++i) {
          g[i] -= j[i] * residual;
          for (int k = 0; k <= i; ++k) a[i][k] += j[i] * j[k];
        }
      }
      if (!factor(a)) return 1;
      solve(a, g);
      double size = 0;
      for (int i = 0; i < kSize; ++i) {
        x[i] += g[i];
        size = std::max(size, std::abs(g[i]));
      }
      done = size < 1e-9;
    }
    if (!done) return 2;
    for (int i = 0; i < kSize; ++i) {
      double column[kSize] = {};
      column[i] = 1;
      solve(a, column);
      std::copy(column, column + kSize, covariances + (t * kSize + i) * kSize);
    }
  }
  return 0;
}
