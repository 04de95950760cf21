"""The energies a trunk can have, one file each. May import what `engine` may."""
