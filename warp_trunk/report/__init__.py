"""The report of a result, or of plans side by side, for patient and surgeon: pictures, sentences and numbers."""
