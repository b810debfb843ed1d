// Loops that only move numbers, or only calculate, to measure the limits of the machine. limits.py builds it.

#include <cmath>
#include <thread>
#include <vector>

namespace {

using Index = long long;

/// task(thread) on so many threads, the caller's among them.
template <typename Task>
void on_threads(Index threads, const Task& task) {
    std::vector<std::thread> others;
    for (Index thread = 1; thread < threads; ++thread) others.emplace_back(task, thread);
    task(Index{0});
    for (std::thread& other : others) other.join();
}

/// task(first, last, thread) of each thread's share of n.
template <typename Task>
void shared(Index n, Index threads, const Task& task) {
    on_threads(threads, [&](Index thread) { task(n * thread / threads, n * (thread + 1) / threads, thread); });
}

}  // namespace

extern "C" {

/// a = b + 3 c: two arrays are read, one is written.
void triad(double* __restrict a, const double* b, const double* c, Index n, Index threads) {
    shared(n, threads, [=](Index first, Index last, Index) {
        for (Index i = first; i < last; ++i) a[i] = b[i] + 3.0 * c[i];
    });
}

/// Sums of the threads' shares of a.
void read_all(const double* a, Index n, double* sums, Index threads) {
    shared(n, threads, [=](Index first, Index last, Index thread) {
        double total = 0.0;
        for (Index i = first; i < last; ++i) total += a[i];
        sums[thread] = total;
    });
}

/// Each thread computes two polynomials of degree 32 of a few numbers, many times: fused multiply-adds on registers.
void horner(const double* values, Index n, Index turns, double* sums, Index threads) {
    on_threads(threads, [=](Index thread) {
        double total = 0.0;
        for (Index turn = 0; turn < turns; ++turn)
            for (Index i = 0; i < n; ++i) {
                const double x = values[i] + 1e-9 * static_cast<double>(turn);
                double first = x, second = x + 1.0;
#pragma GCC unroll 32
                for (int degree = 0; degree < 32; ++degree) {
                    first = first * x + 0.5;
                    second = second * x + 0.25;
                }
                total += first + second;
            }
        sums[thread] = total;
    });
}

/// out (n, 3) = Σ φ(|x − c|) w of Wendland's C2 function over all centres (3, m) inside its support, not cut off.
void basis_sums(const double* points, Index n, const double* centres, const double* weights, Index m, double* out,
                Index threads) {
    shared(n, threads, [=](Index first, Index last, Index) {
        for (Index i = first; i < last; ++i) {
            const double x = points[3 * i], y = points[3 * i + 1], z = points[3 * i + 2];
            double a = 0.0, b = 0.0, c = 0.0;
            for (Index j = 0; j < m; ++j) {
                const double dx = x - centres[j], dy = y - centres[m + j], dz = z - centres[2 * m + j];
                const double xi = 0.4 * std::sqrt(dx * dx + dy * dy + dz * dz);
                const double square = (1.0 - xi) * (1.0 - xi);
                const double value = square * square * (4.0 * xi + 1.0);
                a += value * weights[j];
                b += value * weights[m + j];
                c += value * weights[2 * m + j];
            }
            out[3 * i] = a, out[3 * i + 1] = b, out[3 * i + 2] = c;
        }
    });
}
}
