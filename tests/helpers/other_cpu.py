"""Another processor than this machine's: x86-64 without AVX-512, emulated by what the libraries read at their start.

`env $(python tests/helpers/other_cpu.py) python -m pytest` runs the tests as on such a machine.
"""

import os
import platform

VARIABLES = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V4,AVX512_ICL,AVX512_SPR",
    "OPENBLAS_CORETYPE": "Haswell",
    "ATEN_CPU_CAPABILITY": "avx2",
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": (
        "+sse,+sse2,+sse3,+ssse3,+sse4.1,+sse4.2,+avx,+avx2,+fma,+f16c,+bmi,+bmi2,+popcnt,+lzcnt,+movbe,+cmov,+cx8,"
        "+cx16,+fxsr,+mmx,+xsave,+64bit,+sahf,+rdrnd,+fsgsbase,+invpcid"
    ),  # by its name alone it would still use all that this machine's processor has
}
X86 = platform.machine() == "x86_64"


def without_avx512() -> dict[str, bool]:
    """By variable, whether the library that reads it does without AVX-512 here."""
    import numpy as np
    import scipy.linalg  # noqa: F401  # it brings an OpenBLAS of its own
    import torch
    from numba import float64, njit
    from numba.core.registry import cpu_target
    from threadpoolctl import threadpool_info

    @njit(float64(float64[:], float64[:]))  # type: ignore[untyped-decorator]
    def last_of_sum(a, b):  # type: ignore[no-untyped-def]
        for i in range(len(a)):
            a[i] = a[i] * 2.0 + b[i]
        return a[-1]

    machine_code = "".join(last_of_sum.inspect_asm().values())
    blas = {one["architecture"] for one in threadpool_info() if one["internal_api"] == "openblas"}
    numpys = set(np.show_config("dicts")["SIMD Extensions"]["found"])
    return {
        "NPY_DISABLE_CPU_FEATURES": not {"X86_V4", "AVX512_ICL"} & numpys,
        "OPENBLAS_CORETYPE": blas == {"Haswell"},
        "ATEN_CPU_CAPABILITY": torch.backends.cpu.get_cpu_capability() == "AVX2",
        "NUMBA_CPU_NAME": cpu_target.target_context.codegen()._get_host_cpu_name() == "haswell",
        "NUMBA_CPU_FEATURES": "zmm" not in machine_code,
    }


def told() -> list[str]:
    """The variables that are set for this process."""
    return [name for name, value in VARIABLES.items() if os.environ.get(name) == value]


if __name__ == "__main__":
    print(*(f"{name}={value}" for name, value in VARIABLES.items()))
