#include "bind.h"
#include "parallel.h"

NB_MODULE(_kernels, m) {
    using namespace mesh_motion;
    m.def("available_threads", available_threads);
    m.def("get_threads", get_threads);
    m.def("set_threads", set_threads);
    bind_interpolation(m);
    bind_quality(m);
    bind_correction(m);
    bind_two_scale(m);
    bind_mesh(m);
}
