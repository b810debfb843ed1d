// The driver program of the C++ header for the conformance suite; protocol/conformance/README.md has the contract.
#include <mesh_motion.hpp>

#include <cstdio>
#include <cstring>
#include <iostream>
#include <optional>
#include <sstream>
#include <vector>

using namespace mesh_motion;

namespace
{

const std::vector<double> square = {0, 0, 1, 0, 1, 1, 0, 1};
const std::vector<std::int64_t> triangles = {0, 1, 2, 0, 2, 3}, left_nodes = {0, 3}, right_nodes = {1, 2};

template <class T>
std::string list(View<T> numbers)
{
    std::ostringstream text;
    text.precision(17);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        text << (i ? ", " : "[") << numbers[i];
    }
    return text.str() + "]";
}

class Driver
{
public:
    Driver(std::string endpoint, double seconds) : endpoint_(std::move(endpoint)), seconds_(seconds) {}

    std::string line(const std::string &verb)
    {
        if (verb != "again") {
            last_ = verb;
            moves_ += verb.compare(0, 4, "move") == 0;
        }
        try {
            return "{\"verb\": \"" + verb + "\", \"ok\": true" + call(last_) + "}";
        } catch (const Error &error) {
            return "{\"verb\": \"" + verb + "\", \"ok\": false, \"code\": \"" + error.code() + "\"}";
        }
    }

private:
    std::string call(const std::string &verb)
    {
        if (verb == "hello") {
            server_.emplace(endpoint_, seconds_, seconds_);
            return ", \"version\": " + server_->welcome().json("version");
        }
        if (!server_) {
            throw Error(MM_UNAVAILABLE, "there is no server");
        }
        if (verb == "open") {
            session_.emplace(*server_);
            session_->points(2, square).cells("triangle", triangles);
            session_->patch("left", "moving", left_nodes).patch("right", "fixed", right_nodes);
            session_->open();
            session_->build();
            return ", \"moving_nodes\": " + list(session_->moving_nodes());
        }
        return session_ ? use(*session_, verb) : "";
    }

    std::string use(Session &session, const std::string &verb)
    {
        std::vector<double> answer(8);
        if (verb == "move" || verb == "move-reference") {
            const std::vector<double> rows = {moves_ / 8.0, moves_ / 16.0, moves_ / 8.0, moves_ / 16.0};
            session.move(rows, answer, verb == "move" ? MM_SINCE_COMMITTED : MM_SINCE_REFERENCE);
            return ", \"iteration\": " + std::to_string(session.iteration())
                   + ", \"displacement\": " + list(View<const double>(answer));
        }
        if (verb == "tangent") {
            const std::vector<double> velocity = {0.25, 0.125, 0.25, 0.125};
            session.tangent(velocity, answer);
            return ", \"velocity\": " + list(View<const double>(answer));
        }
        if (verb == "cotangent") {
            const std::vector<double> weights = {0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1};
            answer.resize(4);
            session.cotangent(weights, answer);
            return ", \"weights\": " + list(View<const double>(answer));
        }
        if (verb == "commit") {
            session.commit();
            return ", \"step\": " + std::to_string(session.step())
                   + ", \"digest\": " + session.committed().json("digest");
        }
        if (verb == "rollback") {
            session.rollback();
        } else if (verb == "status") {
            const Report report = session.status();
            return ", \"state\": \"" + report.text("state") + "\", \"step\": " + std::to_string(report.integer("step"));
        } else if (verb == "points") {
            session.fetch(answer);
            return ", \"points\": " + list(View<const double>(answer));
        } else if (verb == "resume") {
            Session again(*server_);
            again.credentials(session.credentials());
            again.resume();
            session_ = std::move(again);
            return ", \"step\": " + std::to_string(session_->step());
        } else {
            session.close(verb == "discard" ? MM_DISCARD : MM_KEEP);
        }
        return "";
    }

    std::string endpoint_, last_;
    double seconds_;
    int moves_ = 0;
    std::optional<Server> server_;
    std::optional<Session> session_;
};

} // namespace

int main(int count, char **arguments)
{
    std::string endpoint, seconds = "10", scenario, verb;
    for (int i = 1; i + 1 < count; i += 2) {
        (std::strcmp(arguments[i], "--endpoint") == 0  ? endpoint
         : std::strcmp(arguments[i], "--timeout") == 0 ? seconds
                                                       : scenario) = arguments[i + 1];
    }
    Driver driver(endpoint, std::stod(seconds));
    for (std::istringstream verbs(scenario); verbs >> verb;) {
        std::cout << driver.line(verb) << std::endl;
    }
    return 0;
}
