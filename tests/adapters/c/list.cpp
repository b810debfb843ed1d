// list ENDPOINT: the sessions of a server, a line of JSON each.
#include <mesh_motion.hpp>

#include <cstdio>

int main(int, char **arguments)
{
    mesh_motion::Server server(arguments[1]);
    const auto listed = server.list();
    for (std::size_t i = 0; i < listed.count("sessions"); ++i) {
        std::puts(listed.json("sessions." + std::to_string(i)).c_str());
    }
}
