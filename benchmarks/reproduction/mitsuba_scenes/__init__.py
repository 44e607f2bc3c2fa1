"""Scenes rendered by Mitsuba 3 [jakob2022], for the experiments `synthetic` and `riviere` of the reproduction.

Mitsuba shares nothing with our own forward models: it knows shadows, light that goes from surface to surface, and
materials of its own. It is not needed for anything else, so it comes as an extra::

    pip install 'halfangle[validate]'
    apt install libllvm19

It compiles its kernels with LLVM 16 or later and aborts with an older one. The library is looked for in the usual
folders; where it lies elsewhere, the variable ``DRJIT_LIBLLVM_PATH`` names it. Without Mitsuba or LLVM the two
experiments are skipped and say so.

A scene (`scenes`) is a relief over the plane (`surfaces`), known as a function, with materials that textures mix, in a
white plate with a marker board in each corner (`plate`). It is written as XML, PLY and PNG (`files`), rendered view by
view (`views`) in a process of its own (`render`, `child`), and goes through import, calibration and reconstruction
like anyone's pictures (`chain`). What was made before is found again, so a run that was cut off goes on.
"""
