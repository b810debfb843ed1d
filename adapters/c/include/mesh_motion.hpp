// C++17 over mesh_motion.h: objects that clean up after themselves, exceptions, views of arrays.
//
//     mesh_motion::Server server("tcp://127.0.0.1:7440");
//     mesh_motion::Session session(server);
//     session.points(2, points).cells("quad", quads).patch("block", "moving", block).set("support_radius", 0.5);
//     session.open();
//     session.build();
//     session.move(rows, displacement);          // once per coupling iteration
//     session.commit();                          // once per time step
//     session.close();
//
// Header only; links mesh_motion. A Server and its Sessions are used by one thread at a time. mesh_motion.h describes
// the calls; a failed call throws its error and clears the sticky error of the C library.
#ifndef MESH_MOTION_HPP
#define MESH_MOTION_HPP

#include <mesh_motion.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace mesh_motion
{

/// Pointer and size: of a std::vector, std::array, std::span, or anything else with data() and size().
template <class T>
class View
{
public:
    View(T *data, std::size_t size) : data_(data), size_(size) {}
    template <class Container,
              class = std::enable_if_t<std::is_convertible_v<decltype(std::declval<Container &>().data()), T *>>>
    View(Container &&container) : data_(container.data()), size_(container.size())
    {
    }
    T *data() const { return data_; }
    std::size_t size() const { return size_; }
    T &operator[](std::size_t i) const { return data_[i]; }
    T *begin() const { return data_; }
    T *end() const { return data_ + size_; }

private:
    T *data_;
    std::size_t size_;
};

/// The server's report, by path: report.number("quality.corrected.metric.min").
class Report
{
public:
    explicit Report(const mm_report *report) : report_(report) {}
    double number(const std::string &path) const { return mm_report_number(report_, path.c_str()); }
    std::int64_t integer(const std::string &path, std::int64_t otherwise = 0) const
    {
        return mm_report_integer(report_, path.c_str(), otherwise);
    }
    std::size_t count(const std::string &path) const { return mm_report_count(report_, path.c_str()); }
    std::string text(const std::string &path) const
    {
        return whole(
            [&](char *buffer, std::size_t size) { return mm_report_text(report_, path.c_str(), buffer, size); });
    }
    std::string json(const std::string &path = "") const
    {
        return whole(
            [&](char *buffer, std::size_t size) { return mm_report_json(report_, path.c_str(), buffer, size); });
    }

private:
    template <class Write>
    static std::string whole(Write write)
    {
        std::string text(write(nullptr, 0) + 1, '\0');
        text.resize(write(text.data(), text.size()));
        return text;
    }
    const mm_report *report_;
};

/// Every error. The message says what was expected and what came; the hint says what to do.
class Error : public std::runtime_error
{
public:
    Error(mm_result result, const mm_context *context)
        : std::runtime_error(mm_error_message(context)), result_(result), code_(mm_error_code(context)),
          hint_(mm_error_hint(context)), best_(Report(mm_error_details(context)).number("best")),
          fraction_(Report(mm_error_details(context)).number("fraction")),
          details_(Report(mm_error_details(context)).json())
    {
    }
    Error(mm_result result, const std::string &message) : std::runtime_error(message), result_(result) {}
    mm_result result() const { return result_; }
    const std::string &code() const { return code_; } ///< "FAILED_PRECONDITION.QUALITY"
    const std::string &hint() const { return hint_; }
    const std::string &details() const { return details_; } ///< JSON
    bool is(const std::string &code) const
    {
        return code_ == code || code_.compare(0, code.size() + 1, code + ".") == 0;
    }
    double best() const { return best_; }         ///< for a refused motion: the best minimum quality that was found
    double fraction() const { return fraction_; } ///< and the share of it that is known to be acceptable, or NaN

private:
    mm_result result_;
    std::string code_, hint_;
    double best_ = 0.0, fraction_ = 0.0;
    std::string details_;
};

/// A connection to a server.
class Server
{
public:
    explicit Server(const std::string &endpoint, double seconds = 60.0, double compute_seconds = 1800.0)
        : Server(endpoint, "", "", seconds, compute_seconds)
    {
    }
    /// For a server that needs keys: the client's .secret file, the server's .public file or that key itself.
    Server(const std::string &endpoint, const std::string &secret_file, const std::string &server_key,
           double seconds = 60.0, double compute_seconds = 1800.0)
        : context_(mm_context_new(), mm_context_free)
    {
        if (!context_) {
            throw std::bad_alloc();
        }
        mm_set_timeouts(context_.get(), seconds, compute_seconds);
        if (!secret_file.empty() || !server_key.empty()) {
            mm_set_keys(context_.get(), secret_file.c_str(), server_key.c_str());
        }
        check(mm_connect(context_.get(), endpoint.c_str()));
    }
    void ping() { check(mm_ping(context_.get())); }
    Report welcome() const { return Report(mm_welcome(context_.get())); }
    /// Sessions after an id, as in mm_listed, until the next call.
    Report list(const std::string &after = "")
    {
        check(mm_list(context_.get(), after.c_str()));
        return Report(mm_listed(context_.get()));
    }
    mm_context *get() const { return context_.get(); }

private:
    friend class Session;
    void check(mm_result result) const
    {
        if (result != MM_OK) {
            Error error(result, context_.get());
            mm_clear_error(context_.get());
            throw error;
        }
    }
    std::shared_ptr<mm_context> context_; // shared with the sessions; the last owner frees it
};

/// The credentials that resume a session. Keep the token secret.
struct Credentials {
    std::string id;
    std::array<std::uint8_t, MM_TOKEN_BYTES> token{};
};

/// One partition's part of one mesh on the server.
class Session
{
public:
    explicit Session(Server &server) : server_(server)
    {
        session_.reset(mm_session_new(server.get()));
        if (!session_) {
            check(mm_error(server.get()));
        }
    }

    Session(Session &&) = default;
    /// The old session is freed before its server, because it may be the server's last owner.
    Session &operator=(Session &&other)
    {
        session_ = std::move(other.session_);
        server_ = std::move(other.server_);
        return *this;
    }

    // The library reads the caller's arrays until build() returns, so none may be a temporary. Nodes count from 0.
    template <class Number>
    Session &points(int, const std::vector<Number> &&) = delete;
    template <class Number>
    Session &cells(const std::string &, const std::vector<Number> &&) = delete;
    template <class Number>
    Session &patch(const std::string &, const std::string &, const std::vector<Number> &&) = delete;
    template <class Number>
    Session &global_ids(const std::vector<Number> &&) = delete;
    Session &points(int dimension, View<const double> points)
    {
        require(dimension > 0 && points.size() % static_cast<std::size_t>(dimension) == 0,
                "points: rows of that dimension");
        return check(mm_points(get(), dimension, points.size() / static_cast<std::size_t>(dimension), points.data()));
    }
    Session &cells(const std::string &type, View<const std::int64_t> nodes)
    {
        return check(mm_cells(get(), type.c_str(), rows_of(type, nodes.size()), nodes.data()));
    }
    Session &cells(const std::string &type, View<const std::int32_t> nodes)
    {
        return check(mm_cells32(get(), type.c_str(), rows_of(type, nodes.size()), nodes.data()));
    }
    Session &patch(const std::string &name, const std::string &role, View<const std::int64_t> nodes)
    {
        return check(mm_patch(get(), name.c_str(), role.c_str(), nodes.size(), nodes.data()));
    }
    Session &global_ids(View<const std::int64_t> ids)
    {
        require(ids.size() == nodes(), "global_ids: one for each point");
        return check(mm_global_ids(get(), ids.data()));
    }
    /// A setting of the method: a number, an integer, a flag or a text.
    template <class Value>
    Session &set(const std::string &key, const Value &value)
    {
        if constexpr (std::is_same_v<Value, bool>) {
            return check(mm_set_flag(get(), key.c_str(), value));
        } else if constexpr (std::is_integral_v<Value>) {
            return check(mm_set_integer(get(), key.c_str(), static_cast<std::int64_t>(value)));
        } else if constexpr (std::is_floating_point_v<Value>) {
            return check(mm_set_number(get(), key.c_str(), static_cast<double>(value)));
        } else {
            return check(mm_set_text(get(), key.c_str(), std::string(value).c_str()));
        }
    }
    Session &label(const std::string &text) { return check(mm_set_label(get(), text.c_str())); }
    Session &durability(const std::string &level) { return check(mm_set_durability(get(), level.c_str())); }
    Session &evaluation(const std::string &by) { return check(mm_set_evaluation(get(), by.c_str())); }
    Session &partition(int partition, int partitions) { return check(mm_set_partition(get(), partition, partitions)); }

    void open() { check(mm_open(get())); }
    void join() { check(mm_join(get())); }
    void build() { check(mm_build(get())); }
    void resume() { check(mm_resume(get())); }
    Credentials credentials() const
    {
        Credentials made;
        made.id = mm_id(get());
        std::copy_n(mm_token(get()), made.token.size(), made.token.begin());
        return made;
    }
    Session &credentials(const Credentials &given)
    {
        return check(mm_set_credentials(get(), given.id.c_str(), given.token.data()));
    }
    void save_credentials(const std::string &path) { check(mm_save_credentials(get(), path.c_str())); }
    void load_credentials(const std::string &path) { check(mm_load_credentials(get(), path.c_str())); }

    /// Takes the displacement of the moving nodes, returns that of all nodes: dimension() numbers a node.
    void move(View<const double> displacement, View<double> answer, mm_frame frame = MM_SINCE_REFERENCE)
    {
        require(displacement.size() % columns() == 0 && answer.size() % columns() == 0, "move: rows of the dimension");
        check(mm_move(get(), frame, displacement.size() / columns(), displacement.data(), answer.size() / columns(),
                      answer.data()));
    }
    /// Velocities of the moving nodes in, of all nodes out; a row has dimension() numbers of each of the vectors.
    void tangent(View<const double> velocity, View<double> answer, std::size_t vectors = 1)
    {
        const std::size_t row = columns() * vectors;
        require(row && velocity.size() % row == 0 && answer.size() % row == 0, "tangent: rows of all vectors");
        check(mm_tangent(get(), vectors, velocity.size() / row, velocity.data(), answer.size() / row, answer.data()));
    }
    /// Weights of all nodes in, of the moving nodes out: the derivative of an objective by their positions.
    void cotangent(View<const double> weights, View<double> answer, std::size_t vectors = 1)
    {
        const std::size_t row = columns() * vectors;
        require(row && weights.size() % row == 0 && answer.size() % row == 0, "cotangent: rows of all vectors");
        check(mm_cotangent(get(), vectors, weights.size() / row, weights.data(), answer.size() / row, answer.data()));
    }
    Session &report(const std::string &what) { return check(mm_set_report(get(), what.c_str())); }
    Session &compute_limit(double seconds) { return check(mm_set_compute_limit(get(), seconds)); }
    Session &time_levels(double start, const std::string &scheme)
    {
        return check(mm_set_time_levels(get(), start, scheme.c_str()));
    }
    Session &time(double seconds) { return check(mm_set_time(get(), seconds)); }
    Session &velocity_scheme(const std::string &scheme) { return check(mm_set_velocity(get(), scheme.c_str())); }
    /// With the scheme "tangent": velocities of the moving nodes, for the moves from now on.
    Session &boundary_velocity(View<const double> velocity)
    {
        require(velocity.size() % columns() == 0, "boundary_velocity: rows of the dimension");
        return check(mm_set_boundary_velocity(get(), velocity.size() / columns(), velocity.data()));
    }
    /// The faces that the report "swept" is about: the `corners` nodes of each, filled up with -1.
    Session &swept_faces(View<const std::int64_t> nodes, std::size_t corners)
    {
        static const std::int64_t none = 0; // a view of no faces may have no address, which would mean all of them
        require(corners && nodes.size() % corners == 0, "swept_faces: rows of the corners");
        const std::int64_t *first = nodes.size() ? nodes.data() : &none;
        return check(mm_set_swept_faces(get(), nodes.size() / corners, corners, first));
    }
    /// Of all faces of the cells again.
    Session &all_swept_faces() { return check(mm_set_swept_faces(get(), 0, 1, nullptr)); }
    Session &headroom_along(const std::string &way) { return check(mm_set_headroom_along(get(), way.c_str())); }
    Session &final_step(std::int64_t step) { return check(mm_set_final_step(get(), step)); }
    void commit() { check(mm_commit(get())); }
    void rollback() { check(mm_rollback(get())); }
    void fetch(View<double> points, mm_frame which = MM_SINCE_COMMITTED)
    {
        require(points.size() % columns() == 0, "fetch: rows of the dimension");
        check(mm_fetch(get(), which, points.size() / columns(), points.data()));
    }
    Report status()
    {
        check(mm_status(get()));
        return Report(mm_status_report(get()));
    }
    void close(mm_outcome outcome = MM_KEEP) { check(mm_close(get(), outcome)); }

    int dimension() const { return mm_dimension(get()); }
    std::size_t nodes() const { return mm_node_count(get()); }
    View<const std::int64_t> moving_nodes() const
    {
        std::size_t count = 0;
        const std::int64_t *nodes = mm_moving_nodes(get(), &count);
        return {nodes, count};
    }
    /// Of a moving patch that joined() names, in the order of patch(); empty for another name.
    View<const std::int64_t> patch_nodes(const std::string &name) const
    {
        std::size_t count = 0;
        const std::int64_t *nodes = mm_patch_nodes(get(), name.c_str(), &count);
        return {nodes, count};
    }
    /// Of the last move, dimension() numbers a node; empty if no scheme was set.
    View<const double> velocity() const
    {
        std::size_t count = 0;
        const double *rows = mm_velocity(get(), &count);
        return {rows, count * columns()};
    }
    /// Of the last move, with report("swept"): volumes that the swept faces sweep; those of the cells outwards.
    View<const double> swept() const
    {
        std::size_t count = 0;
        const double *volumes = mm_swept(get(), &count);
        return {volumes, count};
    }
    View<const double> enrichment_points() const
    {
        std::size_t count = 0;
        const double *points = mm_enrichment_points(get(), &count);
        return {points, count * columns()};
    }
    std::int64_t step() const { return mm_step(get()); }
    std::int64_t durable_step() const { return mm_durable_step(get()); }
    std::int64_t iteration() const { return mm_iteration(get()); }
    std::string state() const { return mm_state(get()); }
    View<const std::uint8_t> digest() const { return {mm_digest(get()), 32}; }
    Report joined() const { return Report(mm_joined(get())); }
    Report built() const { return Report(mm_built(get())); }
    Report moved() const { return Report(mm_moved(get())); }
    Report committed() const { return Report(mm_committed(get())); }
    mm_session *get() const { return session_.get(); }

private:
    struct Free {
        void operator()(mm_session *session) const { mm_session_free(session); }
    };
    Session &check(mm_result result)
    {
        server_.check(result);
        return *this;
    }
    static void require(bool fits, const char *message)
    {
        if (!fits) {
            throw Error(MM_INVALID_ARGUMENT, message);
        }
    }
    std::size_t columns() const { return dimension() ? static_cast<std::size_t>(dimension()) : 1; }
    static std::size_t rows_of(const std::string &type, std::size_t size)
    {
        static constexpr std::pair<const char *, std::size_t> types[] = {
            {"line", 2}, {"triangle", 3}, {"quad", 4}, {"tetra", 4}, {"pyramid", 5}, {"wedge", 6}, {"hexahedron", 8}};
        for (const auto &[name, nodes] : types) {
            if (type == name) {
                require(size % nodes == 0, "cells: as many nodes a cell as its type has");
                return size / nodes;
            }
        }
        return 0; // mm_cells says what is wrong
    }
    Server server_; // a copy shares the context, so the context lives longer than the session
    std::unique_ptr<mm_session, Free> session_;
};

} // namespace mesh_motion

#endif
