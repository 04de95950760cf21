"""All Warp code. Warp is started here, before any kernel is defined, so that it says nothing unless asked."""

from .starting import start_warp

start_warp()
