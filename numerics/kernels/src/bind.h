// Arrays from and to Python: of the exact type and C-contiguous. They are never converted; other arrays are a
// TypeError.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <chrono>
#include <thread>
#include <utility>

#include "view.h"

namespace nanobind::detail {

template <class T, std::size_t N>
struct type_caster<mesh_motion::View<T, N>> {
    using Array = ndarray<T, ndim<N>, c_contig, device::cpu>;
    using View = mesh_motion::View<T, N>;
    NB_TYPE_CASTER(View, make_caster<Array>::Name)

    bool from_python(handle source, std::uint32_t flags, cleanup_list* cleanup) noexcept {
        if (!array_.from_python(source, flags & ~static_cast<std::uint32_t>(cast_flags::convert), cleanup)) return false;
        std::array<mesh_motion::Index, N> shape;
        for (std::size_t axis = 0; axis < N; ++axis) shape[axis] = static_cast<mesh_motion::Index>(array_.value.shape(axis));
        value = View(array_.value.data(), shape);
        return true;
    }

  private:
    make_caster<Array> array_;  // keeps the memory during the call
};

template <class T, std::size_t N, class Values>
struct type_caster<mesh_motion::Owned<T, N, Values>> {
    using Array = ndarray<numpy, T, ndim<N>, c_contig>;
    using Owned = mesh_motion::Owned<T, N, Values>;
    NB_TYPE_CASTER(Owned, make_caster<Array>::Name)

    static handle from_cpp(Owned&& made, rv_policy, cleanup_list* cleanup) noexcept {
        auto* values = new Values(std::move(made.values));
        capsule owner(values, [](void* p) noexcept { delete static_cast<Values*>(p); });
        std::size_t shape[N];
        for (std::size_t axis = 0; axis < N; ++axis) shape[axis] = static_cast<std::size_t>(made.shape[axis]);
        return make_caster<Array>::from_cpp(Array(values->data(), N, shape, owner), rv_policy::reference, cleanup);
    }
};

}  // namespace nanobind::detail

namespace mesh_motion {

/// Releases the interpreter's lock while a loop runs. If the interpreter has ended meanwhile, it ends each thread that
/// takes the lock again; before Python 3.14 by unwinding the thread's stack, which would abort the process here. So
/// such a thread sleeps for ever instead.
struct Unlocked {
    PyThreadState* state = PyEval_SaveThread();

    Unlocked() = default;
    Unlocked(const Unlocked&) = delete;
    ~Unlocked() {
        try {
            PyEval_RestoreThread(state);
        } catch (...) {
            for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
        }
    }
};

/// Gives Python a loop that runs without the interpreter's lock.
template <class Loop>
void bind(nanobind::module_& m, const char* name, Loop loop) {
    m.def(name, loop, nanobind::call_guard<Unlocked>());
}

// Each folder has one function (in its bindings.cpp) that declares the folder's functions to Python.
void bind_interpolation(nanobind::module_& m);
void bind_quality(nanobind::module_& m);
void bind_correction(nanobind::module_& m);
void bind_two_scale(nanobind::module_& m);
void bind_mesh(nanobind::module_& m);

}  // namespace mesh_motion
