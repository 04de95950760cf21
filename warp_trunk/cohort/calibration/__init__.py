"""Constants of tissue and ribs found on patients whose actual skin is known. May import what `cohort` may."""
