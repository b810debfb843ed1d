#include "two_scale/near_operator.h"

#include "parallel.h"
#include "quad.h"

namespace mesh_motion {
namespace {

constexpr Index products = 1 << 16;  // of one task, in the mean

}  // namespace

void add_product(Vector<const Index> rows, Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns,
                 Vector<const double> entries, Matrix<const double> weights, Matrix<double> out) {
    const Index n = rows.size(), k = out.shape(1), groups = (k + 3) / 4;
    require(pointers.size() == n + 1 && columns.size() == entries.size(), "pointers, columns: expected (r + 1,), (e,)");
    require(weights.shape(1) == k, "weights: expected as many columns as in out");
    for (Index i = 0; i < n; ++i)
        require(0 <= pointers[i] && pointers[i] <= pointers[i + 1] && pointers[i + 1] <= entries.size(),
                "pointers: expected numbers of entries, ascending");
    std::vector<Quad> vectors(weights.shape(0) * groups);  // rows of whole registers
    for (Index j = 0; j < weights.shape(0); ++j)
        for (Index c = 0; c < k; ++c) vectors[j * groups + c / 4][c % 4] = weights(j, c);
    const Index rows_of_a_task = std::max<Index>(1, products * n / std::max<Index>(1, entries.size()));
    for_ranges(n, rows_of_a_task, [&](Index begin, Index end) {
        const double* __restrict weight = entries.data();
        const std::int32_t* __restrict column = columns.data();
        for (Index i = begin; i < end; ++i)
            for (Index g = 0; g < groups; ++g) {
                const Quad* __restrict vector = vectors.data() + g;
                Quad even{}, odd{};  // apart: one sum would wait for each product
                Index e = pointers[i];
                for (; e + 1 < pointers[i + 1]; e += 2) {
                    even += weight[e] * vector[column[e] * groups];
                    odd += weight[e + 1] * vector[column[e + 1] * groups];
                }
                if (e < pointers[i + 1]) even += weight[e] * vector[column[e] * groups];
                even += odd;
                for (Index c = 4 * g; c < std::min(4 * g + 4, k); ++c) out(rows[i], c) += even[c - 4 * g];
            }
    });
}

}  // namespace mesh_motion
