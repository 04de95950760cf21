"""Opening, reading and writing files so that a damaged one does no harm."""
