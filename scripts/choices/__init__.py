"""What every choice of the model costs: runs that differ in one choice, kept, and how far they are apart."""
