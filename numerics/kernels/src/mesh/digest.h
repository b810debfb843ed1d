// Hashes of many numbers at the speed of memory.
#pragma once

#include "view.h"

namespace mesh_motion {

/// (b, 4) lanes of each block of 8192 words (n,): the round of XXH64, a multiplication and a rotation a word (Y. Collet,
/// https://github.com/Cyan4973/xxHash/blob/dev/doc/xxhash_spec.md). Words missing in the last block are skipped.
Owned<std::uint64_t, 2> hash_blocks(Vector<const std::uint64_t> words);

}  // namespace mesh_motion
