// Common parts of all calls of the C interface: no exception leaves a call, and no missing array is read.
#pragma once

#include <limits>
#include <new>
#include <string>

#include "mesh_motion_kernels.h"
#include "view.h"

namespace mesh_motion {

/// Stores the text that mesh_motion_kernels_error() returns in this thread.
void keep_error(const char* message) noexcept;

/// Calls f() and returns its exceptions as numbers.
template <class F>
int answered(F&& f) noexcept {
    try {
        f();
        return MESH_MOTION_OK;
    } catch (const std::invalid_argument& error) {
        return keep_error(error.what()), MESH_MOTION_INVALID_ARGUMENT;
    } catch (const std::bad_alloc&) {
        return keep_error("there is not enough memory"), MESH_MOTION_OUT_OF_MEMORY;
    } catch (const std::exception& error) {
        return keep_error(error.what()), MESH_MOTION_INTERNAL;
    } catch (...) {
        return keep_error("unknown error"), MESH_MOTION_INTERNAL;
    }
}

/// Refuses an argument, with its name.
inline void expect(bool holds, const char* name, const char* expected) {
    if (!holds) throw std::invalid_argument(std::string(name) + ": expected " + expected);
}

/// The object that a pointer points at.
template <class T>
T& given(T* handle, const char* name) {
    expect(handle, name, "a pointer that is not NULL");
    return *handle;
}

/// A view of an array that was passed as a pointer.
template <class T, std::size_t N>
View<T, N> array(const char* name, T* data, std::array<Index, N> shape) {
    Index size = 1;
    for (Index n : shape) {
        expect(n >= 0, name, "lengths that are not negative");
        constexpr Index most = std::numeric_limits<std::ptrdiff_t>::max() / sizeof(T);
        expect(n == 0 || size <= most / n, name, "an array that fits into memory");
        size *= n;
    }
    expect(data || size == 0, name, "a pointer that is not NULL");
    return {data, shape};
}

inline Vector<const double> finite(const char* name, Vector<const double> values) {
    for (double value : values) expect(value - value == 0.0, name, "finite numbers");
    return values;
}

/// The row of a table with this name.
template <class Table>
auto& named(const char* argument, const char* name, Table& table) {
    std::string known;
    for (auto& row : table) {
        if (std::string(&given(name, argument)) == row.name) return row;
        known += (known.empty() ? "" : ", ") + std::string(row.name);
    }
    throw std::invalid_argument(std::string(argument) + ": expected one of " + known + ", got '" + name + "'");
}

/// Calls fill(out), or adds the filled values to out.
template <class View, class F>
void write_or_add(int mode, View out, F&& fill) {
    expect(mode == MESH_MOTION_WRITE || mode == MESH_MOTION_ADD, "mode", "MESH_MOTION_WRITE or MESH_MOTION_ADD");
    if (mode == MESH_MOTION_WRITE) return fill(out);
    std::vector<double> values(out.size());
    fill(View(values.data(), out.shape()));
    for (std::size_t i = 0; i < values.size(); ++i) out.data()[i] += values[i];
}

}  // namespace mesh_motion
