/* The instruction set of this machine: checked before a module that needs it is loaded, and by a native build. */
#if defined(__x86_64__)
#include <cpuid.h>

/* Instructions that the processor has and whose registers the system saves. __builtin_cpu_supports() is not used,
 * because it always returns false if zig is the compiler. */
static const char *widest(void)
{
    const unsigned fma_osxsave_avx = 1u << 12 | 1u << 27 | 1u << 28, bmi_avx2_bmi2 = 1u << 3 | 1u << 5 | 1u << 8;
    const unsigned avx512_f_dq_cd_bw_vl = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31;
    unsigned a, b, c, d, saved, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & fma_osxsave_avx) != fma_osxsave_avx)
        return "v2";
    __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || (b & bmi_avx2_bmi2) != bmi_avx2_bmi2 || (saved & 0x06) != 0x06)
        return "v2";
    return (b & avx512_f_dq_cd_bw_vl) == avx512_f_dq_cd_bw_vl && (saved & 0xe6) == 0xe6 ? "v4" : "v3";
}
#else
static const char *widest(void) { return "base"; }
#endif

#ifdef PRINT_LEVEL
#include <stdio.h>

int main(void)
{
    fputs(widest(), stdout);
    return 0;
}
#else
#include <Python.h>

static PyObject *level(PyObject *self, PyObject *args)
{
    (void)self;
    (void)args;
    return PyUnicode_FromString(widest());
}

static PyMethodDef methods[] = {{"level", level, METH_NOARGS, "The widest instruction set that runs here."}, {0}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, .m_name = "_machine", .m_size = 0, .m_methods = methods};

PyMODINIT_FUNC PyInit__machine(void) { return PyModuleDef_Init(&module); }
#endif
