// Four adjacent numbers, for sums too short for the compiler's own vector loops.
#pragma once

namespace mesh_motion {

/// One register of AVX, two of SSE2; the results are the same. Passed by reference: how it goes by value differs.
using Quad [[gnu::vector_size(4 * sizeof(double))]] = double;

}  // namespace mesh_motion
