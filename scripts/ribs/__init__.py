"""Ways of moving ribs on virtual patients: runs, what is told of each, tables and pictures."""
