#include "interpolation/basis.h"

namespace mesh_motion {

void map_phi(int code, Vector<double> xi) {
    with_basis(code, [&](auto basis) {
        for (double& x : xi) x = basis.phi(x);
    });
}

void map_slope(int code, Vector<double> xi) {
    with_basis(code, [&](auto basis) {
        for (double& x : xi) x = basis.slope(x);
    });
}

}  // namespace mesh_motion
