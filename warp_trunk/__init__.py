"""Predicts how the trunk of a scoliosis patient looks after spine surgery.

The public names are listed in `__init__.pyi`. Each is imported from its room when it is first used, so that
`import warp_trunk` costs nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
