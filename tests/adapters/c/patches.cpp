// patches ENDPOINT CREDENTIALS: the time and the moving patches of a resumed session whose mesh this program has not.
#include <mesh_motion.hpp>

#include <cstdio>

int main(int, char **arguments)
{
    mesh_motion::Server server(arguments[1]);
    mesh_motion::Session session(server);
    session.load_credentials(arguments[2]);
    session.resume();
    std::printf("%g\n", session.joined().number("time"));
    for (const char *name : {"wing", "flap", "wall"}) {
        std::printf("%s", name);
        for (const std::int64_t node : session.patch_nodes(name)) {
            std::printf(" %d", static_cast<int>(node));
        }
        std::printf("\n");
    }
}
