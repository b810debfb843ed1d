// Velocities and swept volumes of two steps: velocities ENDPOINT prints those of the second, one number a line, and
// what a third one with the scheme "tangent", faces of its own and a headroom is answered.
//
// Two triangles; the node 2 moves along x, by 0.1 and by 0.3, at 1.25 s and at 1.5 s after a start at 1 s.
#include <mesh_motion.hpp>

#include <cstdio>
#include <vector>

int main(int, char **arguments)
{
    const std::vector<double> points = {0, 0, 1, 0, 1, 1, 0, 1};
    const std::vector<std::int64_t> triangles = {0, 1, 2, 0, 2, 3}, corner = {2}, rest = {0, 1, 3};
    std::vector<double> answer(8);
    try {
        mesh_motion::Server server(arguments[1]);
        mesh_motion::Session session(server);
        session.points(2, points).cells("triangle", triangles).patch("corner", "moving", corner);
        session.patch("rest", "fixed", rest).time_levels(1.0, "bdf2");
        session.open();
        session.build();
        session.velocity_scheme("bdf2");
        session.move(std::vector<double>{0.1, 0.0}, answer, MM_SINCE_REFERENCE);
    } catch (const mesh_motion::Error &error) {
        std::printf("%s\n", error.code().c_str()); // there is no time
    }
    mesh_motion::Server server(arguments[1]);
    mesh_motion::Session session(server);
    session.points(2, points).cells("triangle", triangles).patch("corner", "moving", corner);
    session.patch("rest", "fixed", rest).time_levels(1.0, "bdf2");
    session.open();
    session.build();
    session.report("swept");
    for (int step = 1; step <= 2; ++step) {
        session.time(1.0 + 0.25 * step);
        session.move(std::vector<double>{step == 1 ? 0.1 : 0.3, 0.0}, answer);
        if (session.velocity().size() != 0) {
            return 1;
        }
        session.velocity_scheme("bdf2").move(std::vector<double>{step == 1 ? 0.1 : 0.3, 0.0}, answer);
        session.velocity_scheme("");
        if (step == 2) {
            for (double value : session.velocity()) {
                std::printf("%.17g\n", value);
            }
            for (double value : session.swept()) {
                std::printf("%.17g\n", value);
            }
        }
        session.commit();
    }
    // the corner goes to (1.3, 1.1), at (0, -2) a second: its velocity, the volumes of two edges, and the time until it
    // meets the edge below
    session.time(1.75).velocity_scheme("tangent").boundary_velocity(std::vector<double>{0.0, -2.0});
    session.swept_faces(std::vector<std::int64_t>{1, 2, 2, 0}, 2);
    session.move(std::vector<double>{0.0, 0.1}, answer, MM_SINCE_COMMITTED);
    std::printf("%.17g\n%.17g\n%zu\n", session.velocity()[4], session.velocity()[5], session.swept().size());
    for (double value : session.swept()) {
        std::printf("%.17g\n", value);
    }
    session.report("headroom").headroom_along("velocity");
    session.move(std::vector<double>{0.0, 0.1}, answer, MM_SINCE_COMMITTED);
    std::printf("%.17g\n", session.moved().number("headroom.inversion"));
    session.swept_faces(std::vector<std::int64_t>{}, 2).report("swept");
    session.move(std::vector<double>{0.0, 0.1}, answer, MM_SINCE_COMMITTED);
    std::printf("%zu\n", session.swept().size());
    session.all_swept_faces().move(std::vector<double>{0.0, 0.1}, answer, MM_SINCE_COMMITTED);
    std::printf("%zu\n", session.swept().size());
    session.close(MM_DISCARD);
    return 0;
}
