"""Label maps and scans: NIfTI and NRRD, read slab by slab, so that no header can fill the memory.

May import what `io` may.
"""
