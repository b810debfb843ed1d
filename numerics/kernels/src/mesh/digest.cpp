#include "mesh/digest.h"

#include <bit>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index block = 8192, blocks_per_task = 16;

std::uint64_t mix(std::uint64_t lane, std::uint64_t word) {
    return std::rotl(lane + word * 0xC2B2AE3D27D4EB4Fu, 31) * 0x9E3779B185EBCA87u;
}

}  // namespace

Owned<std::uint64_t, 2> hash_blocks(Vector<const std::uint64_t> words) {
    const Index blocks = (words.size() + block - 1) / block;
    Owned<std::uint64_t, 2> lanes{std::vector<std::uint64_t>(4 * blocks), {blocks, 4}};
    for_ranges(blocks, blocks_per_task, [&](Index first, Index last) {
        for (Index b = first; b < last; ++b) {
            const auto here = words.rows(b * block, std::min(words.size(), (b + 1) * block));
            std::array<std::uint64_t, 4> lane{static_cast<std::uint64_t>(here.size()), 1, 2, 3};
            Index i = 0;
            for (; i + 4 <= here.size(); i += 4)
                for (Index l = 0; l < 4; ++l) lane[l] = mix(lane[l], here[i + l]);
            for (; i < here.size(); ++i) lane[0] = mix(lane[0], here[i]);
            std::copy(lane.begin(), lane.end(), lanes.values.begin() + 4 * b);
        }
    });
    return lanes;
}

}  // namespace mesh_motion
