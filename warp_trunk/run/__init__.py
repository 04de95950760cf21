"""One whole run: from a case to a result folder."""
