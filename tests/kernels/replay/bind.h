// Takes the place of kernels/src/bind.h: the same bindings give the loops to recorded calls instead of Python.
#pragma once

#include <algorithm>
#include <cstring>
#include <functional>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "quality/cell_quality.h"
#include "view.h"

namespace nanobind {
struct module_ {};
}  // namespace nanobind

namespace mesh_motion {

/// A value that Python sent or got: an array ('a'), a number ('n'), a sequence ('s') or nothing ('-').
struct Value {
    char kind = '-';
    std::string type;  // of an array, as in NumPy
    std::vector<Index> shape;
    std::vector<double> data;  // its bytes, aligned for all types
    double number = 0;
    std::vector<Value> parts;
};

template <class T>
std::string type_name() {
    const char kind = std::is_same_v<T, bool>          ? 'b'
                      : std::is_floating_point_v<T> ? 'f'
                      : std::is_signed_v<T>         ? 'i'
                                                    : 'u';
    return kind + std::to_string(sizeof(T));
}

/// Equal bits, except the sign and payload of NaN, which processors choose.
template <class T>
bool same(const T* a, const T* b, Index n) {
    for (Index i = 0; i < n; ++i)
        if (std::memcmp(a + i, b + i, sizeof(T)) != 0 && !(a[i] != a[i] && b[i] != b[i])) return false;
    return true;
}

/// How an argument or a result of type T is read from the record, and compared with it.
template <class T>
struct As {
    static bool fits(const Value& value) { return value.kind == 'n'; }
    static T read(Value& value) { return static_cast<T>(value.number); }
    static bool equals(const Value& value, const T& found) {
        const double number = static_cast<double>(found);
        return value.kind == 'n' && same(&value.number, &number, 1);
    }
};

template <class T, std::size_t N>
struct As<View<T, N>> {
    using Plain = std::remove_const_t<T>;
    static bool fits(const Value& value) {
        return value.kind == 'a' && value.shape.size() == N && value.type == type_name<Plain>();
    }
    static View<T, N> read(Value& value) {
        std::array<Index, N> shape{};
        std::copy(value.shape.begin(), value.shape.end(), shape.begin());
        return {reinterpret_cast<Plain*>(value.data.data()), shape};
    }
    static bool equals(Value value, const View<T, N>& found) {
        return fits(value) && read(value).shape() == found.shape() &&
               same<Plain>(read(value).data(), found.data(), found.size());
    }
};

template <class T, std::size_t N, class Values>
struct As<Owned<T, N, Values>> {
    static bool equals(const Value& value, const Owned<T, N, Values>& found) {
        return As<View<const T, N>>::equals(value, found.view());
    }
};

template <class T>
struct As<std::vector<T>> {
    static bool fits(const Value& value) {
        return value.kind == 's' && std::all_of(value.parts.begin(), value.parts.end(), As<T>::fits);
    }
    static std::vector<T> read(Value& value) {
        std::vector<T> all;
        for (Value& part : value.parts) all.push_back(As<T>::read(part));
        return all;
    }
};

template <class... T>
struct As<std::tuple<T...>> {
    static bool fits(const Value& value) {
        std::size_t i = 0;
        return value.kind == 's' && value.parts.size() == sizeof...(T) && (As<T>::fits(value.parts[i++]) && ...);
    }
    static std::tuple<T...> read(Value& value) {
        return [&]<std::size_t... I>(std::index_sequence<I...>) {
            return std::tuple<T...>(As<T>::read(value.parts[I])...);
        }(std::index_sequence_for<T...>{});
    }
    static bool equals(const Value& value, const std::tuple<T...>& found) {
        return [&]<std::size_t... I>(std::index_sequence<I...>) {
            return value.parts.size() == sizeof...(T) && (As<T>::equals(value.parts[I], std::get<I>(found)) && ...);
        }(std::index_sequence_for<T...>{});
    }
};

template <class A, class B>
struct As<std::pair<A, B>> : As<std::tuple<A, B>> {
    static std::pair<A, B> read(Value& value) { return {As<A>::read(value.parts[0]), As<B>::read(value.parts[1])}; }
};

template <>
struct As<AtRest> : As<std::tuple<Vector<const double>, Matrix<const double>>> {
    static AtRest read(Value& value) {
        return {As<Vector<const double>>::read(value.parts[0]), As<Matrix<const double>>::read(value.parts[1])};
    }
};

/// A form of a loop: whether arguments are its, and then whether it gives the result that is expected of them.
struct Form {
    std::function<bool(const Value&)> fits;
    std::function<bool(Value&, const Value&)> repeats;
};
inline std::multimap<std::string, Form> forms;

template <class R, class... A>
void bind_form(const char* name, std::function<R(A...)> loop) {
    using Arguments = std::tuple<std::decay_t<A>...>;
    forms.insert({name, {As<Arguments>::fits, [loop](Value& arguments, const Value& expected) {
        if constexpr (std::is_void_v<R>) {
            std::apply(loop, As<Arguments>::read(arguments));
            return expected.kind == '-';
        } else {
            return As<R>::equals(expected, std::apply(loop, As<Arguments>::read(arguments)));
        }
    }}});
}

template <class Loop>
void bind(nanobind::module_&, const char* name, Loop loop) {
    bind_form(name, std::function(loop));
}

void bind_interpolation(nanobind::module_& m);
void bind_quality(nanobind::module_& m);
void bind_correction(nanobind::module_& m);
void bind_two_scale(nanobind::module_& m);
void bind_mesh(nanobind::module_& m);

}  // namespace mesh_motion
