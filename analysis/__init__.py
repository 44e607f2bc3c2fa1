"""Analysis: from raw counts to normals, depth and BRDF, offline.

What a script needs can be imported from here (docs/python.md); it is loaded when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
