// The term of the angles at a corner of a quad or hexahedron in its distortion relative to rest.
//
// With the obliqueness o = Σ log |a_k| − log |det A| of the edges a_k, and x = max(o − o at rest, 0):
//
//   φ = b x³ / (x + e)²
//
// This is b x after a short start, with two continuous derivatives. A corner that is less oblique than at rest gains
// nothing: otherwise it could compensate for a squeezed one.
#pragma once

namespace mesh_motion {

/// φ at x ≥ 0.
template <class Number>
struct AngleLaw {
    // a larger value keeps more of the angles in a cascade's mesh (0.62 of a skew with 1, 0.73 with 2, instead of 0.56)
    // and less of the size-skew of other meshes; with 2, coarse hexahedra around a body that turns by 40° have no
    // smooth mesh; with 4 and a start of 0.01 the cascade keeps 0.86 in one step, but where the blade swings by 5° in
    // many steps nodes move seven times as fast as the blade (now 1.0), and the smallest shape is 0.45 (now 0.63)
    static constexpr double weight = 0.5, start = 0.05;
    Number x, sum, ratio;

    explicit AngleLaw(Number oblique) : x(oblique), sum(x + start), ratio(x / sum) {}

    Number value() const { return weight * x * ratio * ratio; }
    Number first() const { return weight * ratio * ratio * (x + 3.0 * start) / sum; }
    Number second() const { return 6.0 * weight * start * start * x / (sum * sum * sum * sum); }
};

}  // namespace mesh_motion
