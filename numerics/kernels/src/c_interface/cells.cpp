// Cells, judged in the same way as in numerics/quality/metrics.py.
#include <memory>

#include "c_interface/held_cells.h"
#include "mesh/closest_point.h"
#include "mesh/facets.h"

using namespace mesh_motion;

namespace {

/// Common arguments of the two calls that find the worst cells. Without cells there is no dimension, and nothing is
/// read.
struct Request {
    Matrix<const double> points;
    Blocks blocks;
    Vector<const double> reference;
    AtRest rest;
    Index metric;
    Vector<Index> numbers;
    Vector<double> values;

    Request(const mesh_motion_cells& cells, Index n, const double* data, const double* reference_sizes,
            const double* skews_at_rest, const double* points_at_rest, const char* name, Index count, Index* lowest,
            double* lowest_values)
        : points(cells.points(n, data)),
          blocks(cells.blocks()),
          reference(array("reference_sizes", reference_sizes, std::array{cells.count})),
          rest{{skews_at_rest, {skews_at_rest ? cells.count : 0}},
               points_at_rest ? cells.points(n, points_at_rest) : Matrix<const double>{}},
          metric(&named("metric", name, metrics) - metrics),
          numbers(array("numbers", lowest, std::array{count})),
          values(array("values", lowest_values, std::array{count})) {
        std::fill(numbers.begin(), numbers.end(), -1);
        std::fill(values.begin(), values.end(), std::numeric_limits<double>::infinity());
    }
};

/// Calls visit(nodes of its cell, local nodes of the facet) for each facet of the boundary, in the order of the cells.
template <class Visit>
void for_boundary(const mesh_motion_cells& held, Visit&& visit) {
    std::vector<Node> all;
    std::vector<Index> blocks, local;
    for (const auto& [type, rows] : held.held) {
        all.insert(all.end(), rows.begin(), rows.end());
        blocks.insert(blocks.end(), {static_cast<Index>(rows.size()) / type->nodes, type->nodes});
        for (const auto& facet : type->facets) local.insert(local.end(), facet.begin(), facet.end());
    }
    const auto types = static_cast<Index>(held.held.size());
    const auto [single, pairs, crowded] = match_facets(
        view_of(std::as_const(all)), {blocks.data(), {types, 2}}, {local.data(), {types, 6, 4}}, false);
    expect(crowded < 0, "cells", "facets that are shared by two cells at most, on different sides");
    for (Index facet : single.values) {
        const auto [type, number, nodes] = held.at(facet / facets_per_cell);
        visit(nodes, type->facets[facet % facets_per_cell]);
    }
}

struct HeldFacets : mesh_motion_facets {
    std::vector<Index> rows;
};

mesh_motion_distribution distribution_in(Vector<const double> row) { return {row[0], row[1], row[2], row[3], row[4]}; }

}  // namespace

int mesh_motion_cells_create(mesh_motion_cells** cells) {
    return answered([&] {
        given(cells, "cells") = nullptr;
        *cells = new mesh_motion_cells;
    });
}

int mesh_motion_cells_add(mesh_motion_cells* cells, const char* type, int64_t count, const int64_t* nodes) {
    return answered([&] {
        auto& held = given(cells, "cells");
        const Kind& kind = named("type", type, cell_types);
        const auto rows = array("nodes", nodes, std::array{count, kind.nodes});
        expect(held.held.empty() || kind.dimension == held.dimension, "type", "cells of one dimension");
        Index most = held.nodes;
        for (Index node : rows) {
            expect(0 <= node && node < std::numeric_limits<Node>::max(), "nodes", "numbers from 0 to 2³¹ − 2");
            most = std::max(most, node + 1);
        }
        held.held.emplace_back(&kind, std::vector<Node>(rows.begin(), rows.end()));
        held.dimension = kind.dimension, held.count += count, held.nodes = most;
    });
}

void mesh_motion_cells_free(mesh_motion_cells* cells) { delete cells; }

int mesh_motion_boundary_nodes(const mesh_motion_cells* cells, int64_t n, bool* boundary) {
    return answered([&] {
        const auto& held = given(cells, "cells");
        const auto marks = array("boundary", boundary, std::array{std::max(n, held.nodes)});
        std::fill(marks.begin(), marks.end(), false);
        for_boundary(held, [&](const Node* nodes, const auto& facet) {
            for (Index corner : facet)
                if (corner >= 0) marks[nodes[corner]] = true;
        });
    });
}

int mesh_motion_facets_create(const mesh_motion_cells* cells, const mesh_motion_facets** facets) {
    return answered([&] {
        given(facets, "facets") = nullptr;
        auto made = std::make_unique<HeldFacets>();
        for_boundary(given(cells, "cells"), [&](const Node* nodes, const auto& facet) {
            for (Index corner : facet) made->rows.push_back(corner < 0 ? -1 : Index{nodes[corner]});
        });
        made->count = static_cast<Index>(made->rows.size()) / 4;
        made->nodes = made->rows.data();
        *facets = made.release();
    });
}

void mesh_motion_facets_free(const mesh_motion_facets* facets) { delete static_cast<const HeldFacets*>(facets); }

int mesh_motion_near_facets(int64_t d, int64_t n, const double* points, int64_t count, const double* facets,
                            double distance, bool* near) {
    return answered([&] {
        expect(d == 2 || d == 3, "d", "2 or 3");
        const auto spatial = [d](auto rows) {
            std::vector<double> padded(rows.size() / d * 3);
            for (Index i = 0; i < rows.size(); ++i) padded[i / d * 3 + i % d] = rows.data()[i];
            return padded;
        };
        const auto at = spatial(array("points", points, std::array{n, d}));
        const auto corners = spatial(array("facets", facets, std::array{count, d, d}));
        points_near_facets({at.data(), {n, 3}}, {corners.data(), {count, d, 3}}, distance,
                           array("near", near, std::array{n}));
    });
}

int mesh_motion_cell_sizes(const mesh_motion_cells* cells, int64_t n, const double* points, double* sizes) {
    return answered([&] {
        const auto& held = given(cells, "cells");
        const auto at = held.points(n, points);
        const auto out = array("sizes", sizes, std::array{held.count});
        held.by_block([&](auto nodes, Index first) { cell_sizes(at, nodes, out.rows(first, first + nodes.shape(0))); });
    });
}

int mesh_motion_cell_quality(const mesh_motion_cells* cells, int64_t n, const double* points,
                             const double* reference_sizes, double* size, double* skew, bool* inverted) {
    return answered([&] {
        const auto& held = given(cells, "cells");
        const auto at = held.points(n, points);
        const std::array all{held.count};
        const auto reference = array("reference_sizes", reference_sizes, all);
        const auto sizes = array("size", size, all), skews = array("skew", skew, all);
        const auto marks = array("inverted", inverted, all);
        held.by_block([&](auto nodes, Index first) {
            const Index last = first + nodes.shape(0);
            cell_quality(at, nodes, reference.rows(first, last), sizes.rows(first, last), skews.rows(first, last),
                         marks.rows(first, last));
        });
    });
}

int mesh_motion_lowest_cells(const mesh_motion_cells* cells, int64_t n, const double* points,
                             const double* reference_sizes, const double* skews_at_rest,
                             const double* points_at_rest, const char* metric, int64_t count, int64_t* numbers,
                             double* values, int64_t* inverted) {
    return answered([&] {
        const Request asked(given(cells, "cells"), n, points, reference_sizes, skews_at_rest, points_at_rest,
                            metric, count, numbers, values);
        const auto [lowest, found, turned, none] =
            lowest_cells(asked.points, asked.blocks, asked.reference, asked.rest, asked.metric, count, 0.0);
        std::copy(found.values.begin(), found.values.end(), asked.numbers.begin());
        std::copy(lowest.values.begin(), lowest.values.end(), asked.values.begin());
        given(inverted, "inverted") = turned;
    });
}

int mesh_motion_judge_cells(const mesh_motion_cells* cells, int64_t n, const double* points,
                            const double* reference_sizes, const double* skews_at_rest,
                            const double* points_at_rest, const char* metric, int64_t count, int64_t* numbers,
                            double* values, mesh_motion_quality* quality) {
    return answered([&] {
        const Request asked(given(cells, "cells"), n, points, reference_sizes, skews_at_rest, points_at_rest,
                            metric, count, numbers, values);
        const auto [rows, found, turned, none] =
            judged_cells(asked.points, asked.blocks, asked.reference, asked.rest, asked.metric, count, 0.0);
        const auto row = [&](Index k) { return distribution_in(rows.view()[k]); };
        given(quality, "quality") = {row(0), row(1), row(2), row(std::min<Index>(asked.metric, 3)), turned};
        std::copy(found.values.begin(), found.values.end(), asked.numbers.begin());
        const Cells judged(asked.points, asked.blocks, asked.reference, asked.rest);
        for (std::size_t s = 0; s < found.values.size(); ++s) {
            const Index cell = found.values[s];
            double size, skew, relative;
            bool inverted;
            judged.judge(cell, cell + 1, {&size, &skew, &inverted, judged.has_rest() ? &relative : nullptr});
            metric_of(static_cast<Metric>(asked.metric), 1, &size, &skew, &relative,
                      &asked.values[static_cast<Index>(s)]);
        }
    });
}
