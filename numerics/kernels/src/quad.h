// Four adjacent numbers, for sums that are too short for the compiler's own vector loops.
#pragma once

namespace mesh_motion {

/// One register of AVX, two of SSE2; the results are equal. Passed by reference, because passing by value differs
/// between targets.
using Quad [[gnu::vector_size(4 * sizeof(double))]] = double;

}  // namespace mesh_motion
