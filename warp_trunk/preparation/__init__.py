"""From scans, films, label maps or formulas to a case. May import `bone_motion`, `meshing` and below."""
