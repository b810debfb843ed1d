// A block turns and moves inside a square: a coupling code in C++, from the mesh to the committed steps.
//
//     block_cpp tcp://127.0.0.1:7440 [POINTS]
//
// The mesh is made here, of quadrilaterals around a hole, as a flow solver has it. Each time step has three coupling
// iterations, of which the last one is committed. Prints the quality of each step; POINTS receives the final
// coordinates (float64, x and y of each node).
#include <mesh_motion.hpp>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <vector>

namespace
{

constexpr int cells = 16, low = 6, high = 10, steps = 4, iterations = 3;

struct Mesh {
    std::vector<double> points;
    std::vector<std::int64_t> quads, block, walls;
};

/// The unit square in cells x cells cells, without those of the block; nodes count from 0.
Mesh make_mesh()
{
    Mesh mesh;
    std::vector<std::int64_t> number((cells + 1) * (cells + 1), -1);
    const auto at = [](int i, int j) { return static_cast<std::size_t>(j * (cells + 1) + i); };
    std::int64_t count = 0;
    for (int j = 0; j <= cells; ++j) {
        for (int i = 0; i <= cells; ++i) {
            if (i > low && i < high && j > low && j < high) {
                continue;
            }
            number[at(i, j)] = count;
            mesh.points.push_back(static_cast<double>(i) / cells);
            mesh.points.push_back(static_cast<double>(j) / cells);
            if (i >= low && i <= high && j >= low && j <= high) {
                mesh.block.push_back(count);
            }
            if (i == 0 || i == cells || j == 0 || j == cells) {
                mesh.walls.push_back(count);
            }
            ++count;
        }
    }
    for (int j = 0; j < cells; ++j) {
        for (int i = 0; i < cells; ++i) {
            if (i < low || i >= high || j < low || j >= high) {
                for (auto corner : {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)}) {
                    mesh.quads.push_back(number[corner]);
                }
            }
        }
    }
    return mesh;
}

/// The boundary's displacement, which a structural solver would compute: a share of a turn (cosine 0.96) and of a translation.
void displace(double share, const Mesh &mesh, mesh_motion::View<const std::int64_t> moving, std::vector<double> &rows)
{
    rows.clear();
    for (auto node : moving) {
        const auto first = static_cast<std::size_t>(2 * node);
        const double x = mesh.points[first] - 0.5, y = mesh.points[first + 1] - 0.5;
        rows.push_back(share * (-0.04 * x - 0.28 * y + 0.1));
        rows.push_back(share * (0.28 * x - 0.04 * y + 0.05));
    }
}

void run(const char *endpoint, const char *file)
{
    const Mesh mesh = make_mesh();
    mesh_motion::Server server(endpoint);
    mesh_motion::Session session(server);
    session.points(2, mesh.points).cells("quad", mesh.quads);
    session.patch("block", "moving", mesh.block).patch("walls", "fixed", mesh.walls).set("support_radius", 0.5);
    session.open();
    session.build();
    session.final_step(steps);  // who watches the session then sees when it ends
    std::vector<double> rows, displacement(mesh.points.size());
    double lowest = 1.0;
    for (int step = 1; step <= steps; ++step) {
        for (int iteration = 1; iteration <= iterations; ++iteration) {
            const double share = (step - 1 + static_cast<double>(iteration) / iterations) / steps;
            displace(share, mesh, session.moving_nodes(), rows);
            session.move(rows, displacement, MM_SINCE_REFERENCE);
            // here the flow solver uses points + displacement, and gives loads to the structure
        }
        session.commit();
        const double quality = session.committed().number("quality.metric.min");
        lowest = std::min(lowest, quality);
        std::printf("step %d: quality at least %.6f\n", step, quality);
    }
    session.fetch(displacement);
    session.close(MM_DISCARD);
    std::printf("minimum quality %.6f\n", lowest);
    if (file) {
        std::ofstream(file, std::ios::binary)
            .write(reinterpret_cast<const char *>(displacement.data()),
                   static_cast<std::streamsize>(displacement.size() * sizeof(double)));
    }
}

} // namespace

int main(int count, char **arguments)
{
    try {
        run(count > 1 ? arguments[1] : "tcp://127.0.0.1:7440", count > 2 ? arguments[2] : nullptr);
    } catch (const mesh_motion::Error &error) {
        std::fprintf(stderr, "%s: %s\n%s\n", error.code().c_str(), error.what(), error.hint().c_str());
        return 1;
    }
    return 0;
}
