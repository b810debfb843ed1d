// Two tangents and two cotangents at once of a moved mesh, one number a line: derivatives ENDPOINT ROLE EVALUATION
#include <mesh_motion.hpp>

#include <cstdio>
#include <vector>

int main(int, char **arguments)
{
    const int cells = 12, side = cells + 1;
    std::vector<double> points, rows, velocities, weights;
    std::vector<std::int64_t> quads, left, walls, right;
    for (int j = 0; j < side; ++j) {
        for (int i = 0; i < side; ++i) {
            const double x = double(i) / cells, y = double(j) / cells;
            points.insert(points.end(), {x, y});
            weights.insert(weights.end(), {x, y, x * y, 1.0});
            if (i == 0 || i == cells) {
                (i == 0 ? left : right).push_back(j * side + i);
            } else if (j == 0 || j == cells) {
                walls.push_back(j * side + i);
            }
            if (i < cells && j < cells) {
                const std::int64_t low = j * side + i;
                quads.insert(quads.end(), {low, low + 1, low + side + 1, low + side});
            }
        }
    }
    mesh_motion::Server server(arguments[1]);
    mesh_motion::Session session(server);
    session.points(2, points).cells("quad", quads).patch("left", "moving", left).patch("walls", arguments[2], walls);
    session.patch("right", "fixed", right);
    session.evaluation(arguments[3]).open();
    session.build();
    for (std::int64_t node : session.moving_nodes()) {
        const double y = points[2 * static_cast<std::size_t>(node) + 1];
        rows.insert(rows.end(), {1.2 * y * (1.0 - y), 0.0});
        velocities.insert(velocities.end(), {y, 1.0, 1.0, y * y});
    }
    std::vector<double> answer(points.size()), tangents(2 * points.size()), cotangents(velocities.size());
    session.move(rows, answer);
    session.tangent(velocities, tangents, 2);
    session.cotangent(weights, cotangents, 2);
    for (const std::vector<double> &values : {tangents, cotangents}) {
        for (double value : values) {
            std::printf("%.17g\n", value);
        }
    }
    session.close(MM_DISCARD);
    return 0;
}
