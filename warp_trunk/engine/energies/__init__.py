"""The energies a trunk can have, one file each."""
