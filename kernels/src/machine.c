/* Which instructions this machine has, asked before a module is loaded that needs them. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

static PyObject *level(PyObject *self, PyObject *args)
{
    (void)self;
    (void)args;
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512cd") &&
        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        return PyUnicode_FromString("v4");
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
        __builtin_cpu_supports("bmi2"))
        return PyUnicode_FromString("v3");
    return PyUnicode_FromString("v2");
#else
    return PyUnicode_FromString("base");
#endif
}

static PyMethodDef methods[] = {{"level", level, METH_NOARGS, "The widest instruction set that runs here."}, {0}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, .m_name = "_machine", .m_size = 0, .m_methods = methods};

PyMODINIT_FUNC PyInit__machine(void) { return PyModuleDef_Init(&module); }
