"""From what a clinic has, or from formulas, to a case."""
