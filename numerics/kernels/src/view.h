// Arrays in the loops: a pointer together with its shape.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace mesh_motion {

using Index = std::int64_t;

/// The number of a node; a mesh has fewer than 2³¹ nodes. It takes half the memory of an index, which matters when all
/// cells are read.
using Node = std::int32_t;

/// Refuses a wrong argument; callers in Python get a ValueError.
inline void require(bool holds, const char* expected) {
    if (!holds) throw std::invalid_argument(expected);
}

/// A C-contiguous array with N axes whose memory belongs to another object.
template <class T, std::size_t N>
class View {
  public:
    View() = default;
    View(T* data, std::array<Index, N> shape) : data_(data), shape_(shape) {}

    /// A view for writing converts to a view for reading.
    template <class U>
        requires(std::is_same_v<const U, T> && !std::is_same_v<U, T>)
    View(const View<U, N>& other) : data_(other.data()), shape_(other.shape()) {}

    Index shape(std::size_t axis) const { return shape_[axis]; }
    const std::array<Index, N>& shape() const { return shape_; }
    Index size() const {
        Index product = 1;
        for (Index n : shape_) product *= n;
        return product;
    }
    T* data() const { return data_; }
    T* begin() const { return data_; }
    T* end() const { return data_ + size(); }

    template <class... Indices>
        requires(sizeof...(Indices) == N)
    T& operator()(Indices... indices) const {
        return data_[place(std::array<Index, N>{static_cast<Index>(indices)...})];
    }

    /// An entry of a vector, or a row of a larger array.
    decltype(auto) operator[](Index i) const {
        if constexpr (N == 1) {
            return (*this)(i);
        } else {
            check(i, 0);
            std::array<Index, N - 1> rest;
            Index length = 1;
            for (std::size_t axis = 1; axis < N; ++axis) length *= rest[axis - 1] = shape_[axis];
            return View<T, N - 1>(data_ + i * length, rest);
        }
    }

    /// The rows first … last − 1.
    View rows(Index first, Index last) const {
#ifdef MESH_MOTION_CHECKED
        if (first < 0 || last < first || last > shape_[0]) throw std::out_of_range("rows of a view");
#endif
        std::array<Index, N> part = shape_;
        part[0] = last - first;
        Index length = 1;
        for (std::size_t axis = 1; axis < N; ++axis) length *= shape_[axis];
        return View(data_ + first * length, part);
    }

  private:
    Index place(const std::array<Index, N>& indices) const {
        Index place = 0;
        for (std::size_t axis = 0; axis < N; ++axis) {
            check(indices[axis], axis);
            place = place * shape_[axis] + indices[axis];
        }
        return place;
    }
    void check([[maybe_unused]] Index i, [[maybe_unused]] std::size_t axis) const {
#ifdef MESH_MOTION_CHECKED
        if (i < 0 || i >= shape_[axis])
            throw std::out_of_range("index " + std::to_string(i) + " of axis " + std::to_string(axis) + " of " +
                                    std::to_string(shape_[axis]));
#endif
    }

    T* data_ = nullptr;
    std::array<Index, N> shape_{};
};

template <class T>
using Vector = View<T, 1>;
template <class T>
using Matrix = View<T, 2>;
template <class T>
using Cube = View<T, 3>;

/// A view of a local vector or std::array.
template <class Container>
auto view_of(Container& local) {
    return Vector<std::remove_pointer_t<decltype(local.data())>>(local.data(), {static_cast<Index>(local.size())});
}

/// Refuses numbers of n objects unless all are from 0 to n − 1.
template <class T, std::size_t N>
void require_below(View<const T, N> numbers, Index n, const char* expected) {
    using Bits = std::make_unsigned_t<T>;
    constexpr int highest = 8 * sizeof(T) - 1;
    const auto last = static_cast<Bits>(std::min<Index>(n - 1, std::numeric_limits<std::make_signed_t<T>>::max()));
    Bits signs = 0;  // a negative difference has the highest bit set, and so has a negative number
    for (T number : numbers) signs |= static_cast<Bits>(number) | (last - static_cast<Bits>(number));
    require(signs >> highest == 0, expected);
}

/// Refuses starts of parts of n entries unless they ascend up to n.
inline void require_starts(Vector<const Index> starts, Index n, const char* expected) {
    bool ascending = starts.size() > 0 && starts[0] >= 0 && starts[starts.size() - 1] == n;
    for (Index i = 1; i < starts.size(); ++i) ascending &= starts[i - 1] <= starts[i];
    require(ascending, expected);
}

/// Gives vectors memory that is not filled, for callers that write every entry; large memory is in large pages if the
/// system has them.
template <class T>
struct Unfilled : std::allocator<T> {
    template <class U>
    struct rebind {
        using other = Unfilled<U>;
    };

    T* allocate(std::size_t count) {
        T* begin = std::allocator<T>::allocate(count);
#ifdef __linux__
        constexpr std::uintptr_t page = 1 << 12, large = 1 << 22;
        const auto first = (reinterpret_cast<std::uintptr_t>(begin) + page - 1) / page * page;
        const auto last = reinterpret_cast<std::uintptr_t>(begin + count) / page * page;
        if (last > first && last - first >= large) madvise(reinterpret_cast<void*>(first), last - first, MADV_HUGEPAGE);
#endif
        return begin;
    }
    template <class U, class... Arguments>
    void construct(U* place, Arguments&&... arguments) {
        if constexpr (sizeof...(Arguments) == 0) ::new (place) U;
        else ::new (place) U(std::forward<Arguments>(arguments)...);
    }
};

/// A vector whose memory is not filled with zeros.
template <class T>
using UnfilledVector = std::vector<T, Unfilled<T>>;

/// An array that a loop made and Python receives.
template <class T, std::size_t N, class Values = std::vector<T>>
struct Owned {
    Values values;
    std::array<Index, N> shape{};

    View<const T, N> view() const { return {values.data(), shape}; }
};

/// A vector that a loop made.
template <class T, class Allocator>
Owned<T, 1, std::vector<T, Allocator>> owned(std::vector<T, Allocator> values) {
    const auto n = static_cast<Index>(values.size());
    return {std::move(values), {n}};
}

/// Calls f(d) with the dimension as a constant, so that loops over it are unrolled.
template <class F>
decltype(auto) with_dimension(Index d, F&& f) {
    switch (d) {
        case 1: return f(std::integral_constant<int, 1>{});
        case 2: return f(std::integral_constant<int, 2>{});
        case 3: return f(std::integral_constant<int, 3>{});
        default: throw std::invalid_argument("expected one, two or three dimensions");
    }
}

template <class T, std::size_t N>
std::vector<std::remove_const_t<T>> copied(View<T, N> values) {
    return {values.begin(), values.end()};
}

}  // namespace mesh_motion
