"""Statistics of numbers from several patients; the functions know numbers and patients, not trunks."""
