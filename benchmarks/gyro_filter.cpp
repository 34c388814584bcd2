// The limit of `turntable.py`: a gyro filter of 18 states, written out for it alone, in one thread.
// As there, rates are parabolas through three samples with the term of coning, the attitude is
// propagated at each sample, and the covariance at each readback of the table. The last three
// states, the drift of the biases, stay as they begin.

#include <cstring>

namespace {

constexpr int N = 18;
using Row = double[N];

struct Matrix {
    double a[3][3];
};

Matrix product(const Matrix &x, const Matrix &y) {
    Matrix z;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            z.a[i][j] = x.a[i][0] * y.a[0][j] + x.a[i][1] * y.a[1][j] + x.a[i][2] * y.a[2][j];
    return z;
}

// exp([v×]) of a small rotation vector.
Matrix rotation(const double v[3]) {
    const double xx = v[0] * v[0], yy = v[1] * v[1], zz = v[2] * v[2], s = xx + yy + zz;
    const double p = 1 - s * (1.0 / 6 - s * (1.0 / 120)), q = 0.5 - s * (1.0 / 24 - s * (1.0 / 720));
    const double xy = q * v[0] * v[1], xz = q * v[0] * v[2], yz = q * v[1] * v[2];
    return {{{1 - q * (yy + zz), xy - p * v[2], xz + p * v[1]},
             {xy + p * v[2], 1 - q * (xx + zz), yz - p * v[0]},
             {xz - p * v[1], yz + p * v[0], 1 - q * (xx + yy)}}};
}

Matrix inverse(const Matrix &m) {
    const auto &a = m.a;
    Matrix r;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            r.a[j][i] = a[i1][j1] * a[i2][j2] - a[i1][j2] * a[i2][j1];
        }
    const double per = 1 / (a[0][0] * r.a[0][0] + a[0][1] * r.a[1][0] + a[0][2] * r.a[2][0]);
    for (auto &row : r.a)
        for (double &x : row)
            x *= per;
    return r;
}

}  // namespace

// time (n) s, rates (n, 3) rad/s, resting (n), readback (n / every + 1, 3, 3), earth (3) rad/s,
// start (18) standard deviations; found (12): biases, then S row by row; at the start of the call
// the biases to begin with.
extern "C" void run_filter(long n, const double *time, const double *rates,
                           const unsigned char *resting, const double *readback, long every, const double *earth, double sd,
                           double walk, const double *start, double *found) {
    double p[N][N] = {}, x[N] = {}, s[3][3] = {}, bias[3];
    std::memcpy(bias, found, sizeof bias);
    for (int k = 0; k < N; ++k)
        p[k][k] = start[k] * start[k];
    Matrix c, m = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    std::memcpy(&c, readback, sizeof c);
    double driven[3][N - 3] = {}, last = 0.0, begun = time[0];
    for (long i = 1; i < n; ++i) {
        const double *now = rates + 3 * i, *before = now - 3, *earlier = i > 1 ? now - 6 : before;
        const double dt = time[i] - time[i - 1], square = dt * dt * (1.0 / 12);
        const bool bends = last > 0 && dt > 0 && dt <= 3 * last && last <= 3 * dt;
        const double per = bends ? 1 / dt : 0.0, per_last = bends ? 1 / last : 0.0;
        const double per_two = bends ? 2 / (dt + last) : 0.0;
        last = dt;
        double u[3], w[3], turn[3], half[3], felt[3];
        for (int k = 0; k < 3; ++k) {
            const double bend =
                ((now[k] - before[k]) * per - (before[k] - earlier[k]) * per_last) * per_two;
            u[k] = 0.5 * (now[k] + before[k]) - bend * square - bias[k];
        }
        for (int k = 0; k < 3; ++k) {
            w[k] = m.a[k][0] * u[0] + m.a[k][1] * u[1] + m.a[k][2] * u[2];
            felt[k] = c.a[0][k] * earth[0] + c.a[1][k] * earth[1] + c.a[2][k] * earth[2];
            const int j1 = (k + 1) % 3, j2 = (k + 2) % 3;
            turn[k] = (w[k] - felt[k]) * dt + (before[j1] * now[j2] - before[j2] * now[j1]) * square;
            half[k] = 0.5 * turn[k];
            if (resting[i])
                w[k] = felt[k];
        }
        const Matrix cm = product(product(c, rotation(half)), m);
        c = product(c, rotation(turn));
        for (int r = 0; r < 3; ++r)
            for (int k = 0; k < 3; ++k) {
                const double step = cm.a[r][k] * dt;
                driven[r][k] = driven[r][12 + k] -= step;
                for (int j = 0; j < 3; ++j)
                    driven[r][3 + 3 * k + j] -= step * w[j];
            }
        if (i % every)
            continue;
        const double since = time[i] - begun;
        begun = time[i];
        double a[3][N] = {{1, earth[2] * since, -earth[1] * since},
                          {-earth[2] * since, 1, earth[0] * since},
                          {earth[1] * since, -earth[0] * since, 1}};
        double moved[3][N] = {};
        for (int r = 0; r < 3; ++r) {
            std::memcpy(&a[r][3], driven[r], sizeof driven[r]);
            for (int k = 0; k < N; ++k)
                for (int j = 0; j < N; ++j)
                    moved[r][j] += a[r][k] * p[k][j];
        }
        std::memset(driven, 0, sizeof driven);
        for (int r = 0; r < 3; ++r) {
            for (int k = 0; k < 3; ++k) {
                p[r][k] = r == k ? walk * walk * since : 0.0;
                for (int j = 0; j < N; ++j)
                    p[r][k] += moved[r][j] * a[k][j];
            }
            for (int k = 3; k < N; ++k)
                p[r][k] = p[k][r] = moved[r][k];
        }
        Matrix seen, back;
        std::memcpy(&seen, readback + 9 * (i / every), sizeof seen);
        for (int r = 0; r < 3; ++r)
            for (int k = 0; k < 3; ++k)
                back.a[k][r] = c.a[r][k];
        const Matrix off = product(seen, back);
        const double z[3] = {0.5 * (off.a[2][1] - off.a[1][2]), 0.5 * (off.a[0][2] - off.a[2][0]),
                             0.5 * (off.a[1][0] - off.a[0][1])};
        for (int r = 0; r < 3; ++r) {
            Row gain;
            const double per = 1 / (p[r][r] + sd * sd), innovation = z[r] - x[r];
            std::memcpy(gain, p[r], sizeof gain);
            for (int k = 0; k < N; ++k) {
                const double by = gain[k] * per;
                x[k] += by * innovation;
                for (int j = 0; j < N; ++j)
                    p[k][j] -= by * gain[j];
            }
        }
        c = product(rotation(x), c);
        Matrix one;
        for (int r = 0; r < 3; ++r) {
            bias[r] += x[3 + r];
            for (int k = 0; k < 3; ++k) {
                s[r][k] += x[6 + 3 * r + k];
                one.a[r][k] = (r == k) + s[r][k];
            }
        }
        m = inverse(one);
        std::memset(x, 0, sizeof x);
    }
    std::memcpy(found, bias, sizeof bias);
    std::memcpy(found + 3, s, sizeof s);
}
