// The cells of an MPI rank, judged in the same way as in distributed/counted_cells.py.
#include <algorithm>
#include <memory>
#include <numeric>
#include <optional>

#include "c_interface/held_cells.h"
#include "parallel.h"
#include "quality/order_statistics.h"

using namespace mesh_motion;

namespace {

constexpr Index bins = MESH_MOTION_BINS, few = 512, deepest = 6;
constexpr double flat = 1e-10;  // the same as in mesh_check.py

/// One division of a way to a bin: from `low` on, with `scale` bins per unit.
struct Division {
    double low, scale;
    Index wanted;

    Division next() const { return {low + static_cast<double>(wanted) / scale, scale * static_cast<double>(bins), 0}; }
};

}  // namespace

struct mesh_motion_tally {
    const mesh_motion_cells* cells;
    Index metric, kinds;
    std::vector<double> sizes, skews, points_at_rest;  // the last two only for the relative metric
    std::vector<std::uint32_t> places;
    // of the cells when they were judged last
    Matrix<const double> points;
    Owned<double, 2> extents;
    Owned<Index, 2> counts;

    AtRest rest() const {
        const Index n = static_cast<Index>(points_at_rest.size()) / cells->dimension;
        return {view_of(skews), {points_at_rest.data(), {n, cells->dimension}}};
    }
    Vector<const std::uint32_t> places_of(Index kind) const {
        return {places.data() + kind * cells->count, {cells->count}};
    }

    std::vector<double> values(Index kind, const std::vector<std::uint32_t>& wanted) const {
        return values_at(points, cells->blocks(), view_of(sizes), rest(), kind < 3 ? kind : metric, places_of(kind),
                         view_of(wanted))
            .values;
    }

    /// The places, in a bin of the first division, that have values.
    std::vector<std::uint32_t> places_in(Index bin, Vector<const Index> parts) const {
        std::vector<std::uint32_t> found;
        for (Index part = 0; part < bins; ++part)
            if (parts[part]) found.push_back(static_cast<std::uint32_t>(bin * bins + part));
        return found;
    }

    /// Counts the values in the bin at the end of a way; returns the values if the server needs them.
    std::optional<std::vector<double>> content(Index kind, const std::vector<Division>& way,
                                               Vector<Index> found) const {
        if (way.empty()) {
            const auto whole = counts.view()[kind];
            std::copy(whole.begin(), whole.end(), found.begin());
            const auto [total, least, most] = std::array{extents.view()(kind, 0), extents.view()(kind, 1),
                                                         extents.view()(kind, 2)};
            if (least == most) return std::vector<double>(cells->count, least);
            if (cells->count > few) return {};
            const auto all = places_of(kind);
            return values(kind, {all.begin(), all.end()});
        }
        const Index bin = way[0].wanted;
        std::vector<double> inside;
        if (way.size() == 1) {
            const std::uint32_t asked = static_cast<std::uint32_t>(bin);
            const auto parts = counts_in_parts(places_of(kind), Vector<const std::uint32_t>(&asked, {1}), bins).values;
            std::copy(parts.begin(), parts.end(), found.begin());
            const auto some = places_in(bin, view_of(parts));
            const Index total = std::accumulate(parts.begin(), parts.end(), Index{0});
            if (total > few && some.size() != 1) return {};
            inside = values(kind, some);
        } else {
            inside = values(kind, {static_cast<std::uint32_t>(bin * bins + way[1].wanted)});
            for (std::size_t d = 2; d < way.size(); ++d)
                inside = values_in_bin(view_of(std::as_const(inside)), way[d].low, way[d].scale, bins, way[d].wanted)
                             .values;
            const Division next = way.back().next();
            std::fill(found.begin(), found.end(), 0);
            count_in_bins(view_of(std::as_const(inside)), next.low, next.scale, found);
        }
        const bool alike = !inside.empty() && *std::min_element(inside.begin(), inside.end()) ==
                                                  *std::max_element(inside.begin(), inside.end());
        const bool is_answered = static_cast<Index>(inside.size()) <= few || alike || way.size() >= deepest;
        return is_answered ? std::optional(std::move(inside)) : std::nullopt;
    }
};

int mesh_motion_tally_create(const mesh_motion_cells* cells, int64_t n, const double* points, const char* metric,
                             mesh_motion_tally** tally) {
    return answered([&] {
        given(tally, "tally") = nullptr;
        const auto& held = given(cells, "cells");
        expect(held.count > 0, "cells", "at least one");
        auto made = std::make_unique<mesh_motion_tally>();
        made->cells = &held;
        made->metric = &named("metric", metric, metrics) - metrics;
        made->kinds = made->metric > 2 ? 4 : 3;
        made->sizes.resize(held.count);
        made->skews.resize(held.count);
        const auto at = held.points(n, points);
        std::vector<double> size(held.count);
        const std::unique_ptr<bool[]> inverted(new bool[held.count]);
        const auto sizes = view_of(made->sizes), skews = view_of(made->skews);
        held.by_block([&](auto nodes, Index first) {
            const Index last = first + nodes.shape(0);
            cell_sizes(at, nodes, sizes.rows(first, last));
            cell_quality(at, nodes, sizes.rows(first, last), view_of(size).rows(first, last), skews.rows(first, last),
                         {inverted.get() + first, {last - first}});
        });
        for (Index cell = 0; cell < held.count; ++cell) {
            if (!inverted[cell] && skews[cell] > flat) continue;
            const auto [type, number, nodes] = held.at(cell);
            throw std::invalid_argument("cells: expected the node order of VTK and no flat cell, got " +
                                        std::string(type->name) + " " + std::to_string(number) + ", which is " +
                                        (inverted[cell] ? "inverted" : "flat"));
        }
        if (static_cast<Metric>(made->metric) == Metric::relative_size_skew)
            made->points_at_rest.assign(at.begin(), at.end());
        else
            made->skews = {};
        made->places.resize(made->kinds * held.count);
        *tally = made.release();
    });
}

void mesh_motion_tally_free(mesh_motion_tally* tally) { delete tally; }

int mesh_motion_tally_judge(mesh_motion_tally* tally, int64_t n, const double* points, mesh_motion_part* part) {
    return answered([&] {
        auto& own = given(tally, "tally");
        const auto& cells = *own.cells;
        auto& into = given(part, "part");
        own.points = cells.points(n, points);
        const Blocks blocks = cells.blocks();
        auto [extents, counts, worst, inverted] =
            counted_cells(own.points, blocks, view_of(own.sizes), own.rest(), own.metric, MESH_MOTION_WORST, bins,
                          {own.places.data(), {own.kinds, cells.count}});
        into = {};
        into.cells = cells.count, into.inverted = inverted, into.metrics = own.kinds;
        for (Index k = 0; k < own.kinds; ++k) {
            into.names[k] = metrics[k < 3 ? k : own.metric].name;
            into.sums[k] = extents.view()(k, 0), into.minima[k] = extents.view()(k, 1);
        }
        into.worst_cells = static_cast<Index>(worst.values.size());
        const Cells judged(own.points, blocks, view_of(own.sizes), own.rest());
        for (Index s = 0; s < into.worst_cells; ++s) {
            const Index cell = worst.values[s];
            const auto [type, number, nodes] = cells.at(cell);
            double size, skew, relative, *row = into.worst[s];
            bool is_inverted;
            judged.judge(cell, cell + 1, {&size, &skew, &is_inverted, judged.has_rest() ? &relative : nullptr});
            row[0] = static_cast<double>(type - cell_types), row[1] = static_cast<double>(number);
            metric_of(static_cast<Metric>(own.metric), 1, &size, &skew, &relative, &row[2]);
            row[3] = size, row[4] = skew;
            metric_of(Metric::size_skew, 1, &size, &skew, nullptr, &row[5]);
            for (Index axis = 0; axis < cells.dimension; ++axis) {
                for (Index node = 0; node < type->nodes; ++node) row[6 + axis] += own.points(nodes[node], axis);
                row[6 + axis] /= static_cast<double>(type->nodes);
            }
        }
        own.extents = std::move(extents), own.counts = std::move(counts);
    });
}

int mesh_motion_tally_bin(const mesh_motion_tally* tally, const char* metric, int64_t divisions, const double* way,
                          int64_t* counts, int64_t most, double* values, int64_t* repeated, int64_t* different) {
    return answered([&] {
        const auto& own = given(tally, "tally");
        expect(own.points.data(), "tally", "cells that were judged");
        const Index code = &named("metric", metric, metrics) - metrics;
        expect(code < 3 || code == own.metric, "metric", "one of those that were judged");
        const auto rows = array("way", way, std::array{divisions, Index{3}});
        std::vector<Division> read;
        for (Index d = 0; d < divisions; ++d) {
            expect(rows(d, 2) >= 0.0 && rows(d, 2) < static_cast<double>(bins), "way", "bins from 0 to 2047");
            read.push_back({rows(d, 0), rows(d, 1), static_cast<Index>(rows(d, 2))});
        }
        auto found = own.content(std::min<Index>(code, 3), read, array("counts", counts, std::array{bins}));
        given(different, "different") = -1;
        if (!found) return;
        std::sort(found->begin(), found->end());
        const auto to = array("values", values, std::array{most});
        const auto times = array("repeated", repeated, std::array{most});
        Index number = 0;
        for (auto at = found->begin(); at != found->end(); ++number) {
            const auto end = std::upper_bound(at, found->end(), *at);
            if (number < most) to[number] = *at, times[number] = end - at;
            at = end;
        }
        *different = number;
    });
}

// The bad cells and their neighbours, chosen in the same way as in distributed/region.py.

namespace {

struct HeldRegion : mesh_motion_region {
    std::vector<std::int64_t> node, whole_of, corner;
};

/// Size, skew, relative shape and validity of all cells.
struct Qualities {
    std::vector<double> size, skew, relative;
    std::unique_ptr<bool[]> inverted;

    Qualities(const mesh_motion_tally& tally, Matrix<const double> points)
        : size(tally.cells->count), skew(tally.cells->count), relative(tally.skews.size()),
          inverted(new bool[tally.cells->count]) {
        const Cells cells(points, tally.cells->blocks(), view_of(tally.sizes), tally.rest());
        for_ranges(cells.size(), judged_at_once, [&](Index first, Index last) {
            double* const shapes = relative.empty() ? nullptr : &relative[first];
            cells.judge(first, last, {&size[first], &skew[first], &inverted[first], shapes});
        });
    }

    /// The values of the metric with this name.
    std::vector<double> values(const mesh_motion_tally& tally, Matrix<const double> points, std::string_view metric) const {
        std::vector<double> found(size.size());
        if (metric == "corner-shape-size") {
            const auto rest = tally.rest();
            expect(rest.skews.size() == tally.cells->count, "metric", "a tally that is relative to rest");
            tally.cells->by_block([&](auto nodes, Index first) {
                const Index last = first + nodes.shape(0);
                corner_quality(points, rest.points, nodes, view_of(found).rows(first, last));
            });
        } else {
            expect(metric == metrics[tally.metric].name, "metric", "that of the tally");
            metric_of(static_cast<Metric>(tally.metric), static_cast<Index>(size.size()), size.data(), skew.data(),
                      relative.empty() ? nullptr : relative.data(), found.data());
        }
        return found;
    }
};

/// Calls f(cell, nodes, number of nodes) for all cells.
template <class F>
void by_cell(const mesh_motion_cells& cells, F&& f) {
    Index cell = 0;
    for (const auto& [type, rows] : cells.held)
        for (std::size_t at = 0; at < rows.size(); at += type->nodes) f(cell++, rows.data() + at, type->nodes);
}

/// Marks the nodes of the cells for which `wanted` returns true.
template <class F>
void mark_nodes(const mesh_motion_cells& cells, std::vector<char>& marks, F&& wanted) {
    by_cell(cells, [&](Index cell, const Node* nodes, Index count) {
        if (wanted(cell, nodes, count))
            for (Index k = 0; k < count; ++k) marks[nodes[k]] = true;
    });
}

/// Whether a cell has a marked node.
auto touches(const std::vector<char>& marked) {
    return [&marked](Index, const Node* nodes, Index count) {
        return std::any_of(nodes, nodes + count, [&](Index node) { return marked[node]; });
    };
}

/// Returns the chosen cells, without values of the other cells. Of the n nodes those are marked whose cells are all
/// chosen.
std::unique_ptr<HeldRegion> held_region(const mesh_motion_cells& cells, Index n, const std::vector<char>& chosen,
                                        const std::vector<char>& marks) {
    auto made = std::make_unique<HeldRegion>();
    std::vector<char> here(n);
    std::vector<Index> row(n);
    mark_nodes(cells, here, [&](Index cell, const Node*, Index) { return chosen[cell]; });
    for (Index node = 0; node < n; ++node) {
        if (!here[node]) continue;
        row[node] = static_cast<Index>(made->node.size());
        made->node.push_back(node);
        made->whole_of.push_back(marks[node]);
    }
    made->least_skew = made->least_size = 1.0;
    Index type = 0;
    for (const auto& kind : cell_types) {
        made->cells[type] = 0;
        Index cell = 0;
        for (const auto& [held, rows] : cells.held) {
            for (std::size_t at = 0; at < rows.size(); at += held->nodes, ++cell) {
                if (held != &kind || !chosen[cell]) continue;
                ++made->cells[type];
                for (Index k = 0; k < kind.nodes; ++k) made->corner.push_back(row[rows[at + k]]);
            }
        }
        made->names[type++] = kind.name;
    }
    made->nodes = static_cast<Index>(made->node.size());
    made->corners = static_cast<Index>(made->corner.size());
    made->indices = made->node.data(), made->whole = made->whole_of.data(), made->rows = made->corner.data();
    return made;
}

}  // namespace

int mesh_motion_region_create(const mesh_motion_tally* tally, int64_t n, const double* points, const char* metric,
                              double below, int64_t rings, int64_t around, const int64_t* nodes,
                              const mesh_motion_region** region) {
    return answered([&] {
        given(region, "region") = nullptr;
        const auto& own = given(tally, "tally");
        const auto& cells = *own.cells;
        const Qualities found(own, cells.points(n, points));
        std::vector<char> bad(cells.count), chosen(cells.count), marks(n);
        const auto values = found.values(own, cells.points(n, points), &given(metric, "metric"));
        for (Index cell = 0; cell < cells.count; ++cell) bad[cell] = found.inverted[cell] || values[cell] < below;
        mark_nodes(cells, marks, [&](Index cell, const Node*, Index) { return bad[cell]; });
        for (const Index node : array("nodes", nodes, std::array{around})) {
            expect(node >= 0 && node < n, "nodes", "numbers of nodes");
            marks[node] = true;
        }
        for (Index ring = 0; ring < rings; ++ring) {
            const std::vector<char> before = marks;
            mark_nodes(cells, marks, touches(before));
        }
        by_cell(cells, [&](Index cell, const Node* nodes, Index count) {
            chosen[cell] = bad[cell] || touches(marks)(cell, nodes, count);
        });
        auto made = held_region(cells, n, chosen, marks);
        for (Index cell = 0; cell < cells.count; ++cell) {
            if (chosen[cell]) continue;
            made->least_size = std::min(made->least_size, found.size[cell]);
            if (own.skews.empty()) continue;
            made->least_skew = std::min(made->least_skew, found.inverted[cell] ? 0.0 : found.relative[cell]);
        }
        *region = made.release();
    });
}

int mesh_motion_cells_about_create(const mesh_motion_cells* cells, int64_t n, const bool* marked, bool* taken,
                                   const mesh_motion_region** region) {
    return answered([&] {
        given(region, "region") = nullptr;
        const auto& held = given(cells, "cells");
        expect(n >= held.nodes, "n", "the nodes of the cells");
        const auto wanted = array("marked", marked, std::array{n});
        const auto before = array("taken", taken, std::array{held.count});
        std::vector<char> marks(wanted.begin(), wanted.end()), chosen(held.count);
        by_cell(held, [&](Index cell, const Node* nodes, Index count) {
            chosen[cell] = !before[cell] && touches(marks)(cell, nodes, count);
        });
        auto made = held_region(held, n, chosen, marks);
        for (Index cell = 0; cell < held.count; ++cell) before[cell] |= chosen[cell] != 0;
        *region = made.release();
    });
}

void mesh_motion_region_free(const mesh_motion_region* region) { delete static_cast<const HeldRegion*>(region); }
