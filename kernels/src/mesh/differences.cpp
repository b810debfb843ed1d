#include "mesh/differences.h"

#include <numeric>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index block = 1 << 16;  // numbers of one task: less than that takes no longer than waking a thread

}  // namespace

Index round_differences(Vector<double> moved, Vector<const double> base) {
    require(base.size() == moved.size(), "base: expected as many numbers as in moved");
    std::vector<Index> changed((moved.size() + block - 1) / block);
    for_ranges(moved.size(), block, [&](Index first, Index last) {
        Index count = 0;
        for (Index k = first; k < last; ++k) {
            const double value = base[k] + (moved[k] - base[k]);
            count += value != moved[k];
            moved[k] = value;
        }
        changed[first / block] = count;
    });
    return std::accumulate(changed.begin(), changed.end(), Index{0});
}

void take_differences(Matrix<const double> moved, Matrix<const double> base, Vector<const Index> rows,
                      Matrix<double> found) {
    const Index d = found.shape(1);
    require(moved.shape() == base.shape() && moved.shape(1) == d, "moved, base: expected one shape (n, d)");
    require(rows.size() == found.shape(0), "found: expected a row for each of rows");
    for_ranges(rows.size(), block / 4, [&](Index first, Index last) {
        for (Index j = first; j < last; ++j) {
            require(0 <= rows[j] && rows[j] < base.shape(0), "rows: expected rows of base");
            for (Index c = 0; c < d; ++c) found(j, c) = moved(rows[j], c) - base(rows[j], c);
        }
    });
}

}  // namespace mesh_motion
