// Interpolants and nested splines, evaluated in the same way as in numerics/interpolation/evaluation.py.
#include <memory>
#include <mutex>
#include <optional>

#include "c_interface/call.h"
#include "interpolation/cell_lists.h"
#include "interpolation/assembly.h"
#include "interpolation/sparse.h"
#include "interpolation/summation.h"
#include "mesh/hashed_cells.h"
#include "two_scale/spline.h"

namespace mesh_motion {
namespace {

/// Properties of the basis functions, as in numerics/interpolation/kernels.py, in the order of `Bases`.
constexpr struct Row {
    const char* name;
    bool compact, gradient_at_centre;
} bases[] = {{"wendland-c2", true, true}, {"wendland-c2-multiscale", true, true}, {"wendland-c0", true, false},
             {"wendland-c4", true, true}, {"wendland-c6", true, true}, {"ctps-c0", true, false},
             {"ctps-c1", true, true}, {"ctps-c2a", true, true}, {"ctps-c2b", true, true},
             {"tps", false, true}, {"mqb", false, true}, {"imqb", false, true},
             {"qb", false, true}, {"iqb", false, true}, {"gauss", false, true}};
static_assert(std::size(bases) == std::tuple_size_v<Bases>);

/// Points (n, d) with three coordinates, of which missing ones are zero; all rows, or the rows with given numbers.
class Padded {
  public:
    explicit Padded(Matrix<const double> points) : Padded(points, points.shape(0), [](Index i) { return i; }) {
        if (points.shape(1) == 3) view_ = points;
    }
    Padded(Matrix<const double> points, Vector<const Index> rows)
        : Padded(points, rows.size(), [rows](Index i) { return rows[i]; }) {}

    Matrix<const double> view() const { return view_; }

  private:
    template <class Row>
    Padded(Matrix<const double> points, Index n, Row row) : values_(3 * n), view_(values_.data(), {n, 3}) {
        for (Index i = 0; i < n; ++i)
            for (Index axis = 0; axis < points.shape(1); ++axis) values_[3 * i + axis] = points(row(i), axis);
    }

    std::vector<double> values_;
    Matrix<const double> view_;
};

struct Polynomial {
    std::vector<double> centre, coefficients;
    double scale;
};

/// Finds the points within reach of a compact interpolant, and the centres within reach of these points.
struct Reach {
    std::unique_ptr<bool[]> cells;     // of mark_neighbours
    Index count;
    std::optional<StoredCells> small;  // only if the layout's own cells are far wider than the support radius
};

/// As in assembly.py: the layout's own grid finds centres, unless its cells and all centres are this many radii wide.
constexpr double wider = 1.5, slack = 1.0 + 1e-6;

/// Number of rows whose entries are in memory at a time; the entries of all rows may not fit.
constexpr Index rows_at_once = 1 << 13;

}  // namespace
}  // namespace mesh_motion

using namespace mesh_motion;

struct mesh_motion_interpolant {
    const Row* basis;
    double radius;
    Index dimension, components;
    CentreLayout layout;
    std::vector<double> weights, sorted;  // (nc, k), (k, nc)
    std::optional<Polynomial> polynomial;
    mutable std::once_flag reach_asked;
    mutable Reach reach;

    int code() const { return static_cast<int>(basis - bases); }
    Index centres() const { return layout.order.shape[0]; }

    /// The kernels sum_values or sum_gradients.
    template <class Sum, class Out>
    void sum(Sum&& loop, Matrix<const double> padded, Out out) const {
        loop(code(), padded, layout.coordinates.view(), {sorted.data(), {components, centres()}}, 1.0 / radius,
             layout.origin.view(), layout.inverse_side, layout.shape.view(), layout.starts.view(), out);
    }

    void values(Matrix<const double> points, Matrix<double> out) const {
        sum(sum_values, Padded(points).view(), out);
        if (!polynomial) return;
        const auto& [centre, b, scale] = *polynomial;
        for (Index i = 0; i < points.shape(0); ++i)
            for (Index c = 0; c < components; ++c) {
                double value = b[c];
                for (Index m = 0; m < dimension; ++m)
                    value += (points(i, m) - centre[m]) / scale * b[(m + 1) * components + c];
                out(i, c) += value;
            }
    }

    void gradients(Matrix<const double> points, Cube<double> out) const {
        sum(sum_gradients, Padded(points).view(), out);
        if (!polynomial) return;
        for (Index i = 0; i < points.shape(0); ++i)
            for (Index c = 0; c < components; ++c)
                for (Index m = 0; m < dimension; ++m)
                    out(i, c, m) += polynomial->coefficients[(m + 1) * components + c] / polynomial->scale;
    }

    /// Whether the interpolant can be a compact level of an interpolation in two scales.
    bool is_level() const { return basis->compact && !polynomial; }

    /// Calls f(rows, matrix) for parts of the rows of points within reach; the matrix has the basis functions there, as
    /// in NearOperator.
    template <class F>
    void for_near(Matrix<const double> points, const std::vector<Index>& rows, F&& f) const {
        const Padded padded(points, view_of(rows));
        const std::optional<StoredCells>& small = reach.small;
        Owned<Index, 1> numbers = layout.order;
        if (small)
            for (Index j = 0; j < centres(); ++j) numbers.values[j] = layout.order.values[small->order.values[j]];
        const Owned<Index, 1> none;
        const Owned<std::int32_t, 2> no_runs{{}, {0, 2}};
        const auto n = static_cast<Index>(rows.size());
        for (Index first = 0; first < n; first += rows_at_once) {
            const Index last = std::min(n, first + rows_at_once);
            f(view_of(rows).rows(first, last),
              near_rows(code(), padded.view().rows(first, last),
                        (small ? small->coordinates : layout.coordinates).view(), numbers.view(), radius,
                        (small ? small->origin : layout.origin).view(),
                        small ? small->inverse_side : layout.inverse_side, (small ? none : layout.shape).view(),
                        (small ? none : layout.starts).view(), (small ? small->keys : none).view(),
                        (small ? small->spans : no_runs).view(), (small ? small->runs : no_runs).view()));
        }
    }

    /// out += values, in the way in which NearOperator adds a level.
    void add_values(Matrix<const double> points, Matrix<double> out) const {
        for_near(points, within_reach(points), [&](Vector<const Index> rows, const SparseMatrix& matrix) {
            const auto& [pointers, columns, entries] = matrix;
            add_product(rows, pointers.view(), columns.view(), entries.view(),
                        {weights.data(), {centres(), components}}, out);
        });
    }

    /// out += gradients at the points within reach.
    void add_gradients(Matrix<const double> points, Cube<double> out) const {
        const std::vector<Index> rows = within_reach(points);
        const auto n = static_cast<Index>(rows.size());
        std::vector<double> found(n * components * dimension);
        const Cube<double> near(found.data(), {n, components, dimension});
        sum(sum_gradients, Padded(points, view_of(rows)).view(), near);
        for (Index i = 0; i < n; ++i)
            for (Index e = 0; e < components * dimension; ++e) out[rows[i]].data()[e] += near[i].data()[e];
    }

    /// The same as CentreLayout.within_reach.
    std::vector<Index> within_reach(Matrix<const double> points) const {
        std::call_once(reach_asked, [this] { find_reach(); });
        const Index n = points.shape(0);
        const std::unique_ptr<bool[]> inside(new bool[n]);
        mark_reached(points, layout.origin.view(), layout.inverse_side, layout.shape.view(),
                     {reach.cells.get(), {reach.count}}, {inside.get(), {n}});
        std::vector<Index> rows;
        for (Index i = 0; i < n; ++i)
            if (inside[i]) rows.push_back(i);
        return rows;
    }

    void find_reach() const {
        reach.count = 1;
        for (Index cells : layout.shape.values) reach.count *= cells + 2;
        reach.cells.reset(new bool[reach.count]());
        mark_neighbours(layout.starts.view(), layout.shape.view(), {reach.cells.get(), {reach.count}});
        if (!(layout.inverse_side * radius * wider < 1.0)) return;
        if (layout.extent < wider * radius || centres() == 0) return;
        std::vector<double> points(3 * centres());
        for (Index j = 0; j < centres(); ++j)
            for (Index axis = 0; axis < 3; ++axis) points[3 * j + axis] = layout.coordinates.view()(axis, j);
        reach.small =
            store_cells({points.data(), {centres(), 3}}, layout.origin.view(), layout.extent, radius * slack);
    }
};

struct mesh_motion_near {
    Index centres, n;
    std::vector<std::pair<std::vector<Index>, SparseMatrix>> parts;
};

struct mesh_motion_spline {
    Index dimension, boxes, rows, components;
    std::vector<double> origin, inverse, coefficients;
    std::vector<Index> cells, start;

    /// Calls loop(points, boxes, given, out): spline_values or spline_gradients of coefficients, or the transpose of
    /// weights.
    template <class Loop, class Out>
    void use(Loop&& loop, Matrix<const double> points, Matrix<const double> given, Out out) const {
        loop(points, {origin.data(), {boxes, 3}}, view_of(inverse), {cells.data(), {boxes, 3}}, view_of(start), given, out);
    }

    template <class Loop, class Out>
    void evaluate(Loop&& loop, Matrix<const double> points, Out out) const {
        use(loop, points, {coefficients.data(), {rows, components}}, out);
    }
};

namespace {

/// The same as lay_out(basis, points), with padded points.
template <class LayOut>
int create(const char* basis, double support_radius, int64_t dimension, int64_t centres, const double* control_points,
           int64_t components, const double* weights, mesh_motion_interpolant** interpolant, LayOut&& lay_out) {
    return answered([&] {
        given(interpolant, "interpolant") = nullptr;
        const Row& row = named("basis", basis, bases);
        expect(support_radius > 0.0 && support_radius < std::numeric_limits<double>::infinity(), "support_radius",
               "a finite number > 0");
        expect(1 <= dimension && dimension <= 3, "dimension", "1, 2 or 3");
        expect(centres < std::numeric_limits<std::int32_t>::max(), "centres", "fewer than 2^31");
        expect(components >= 1, "components", "at least one");
        const auto points = array("control_points", control_points, std::array{centres, dimension});
        const auto rows = array("weights", weights, std::array{centres, components});
        finite("control_points", {points.data(), {points.size()}});
        auto made = std::make_unique<mesh_motion_interpolant>();
        made->basis = &row, made->radius = support_radius;
        made->dimension = dimension, made->components = components;
        made->layout = lay_out(row, Padded(points).view());
        made->weights = copied(finite("weights", {rows.data(), {rows.size()}}));
        for (Index c = 0; c < components; ++c)
            for (Index j : made->layout.order.values) made->sorted.push_back(rows(j, c));
        *interpolant = made.release();
    });
}

}  // namespace

int mesh_motion_interpolant_create(const char* basis, double support_radius, int64_t dimension, int64_t centres,
                                   const double* control_points, int64_t components, const double* weights,
                                   mesh_motion_interpolant** interpolant) {
    return create(basis, support_radius, dimension, centres, control_points, components, weights, interpolant,
                  [&](const Row& row, Matrix<const double> points) {
                      return lay_out_centres(points, row.compact ? support_radius : 0.0);
                  });
}

int mesh_motion_interpolant_create_on_grid(const char* basis, double support_radius, int64_t dimension,
                                           const double* origin, double inverse_side, double extent,
                                           const int64_t* shape, int64_t centres, const double* control_points,
                                           int64_t components, const double* weights,
                                           mesh_motion_interpolant** interpolant) {
    return create(basis, support_radius, dimension, centres, control_points, components, weights, interpolant,
                  [&](const Row&, Matrix<const double> points) {
                      return lay_out_on_grid(points, array("origin", origin, std::array<Index, 1>{3}), inverse_side,
                                             extent, array("shape", shape, std::array<Index, 1>{3}));
                  });
}

void mesh_motion_interpolant_free(mesh_motion_interpolant* interpolant) { delete interpolant; }

int mesh_motion_interpolant_set_polynomial(mesh_motion_interpolant* interpolant, const double* centre, double scale,
                                           const double* coefficients) {
    return answered([&] {
        auto& held = given(interpolant, "interpolant");
        const Index d = held.dimension;
        expect(scale != 0.0 && scale - scale == 0.0, "scale", "a finite number that is not 0");
        held.polynomial = {
            copied(finite("centre", array("centre", centre, std::array{d}))),
            copied(finite("coefficients", array("coefficients", coefficients, std::array{(d + 1) * held.components}))),
            scale};
    });
}

int mesh_motion_interpolant_values(const mesh_motion_interpolant* interpolant, int64_t n, const double* points,
                                   int mode, double* values) {
    return answered([&] {
        const auto& held = given(interpolant, "interpolant");
        const auto at = array("points", points, std::array{n, held.dimension});
        const auto out = array("values", values, std::array{n, held.components});
        if (mode == MESH_MOTION_ADD && held.is_level()) return held.add_values(at, out);
        write_or_add(mode, out, [&](Matrix<double> filled) { held.values(at, filled); });
    });
}

int mesh_motion_interpolant_gradients(const mesh_motion_interpolant* interpolant, int64_t n, const double* points,
                                      int mode, double* gradients) {
    return answered([&] {
        const auto& held = given(interpolant, "interpolant");
        expect(held.basis->gradient_at_centre, "interpolant", "a basis with a gradient at its control points");
        const auto at = array("points", points, std::array{n, held.dimension});
        const auto out = array("gradients", gradients, std::array{n, held.components, held.dimension});
        if (mode == MESH_MOTION_ADD && held.is_level()) return held.add_gradients(at, out);
        write_or_add(mode, out, [&](Cube<double> filled) { held.gradients(at, filled); });
    });
}

int mesh_motion_near_create(const mesh_motion_interpolant* interpolant, int64_t n, const double* points,
                            const bool* skipped, mesh_motion_near** near) {
    return answered([&] {
        given(near, "near") = nullptr;
        const auto& held = given(interpolant, "interpolant");
        expect(held.is_level(), "interpolant", "a compact one without a polynomial");
        const auto at = array("points", points, std::array{n, held.dimension});
        std::vector<Index> rows = held.within_reach(at);
        if (skipped) std::erase_if(rows, [skipped](Index row) { return skipped[row]; });
        auto made = std::make_unique<mesh_motion_near>(mesh_motion_near{held.centres(), n, {}});
        held.for_near(at, rows, [&](Vector<const Index> some, SparseMatrix&& matrix) {
            made->parts.emplace_back(copied(some), std::move(matrix));
        });
        *near = made.release();
    });
}

void mesh_motion_near_free(mesh_motion_near* near) { delete near; }

int mesh_motion_near_add(const mesh_motion_near* near, int64_t components, const double* weights, double* values) {
    return answered([&] {
        const auto& held = given(near, "near");
        const auto factors = array("weights", weights, std::array{held.centres, components});
        const auto out = array("values", values, std::array{held.n, components});
        for (const auto& [rows, matrix] : held.parts) {
            const auto& [pointers, columns, entries] = matrix;
            add_product(view_of(rows), pointers.view(), columns.view(), entries.view(), factors, out);
        }
    });
}

int mesh_motion_spline_create(int64_t dimension, int64_t boxes, const double* origin, const double* inverse_spacing,
                              const int64_t* cells, const int64_t* start, int64_t rows, int64_t components,
                              const double* coefficients, mesh_motion_spline** spline) {
    return answered([&] {
        given(spline, "spline") = nullptr;
        expect(1 <= dimension && dimension <= 3, "dimension", "1, 2 or 3");
        expect(components >= 1, "components", "at least one");
        auto made = std::make_unique<mesh_motion_spline>(mesh_motion_spline{
            dimension, boxes, rows, components,
            copied(array("origin", origin, std::array{boxes, Index{3}})),
            copied(array("inverse_spacing", inverse_spacing, std::array{boxes})),
            copied(array("coefficients", coefficients, std::array{rows, components})),
            copied(array("cells", cells, std::array{boxes, Index{3}})),
            copied(array("start", start, std::array{boxes}))});
        // evaluate at no points: the loops then refuse arrays that do not fit together, before users evaluate at points
        made->evaluate(spline_gradients, {nullptr, {0, dimension}}, Cube<double>(nullptr, {0, components, dimension}));
        *spline = made.release();
    });
}

void mesh_motion_spline_free(mesh_motion_spline* spline) { delete spline; }

int mesh_motion_spline_values(const mesh_motion_spline* spline, int64_t n, const double* points, int mode,
                              double* values) {
    return answered([&] {
        const auto& held = given(spline, "spline");
        const auto at = array("points", points, std::array{n, held.dimension});
        write_or_add(mode, array("values", values, std::array{n, held.components}),
                     [&](Matrix<double> out) { held.evaluate(spline_values, at, out); });
    });
}

int mesh_motion_spline_counts(const mesh_motion_spline* spline, int64_t n, const double* points, int64_t components,
                              const double* weights, double* counts) {
    return answered([&] {
        const auto& held = given(spline, "spline");
        const Matrix<double> out = array("counts", counts, std::array{held.rows, components});
        held.use(add_spline_coefficients, array("points", points, std::array{n, held.dimension}),
                 array("weights", weights, std::array{n, components}), out);
    });
}

int mesh_motion_spline_gradients(const mesh_motion_spline* spline, int64_t n, const double* points, int mode,
                                 double* gradients) {
    return answered([&] {
        const auto& held = given(spline, "spline");
        const auto at = array("points", points, std::array{n, held.dimension});
        write_or_add(mode, array("gradients", gradients, std::array{n, held.components, held.dimension}),
                     [&](Cube<double> out) { held.evaluate(spline_gradients, at, out); });
    });
}
