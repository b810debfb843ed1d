// Reads calls from standard input; prints a line for each: the loop, and "same" or what differs.
// recorded_calls.py writes them: the loop's name, its arguments, the result, and the arguments after it.
#include <algorithm>
#include <iostream>
#include <numeric>

#include "bind.h"

namespace {

using namespace mesh_motion;

template <class T>
T read() {
    T value;
    if (!std::cin.read(reinterpret_cast<char*>(&value), sizeof value)) throw std::runtime_error("the calls end too early");
    return value;
}

std::string read_text() {
    std::string text(static_cast<std::size_t>(read<Index>()), ' ');
    std::cin.read(text.data(), static_cast<std::streamsize>(text.size()));
    return text;
}

Value read_value() {
    Value value;
    value.kind = read<char>();
    if (value.kind == 'n') value.number = read<double>();
    if (value.kind == 's') {
        value.parts.resize(static_cast<std::size_t>(read<Index>()));
        for (Value& part : value.parts) part = read_value();
    }
    if (value.kind == 'a') {
        value.type = read_text();
        value.shape.resize(static_cast<std::size_t>(read<Index>()));
        for (Index& n : value.shape) n = read<Index>();
        const std::string bytes = read_text();
        value.data.resize(bytes.size() / sizeof(double) + 1);
        std::memcpy(value.data.data(), bytes.data(), bytes.size());
    }
    return value;
}

/// Whether arrays are as they are expected after a call.
bool same_arrays(const Value& found, const Value& expected) {
    if (found.kind == 's')
        return std::equal(found.parts.begin(), found.parts.end(), expected.parts.begin(), same_arrays);
    if (found.kind != 'a') return true;
    if (found.type != "f4") return same(found.data.data(), expected.data.data(), static_cast<Index>(found.data.size()));
    const auto floats = [](const Value& value) { return reinterpret_cast<const float*>(value.data.data()); };
    return same(floats(found), floats(expected), 2 * static_cast<Index>(found.data.size()));
}

const char* repeated(const std::string& name) {
    Value arguments = read_value(), result = read_value(), after = read_value();
    const auto [first, last] = forms.equal_range(name);
    const auto form = std::find_if(first, last, [&](auto& each) { return each.second.fits(arguments); });
    if (form == last) return "no such form";
    if (!form->second.repeats(arguments, result)) return "another result";
    return same_arrays(arguments, after) ? "same" : "other values written";
}

}  // namespace

int main() {
    nanobind::module_ m;
    bind_interpolation(m);
    bind_quality(m);
    bind_correction(m);
    bind_two_scale(m);
    bind_mesh(m);
    while (std::cin.peek() != EOF) {
        const std::string name = read_text();
        std::cout << name << '\t' << repeated(name) << '\n';
    }
}
