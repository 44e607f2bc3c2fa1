"""The instrument: rig, configuration, session files.

What a script needs can be imported from here; it is loaded when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
